"""The raw file of a live session: lossless, read as an ordinary recording, whole up to a kill."""

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from acromion.app.live.raw_file import RawFile, find_interrupted_sessions, was_stopped
from acromion.app.live.sources import ReplaySource, SourceFacts, find_axis
from acromion.fusion.live import Frames, LiveElevation, LiveSession
from acromion.fusion.readers import read_recording
from acromion.fusion.recording import Recording
from tests.app.live.made import FIRST_POSE, make_frames, make_worn

START = datetime(2026, 3, 2, 7, 0, tzinfo=UTC)
HEADER = SourceFacts("lsm9ds1", "replay", 100.0, START, acc_range_g=16.0, gyr_range_dps=2000.0)


def write(path: Path, frames: Frames, pose_s: tuple[float, float] | None = None) -> Recording:
    with RawFile(path, HEADER) as raw:
        raw.write(frames)
        if pose_s:
            raw.state_pose(*pose_s)
        raw.stop(START)
    return read_recording(path)


FRAMES = make_frames(FIRST_POSE, (95.0, 10.0))


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The raw file of a session without a pose, which was stopped."""
    path = tmp_path_factory.mktemp("raw") / "live-a.csv"
    write(path, FRAMES)
    return path


def test_samples_are_read_to_the_bit_with_device_clock_and_ranges_and_no_pose(written: Path) -> None:
    read = read_recording(written)

    assert np.array_equal(read.segments[0].acc_g, FRAMES.acc_g)
    assert np.array_equal(read.segments[0].gyr_dps, FRAMES.gyr_dps)
    assert read.rate_hz == pytest.approx(100.0)
    assert (read.device, read.start) == ("lsm9ds1", START)
    assert (read.acc_range_g, read.gyr_range_dps) == (16.0, 2000.0)
    assert read.pose_windows_s == ()


def test_a_session_that_is_stopped_is_not_cut(written: Path) -> None:
    assert was_stopped(written)
    assert list(find_interrupted_sessions(written.parent)) == []


def test_a_hole_is_a_hole(tmp_path: Path) -> None:
    with RawFile(tmp_path / "live-a.csv", HEADER) as raw:
        raw.write(FRAMES.cut(0, 1000))
        raw.write(FRAMES.cut(1500, 2200))

    first, second = read_recording(tmp_path / "live-a.csv").segments

    assert len(first) == 1000
    assert second.start_us == pytest.approx(15_000_000, abs=10)


def test_a_later_pose_takes_the_place_of_the_first(tmp_path: Path) -> None:
    with RawFile(tmp_path / "live-a.csv", HEADER) as raw:
        raw.write(make_frames(FIRST_POSE, (95.0, 10.0)))
        raw.state_pose(5.0, 10.0)
        raw.state_pose(12_345.678, 12_350.678)

    assert read_recording(tmp_path / "live-a.csv").pose_windows_s == ((12_345.678, 12_350.678),)


def test_a_name_of_several_lines_stays_in_its_line(tmp_path: Path) -> None:
    with RawFile(tmp_path / "live-a.csv", SourceFacts("other", "a\n# arm_axis: x", 100.0, START)) as raw:
        raw.write(make_frames(FIRST_POSE))

    assert read_recording(tmp_path / "live-a.csv").arm_axis is None


def test_a_session_that_was_cut_is_named_and_keeps_every_row_that_was_written(tmp_path: Path) -> None:
    raw = RawFile(tmp_path / "live-a.csv", HEADER)
    for first, end in ((0, 2000), (2000, 2010)):  # many at once, and few, as they come
        raw.write(FRAMES.cut(first, end))

    (cut,) = find_interrupted_sessions(tmp_path)  # neither synced nor closed, as after a kill
    rows = sum(map(len, read_recording(raw.path).segments))

    raw.close()
    assert (cut.path, rows) == (raw.path, 2010)
    assert cut.elapsed_s == pytest.approx(20.09)


def test_a_torn_last_row_is_left_out(tmp_path: Path) -> None:
    path = tmp_path / "live-a.csv"
    write(path, make_frames(FIRST_POSE))
    path.write_bytes(path.read_bytes()[:-12])

    recording = read_recording(path)

    assert len(recording.segments[0]) == 1199
    assert [flag.code for flag in recording.flags if flag.code == "W-TRUNC-TAIL"] == ["W-TRUNC-TAIL"]


# A recording that is played: at its pace, with its own axis, to the bit.


class Clock:
    """Time that passes only while somebody waits."""

    def __init__(self) -> None:
        self.time_s = 0.0

    def now_s(self) -> float:
        return self.time_s

    def wait(self, seconds: float) -> None:
        self.time_s += seconds


def play(source: ReplaySource) -> list[np.ndarray[tuple[int, ...], np.dtype[np.float32]]]:
    session = LiveSession(source.facts.rate_hz, source.facts.arm_axis)
    shown = []
    while (frames := source.read()) is not None:
        shown.append(session.take(frames).elevation_deg)
    return shown


@pytest.mark.parametrize(("speed", "lasts_s"), [(1.0, 22.0), (20.0, 1.1)])
def test_it_lasts_as_long_as_the_recording_or_a_part_of_it(speed: float, lasts_s: float) -> None:
    clock = Clock()

    play(
        ReplaySource(make_worn(FIRST_POSE, (95.0, 10.0)), "a.csv", speed, now_s=clock.now_s, wait=clock.wait)
    )

    assert clock.time_s == pytest.approx(lasts_s, abs=0.02)


def test_the_angle_is_that_of_live_elevation_on_the_file_to_the_bit() -> None:
    recording = make_worn(FIRST_POSE, (95.0, 10.0), (20.0, 10.0))
    segment, axis, clock = recording.segments[0], find_axis(recording), Clock()
    assert axis is not None

    shown = play(ReplaySource(recording, "a.csv", 5.0, now_s=clock.now_s, wait=clock.wait))

    expected = LiveElevation(recording.rate_hz, axis).update(segment.acc_g, segment.gyr_dps)
    assert np.array_equal(np.concatenate(shown), expected)


def test_a_recording_without_a_usable_pose_has_no_axis() -> None:
    restless = make_worn(*((0.0, 0.6), (95.0, 0.6)) * 10)

    assert find_axis(restless) is None
