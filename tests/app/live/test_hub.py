"""Sessions that end otherwise than by Stop."""

from pathlib import Path
from typing import Any

import pytest

from app.errors import TooManySessions
from app.live.hub import Ended, LiveHub, RunningSession, SessionRequest
from app.live.raw_file import Wearer
from app.live.recorder import Recorder
from app.live.source import SourceFacts
from fusion.live import Frames, replay_frames
from fusion.live.cues import Cue
from fusion.readers import read_recording
from tests.app.live.made import FIRST_POSE, make_worn


class BreakingSource:
    """Frames of 22 s, then an error."""

    facts = SourceFacts("other", "made", 100.0)
    is_closed = False

    def __init__(self, error: Exception) -> None:
        self._frames = replay_frames(make_worn(FIRST_POSE, (95.0, 10.0)), 1.0)
        self._error = error

    def read(self) -> Frames | None:
        frames = next(self._frames, None)
        if frames is None:
            raise self._error
        return frames

    def close(self) -> None:
        self.is_closed = True


class Shelf:
    """A library that remembers, or refuses."""

    def __init__(self, error: Exception | None = None) -> None:
        self.kept: list[Path] = []
        self._error = error

    def keep(self, ended: Ended) -> str:
        if self._error:
            raise self._error
        self.kept.append(ended.path)
        assert sum(map(len, read_recording(ended.path).segments)) == 2200
        return "an_1"

    def announce(self, session_id: str, cue: Cue) -> None:
        raise AssertionError


def run(folder: Path, source: BreakingSource, shelf: Shelf) -> list[dict[str, Any]]:
    hub = LiveHub(folder / "live", shelf)
    session = hub.start(source, SessionRequest(Wearer(arm_axis="+z")))
    messages: list[dict[str, Any]] = []
    for thread in hub._threads.values():
        thread.join()
    session.watch(lambda message: messages.append(dict(message)))
    return messages


def test_a_source_that_breaks_leaves_all_that_came(tmp_path: Path) -> None:
    shelf = Shelf()

    messages = run(tmp_path, BreakingSource(OSError("gone")), shelf)

    assert messages[-1] == {"type": "ended", "state": "failed", "analysis": "an_1", "cues": 0}
    assert len(shelf.kept) == 1


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_bug_ends_its_own_session_and_loses_nothing(tmp_path: Path) -> None:
    messages = run(tmp_path, BreakingSource(ZeroDivisionError()), Shelf())

    assert messages[-1]["state"] == "failed"


def test_a_watch_that_ends_ends_no_other(tmp_path: Path) -> None:
    source = BreakingSource(OSError("gone"))
    recorder = Recorder(tmp_path / "live-a.csv", source.facts)
    session = RunningSession("a", source, recorder, SessionRequest())
    seen: list[str] = []
    first = session.watch(lambda _: None)
    session.watch(lambda message: seen.append(f"second {message['type']}"))
    session.leave(first)
    session.watch(lambda message: seen.append(f"third {message['type']}"))

    session.pause_cues(paused=True)

    recorder.stop()
    assert seen[-2:] == ["second cues", "third cues"]


def test_a_raw_file_that_cannot_be_taken_in_stays_for_the_next_start(tmp_path: Path) -> None:
    messages = run(tmp_path, BreakingSource(OSError("gone")), Shelf(OSError("full")))

    assert messages[-1]["analysis"] == ""
    (raw,) = (tmp_path / "live").glob("live-*.csv")
    assert sum(map(len, read_recording(raw).segments)) == 2200


def test_more_sessions_than_the_server_runs_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.live.hub.MOST_SESSIONS", 0)
    source = BreakingSource(OSError("gone"))

    with pytest.raises(TooManySessions):
        LiveHub(tmp_path / "live", Shelf()).start(source, SessionRequest())

    assert source.is_closed
