"""``acromion live``: the angle in the terminal, the raw file, the report."""

import json
import re
import signal
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from acromion.app.cli import app
from acromion.app.cli.live import _run, _Screen
from acromion.app.live.ports import EarlyFile
from acromion.app.live.raw_file import RawFile, Wearer, build_session_options
from acromion.app.live.recorder import Recorder
from acromion.app.live.sources import SourceFacts
from acromion.fusion.errors import UnusableTime
from acromion.fusion.live import Frames, replay_frames
from acromion.fusion.readers import read_recording
from acromion.fusion.recording import Recording
from tests.app.live.made import FIRST_POSE, make_worn
from tests.app.live.test_raw_file import HEADER, START
from tests.fusion.live.test_lines import HEADER as COLUMNS
from tests.fusion.live.test_lines import PREAMBLE, write_rows
from tests.ways_in.servers import wait_for

BOARD = PREAMBLE + COLUMNS


Replayed = tuple[int, str, Path]


def write_log(path: Path, recording: Recording, *, stopped: bool = True) -> Path:
    raw = RawFile(path, HEADER)
    for frames in replay_frames(recording, 1e6):
        raw.write(frames)
    if stopped:
        raw.stop(START)
    else:
        raw.close()
    return path


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("log") / "worn.csv"
    return write_log(path, make_worn(FIRST_POSE, (95.0, 10.0), (0.0, 10.0)))


def run(*words: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, ["live", *words])
    return result.exit_code, result.output


@pytest.fixture(scope="module")
def replayed(log: Path, tmp_path_factory: pytest.TempPathFactory) -> Replayed:
    """A replay with cues beside a session that was cut: exit code, output, folder."""
    out = tmp_path_factory.mktemp("replayed")
    write_log(out / "live-20260302-070000.csv", make_worn((0.0, 90.0)), stopped=False)
    code, output = run(str(log), "-o", str(out), "--speed", "20", "--cue", "hold:60:4")
    (out / "live-20260302-070000.csv").unlink()
    return code, output, out


def test_a_replay_ends_with_an_ordinary_report(replayed: Replayed, log: Path) -> None:
    code, output, out = replayed
    (raw,) = (path for path in out.glob("live-*.csv") if "cues" not in path.name)

    assert code == 0
    assert "rises: 1" in output
    assert re.search(r"Live compared with the report, over 29\ss: 0\.\d° \(RMSE\)", output)
    assert json.loads((out / raw.stem / "results.json").read_text())["exposure"]
    assert np.array_equal(read_recording(raw).segments[0].acc_g, read_recording(log).segments[0].acc_g)


def test_a_session_that_was_cut_is_named_with_what_it_holds(replayed: Replayed) -> None:
    assert "live-20260302-070000.csv was cut off" in replayed[1]
    assert "It contains 0:01:30" in replayed[1]


def test_cues_ring_the_bell_and_are_logged_beside_the_raw_file(replayed: Replayed) -> None:
    # Above 60 deg from about 12 s to about 22 s: cues after 4 s and after 8 s.
    (written,) = replayed[2].glob("live-*.cues.csv")

    head, *rows = written.read_text().splitlines()
    assert head == "time_s,kind,angle_deg,limit"
    assert [row.split(",")[1:] for row in rows] == [["hold", "60", "4"]] * 2
    assert len(re.findall(r"Above 60° for 4\ss\.", replayed[1])) == 2


def test_a_file_that_is_not_there_is_said(tmp_path: Path) -> None:
    code, output = run(str(tmp_path / "none.csv"), "-o", str(tmp_path / "out"))

    assert code == 3
    assert "E-FILE" in output
    assert not (tmp_path / "out").exists()


class MadeSource:
    """Frames of a sensor whose axis nobody knows, as fast as they are asked for."""

    facts, early = SourceFacts("other", "made", 100.0), None

    def __init__(self, recording: Recording) -> None:
        self._frames = replay_frames(recording, 0.5)

    def read(self) -> Frames | None:
        return next(self._frames, None)

    def close(self) -> None:
        pass


class StrayingSource(MadeSource):
    """Its board is set to another rate in the end."""

    def read(self) -> Frames | None:
        frames = super().read()
        if frames is None:
            raise UnusableTime(why="rate changed")
        return frames


def test_a_pose_that_is_refused_is_asked_for_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # The arm moves from 6 s to 7 s, in the first window (5 s to 10 s). The chunk in which that ends has its
    # last frame at 10.49 s; the next window begins 5 s after it, while the arm hangs.
    source = MadeSource(make_worn((0.0, 6.0), (95.0, 1.0), (0.0, 20.0)))
    recorder = Recorder(tmp_path / "live-a.csv", source.facts)

    _run(source, recorder, 5.0, "en")

    assert "The arm moved. Try again." in capsys.readouterr().out
    assert read_recording(recorder.path).pose_windows_s == ((15.49, 20.49),)


def test_while_nothing_comes_no_angle_is_shown(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = MadeSource(make_worn((40.0, 20.0)))
    recorder = Recorder(tmp_path / "live-a.csv", source.facts, Wearer(arm_axis="+z"))
    screen = _Screen("en")
    while (frames := source.read()) is not None:
        recorder.take(frames)

    screen.show(recorder.status(), 0.1)
    shown = capsys.readouterr().out
    screen = _Screen("en")
    screen.show(recorder.status(), 7.0)
    silent = capsys.readouterr().out
    recorder.break_off()

    assert re.match(r" *\d+°", shown)
    assert silent.lstrip().startswith("–")
    assert "no samples for 7\xa0s: the angle is not known" in silent


def test_time_without_an_angle_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # 20 s, of which the last 15 s follow the pose.
    source = MadeSource(make_worn((0.0, 20.0)))
    recorder = Recorder(tmp_path / "live-a.csv", source.facts)

    _run(source, recorder, 0.0, "en")

    assert recorder.status().counted_s == pytest.approx(15.0)
    assert "not counted: 5\u202fs" in capsys.readouterr().out


def test_a_board_that_goes_astray_is_said_and_what_came_is_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = StrayingSource(make_worn((0.0, 20.0)))
    recorder = Recorder(tmp_path / "live-a.csv", source.facts)

    _run(source, recorder, 5.0, "en")

    assert "the board now sends at a different rate than at the start" in capsys.readouterr().err
    assert sum(map(len, read_recording(recorder.path).segments)) == 2000


def test_a_disk_that_takes_no_more_is_said(tmp_path: Path, log: Path) -> None:
    # A limit of the size of a file, as a full disk: 256 blocks of 1 KiB.
    command = f"ulimit -f 256; {sys.executable} -m acromion live {log} --speed 20 -o {tmp_path / 'out'}"

    ended = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False)

    assert ended.returncode == 3
    assert "File too large" in ended.stderr
    assert "Traceback" not in ended.stderr


@pytest.mark.parametrize(
    "rule", ["hold", "hold:60", "moon:60:4", "hold:60:x", "hold:200:4", "share:60:-1", "share:60:100"]
)
def test_a_rule_that_cannot_be_is_a_usage_error(log: Path, tmp_path: Path, rule: str) -> None:
    code, output = run(str(log), "-o", str(tmp_path / "out"), "--cue", rule)

    assert code == 2
    assert "hold:60:10" in output


@pytest.fixture
def udp_port() -> int:
    """A port of this machine that nobody listens to."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])


def send_rows(udp_port: int, out: Path, *texts: str) -> None:
    """Send the lines of a board, a datagram each, once somebody listens."""
    wait_for(lambda: any(out.glob("live-*.early")))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as board:
        for text in texts:
            board.sendto(text.encode(), ("127.0.0.1", udp_port))


def test_rows_that_a_kill_found_before_their_rate_was_known_are_a_raw_file_at_the_next_start(
    tmp_path: Path,
) -> None:
    early = EarlyFile(
        tmp_path / "live-20260302-070000.early", build_session_options("board", Wearer(arm_axis="+z"), ())
    )
    early.write((BOARD + write_rows(0, 150)).encode(), 1_770_000_000.0)
    early.close()

    _, output = run(str(tmp_path / "none.csv"), "-o", str(tmp_path))

    (raw,) = tmp_path.glob("live-*-early.csv")
    found = read_recording(raw)
    assert f"{raw.name} was cut off" in output
    assert (sum(map(len, found.segments)), found.arm_axis) == (150, "+z")
    assert list(tmp_path.glob("*.early")) == []


def test_once_the_raw_file_has_the_rows_they_are_kept_no_second_time(tmp_path: Path, udp_port: int) -> None:
    out = tmp_path / "out"
    command = [
        sys.executable,
        "-m",
        "acromion",
        "live",
        f"udp://127.0.0.1:{udp_port}",
        "-o",
        str(out),
        "--axis",
        "z",
    ]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as running:
        send_rows(udp_port, out, BOARD, *(write_rows(k, k + 100) for k in range(0, 1500, 100)))
        wait_for(lambda: not any(out.glob("*.early")))
        running.send_signal(signal.SIGTERM)

    (raw,) = out.glob("live-*.csv")
    assert len(re.findall(r"^\d+,", raw.read_text(), re.MULTILINE)) == 1500
