"""Sessions that end otherwise than by Stop."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy.exc import OperationalError

from app.errors import TooManySessions
from app.live.hub import Ended, LiveHub, RunningSession, SessionRequest
from app.live.ports import SessionFiles, create_session_files
from app.live.raw_file import Wearer
from app.live.recorder import Recorder
from app.live.sources import SourceFacts
from fusion.live import Frames, replay_frames
from fusion.live.cues import Cue
from fusion.readers import read_recording
from tests.app.live.made import FIRST_POSE, make_worn


class BreakingSource:
    """Frames of 22 s, then an error."""

    facts, early = SourceFacts("other", "made", 100.0), None
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


@dataclass
class Shelf:
    """A library that remembers, or refuses."""

    folder: Path
    error: Exception | None = None
    kept: list[Path] = field(default_factory=list)

    def begin(self) -> SessionFiles:
        return create_session_files(self.folder / "live", keeps=True)

    def keep(self, ended: Ended) -> str:
        if self.error:
            raise self.error
        self.kept.append(ended.files.raw)
        assert count_rows(ended.files) == 2200
        return "an_1"

    def announce(self, session_id: str, cue: Cue) -> None:
        raise AssertionError


def count_rows(files: SessionFiles) -> int:
    with files.raw.open("rb") as file:
        return sum(map(len, read_recording(file, file_name="live.csv").segments))


def run(source: BreakingSource, shelf: Shelf, files: SessionFiles | None = None) -> list[dict[str, Any]]:
    hub = LiveHub(shelf)
    session = hub.start(source, SessionRequest(Wearer(arm_axis="+z")), files or shelf.begin())
    messages: list[dict[str, Any]] = []
    for thread in hub._threads.values():
        thread.join()
    session.watch(lambda message: messages.append(dict(message)))
    return messages


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
@pytest.mark.parametrize("error", [OSError("gone"), ZeroDivisionError()], ids=["source", "bug"])
def test_a_source_that_breaks_leaves_all_that_came_in_the_library_and_no_file(
    tmp_path: Path, error: Exception
) -> None:
    shelf = Shelf(tmp_path)

    messages = run(BreakingSource(error), shelf)

    assert (messages[-1]["state"], messages[-1]["analysis"]) == ("failed", "an_1")
    assert len(shelf.kept) == 1
    assert list((tmp_path / "live").iterdir()) == []


def make_session(folder: Path) -> RunningSession:
    files, source = Shelf(folder).begin(), BreakingSource(OSError())
    recorder = Recorder(files.raw, source.facts)
    return RunningSession(files, source, recorder, SessionRequest())


@pytest.mark.parametrize("comes_back", [True, False], ids=["back", "link lost"])
def test_a_session_to_which_somebody_comes_back_or_whose_link_was_lost_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, comes_back: bool
) -> None:
    monkeypatch.setattr("app.live.hub.CLOSED_TERM_S", -1.0)
    session = make_session(tmp_path)

    session.leave(session.watch(lambda _: None), was_closed=comes_back)
    if comes_back:
        session.watch(lambda _: None)

    assert not session._is_over()
    session.recorder.stop()


def test_a_watch_that_ends_ends_no_other(tmp_path: Path) -> None:
    session = make_session(tmp_path)
    seen: list[str] = []
    first = session.watch(lambda _: None)
    session.watch(lambda message: seen.append(f"second {message['type']}"))
    session.leave(first)
    session.watch(lambda message: seen.append(f"third {message['type']}"))

    session.pause_cues(paused=True)

    session.recorder.stop()
    assert seen[-2:] == ["second cues", "third cues"]


@pytest.mark.parametrize("error", [OSError("full"), OperationalError("", None, OSError("database away"))])
def test_a_raw_file_that_cannot_be_taken_in_stays_for_the_next_start(
    tmp_path: Path, error: Exception
) -> None:
    shelf = Shelf(tmp_path, error)
    files = shelf.begin()

    messages = run(BreakingSource(OSError("gone")), shelf, files)

    assert messages[-1]["analysis"] == ""
    assert count_rows(files) == 2200


def test_more_sessions_than_the_server_runs_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.live.hub.MAX_SESSIONS", 0)
    source = BreakingSource(OSError("gone"))

    with pytest.raises(TooManySessions):
        LiveHub(Shelf(tmp_path)).start(source, SessionRequest(), Shelf(tmp_path).begin())

    assert source.is_closed
