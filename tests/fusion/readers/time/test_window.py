"""Cut a decoded recording to a window of clock time."""

from dataclasses import replace
from datetime import datetime

import numpy as np
import pytest

from acromion.fusion.clocks import ShiftWindow, parse_interval
from acromion.fusion.errors import UnusableShift
from acromion.fusion.readers.time.window import cut_recording
from acromion.fusion.recording import QualityFlag, Recording, Segment, Span, cut_windows

START = datetime.fromisoformat("2026-03-02T06:59:50-05:00")


def make_recording() -> Recording:
    """Return 60 s at 10 Hz with a hole from 30 to 40 s; each sample holds its own number."""
    numbers = np.arange(600, dtype=np.float32)
    samples = np.stack([numbers, numbers, numbers], axis=1)
    segments = tuple(
        Segment(first * 100_000, 10.0, samples[first:stop], samples[first:stop])
        for first, stop in ((0, 300), (400, 600))
    )
    flags = (
        QualityFlag("W-CLIP", 1, 2.0, 5.0, 7.0, spans_s=((5.0, 7.0),)),
        QualityFlag("W-CLIP", 1, 4.0, 18.0, 22.0, spans_s=((18.0, 22.0),)),
        QualityFlag("W-TZ"),
    )
    return Recording(
        "other", "ab", START, None, 60_000_000, segments, (Span(30_000_000, 5_000_000, "docked"),), flags
    )


def cut(window: str) -> Recording:
    return cut_recording(make_recording(), parse_interval(window))


def test_the_samples_of_the_window_are_kept_from_its_first_on() -> None:
    shift = cut("2026-03-02T07:00:00/2026-03-02T07:00:35")

    assert [(s.start_s, s.acc_g[0, 0], s.acc_g[-1, 0]) for s in shift.segments] == [
        (0.0, 100.0, 299.0),
        (30.0, 400.0, 449.0),
    ]
    assert (shift.start, shift.duration_us) == (
        datetime.fromisoformat("2026-03-02T07:00:00-05:00"),
        35_000_000,
    )
    assert shift.sha256 == "ab"


def test_a_window_that_begins_in_a_hole_starts_at_the_next_sample() -> None:
    shift = cut("2026-03-02T07:00:26/2026-03-02T08:00:00")

    assert (shift.start, shift.duration_us) == (
        datetime.fromisoformat("2026-03-02T07:00:30-05:00"),
        20_000_000,
    )


def test_excluded_time_and_caveats_move_with_the_window() -> None:
    shift = cut("2026-03-02T07:00:10/2026-03-02T07:00:35")

    assert shift.excluded == (Span(10_000_000, 5_000_000, "docked"),)
    flags = {flag.code: flag for flag in shift.flags}
    assert set(flags) == {"W-CLIP", "W-TZ", "W-GAP"}
    assert flags["W-CLIP"].spans_s == ((0.0, 2.0),)  # 18 to 22 s of the recording, from second 20 on
    assert flags["W-CLIP"].seconds == 2.0
    assert flags["W-GAP"].spans_s == ((15.0, 20.0),)


def test_a_window_around_the_recording_changes_nothing() -> None:
    recording = make_recording()

    assert cut_recording(recording, parse_interval("2026-03-02T00:00/2026-03-03T00:00")) is recording


@pytest.mark.parametrize(
    ("start", "window", "why"),
    [
        (START, "2026-03-02T09:00/2026-03-02T10:00", "no samples"),
        (START, "2026-03-02T07:00:21/2026-03-02T07:00:29", "no samples"),
        (None, "2026-03-02T09:00/2026-03-02T10:00", "no clock"),
    ],
    ids=["outside", "in the hole", "without a clock"],
)
def test_a_window_that_cannot_be_cut_is_refused(start: datetime | None, window: str, why: str) -> None:
    with pytest.raises(UnusableShift) as refusal:
        cut_recording(replace(make_recording(), start=start), parse_interval(window))

    assert refusal.value.facts["why"] == why


@pytest.mark.parametrize("text", ["", "07:00-15:30", "2026-03-02T07:00", "2026-03-02T07:00/2026-03-02T07:00"])
def test_what_is_no_interval_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"."):
        parse_interval(text)


def test_a_window_is_written_as_it_is_read() -> None:
    window = ShiftWindow(START, START.replace(hour=15))

    assert parse_interval(str(window)) == window
    assert str(window) == "2026-03-02T06:59:50-05:00/2026-03-02T15:59:50-05:00"


def test_pose_windows_inside_a_stretch_count_from_its_start() -> None:
    assert cut_windows([(5.0, 15.0), (65.0, 75.0), (95.0, 105.0)], 60_000_000, 100_000_000) == ((5.0, 15.0),)
