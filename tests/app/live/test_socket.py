"""Live sessions over the WebSocket: what is sent, what is taken, and whose calls are refused."""

import json
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fastapi.testclient import TestClient
from sqlalchemy import Row, select
from starlette.testclient import WebSocketTestSession
from starlette.websockets import WebSocketDisconnect

from acromion.app.http.api.live import LIVE_FOLDER, _find_limiter
from acromion.app.library.database.tables import audit_log, deliveries, recordings
from acromion.app.library.jobs import JobStore
from acromion.app.live.ports import SerialPort, create_session_files
from acromion.app.live.raw_file import RawFile, Wearer
from acromion.app.live.recorder import Recorder
from acromion.app.live.sources import SourceFacts
from acromion.app.main import create_app
from acromion.app.settings import Settings
from acromion.app.store.server_secret import ServerSecret
from acromion.fusion.live import LiveElevation, replay_frames
from acromion.fusion.live.cues import CueRule
from acromion.fusion.recording import Recording
from tests.app.live.made import FIRST_POSE, count_stored_rows, make_worn
from tests.app.live.test_ports import Board
from tests.app.live.test_raw_file import START
from tests.fusion.live.test_lines import HEADER, PREAMBLE, write_rows
from tests.ways_in.servers import wait_for

ADDRESS = "/api/v1/live"
DAY = (FIRST_POSE, (95.0, 10.0), (0.0, 10.0))


def write_raw(path: Path, recording: Recording, wearer: Wearer) -> None:
    with RawFile(path, SourceFacts("other", "made", 100.0, START), wearer) as raw:
        for frames in replay_frames(recording, 1e6):
            raw.write(frames)


@pytest.fixture(scope="module")
def settings(tmp_path_factory: pytest.TempPathFactory) -> Settings:
    """Settings of one server for all tests, which no test stops."""
    return Settings(data_dir=tmp_path_factory.mktemp("live") / "data", min_free_bytes=0)


@pytest.fixture(scope="module")
def client(settings: Settings) -> Iterator[TestClient]:
    with TestClient(create_app(settings), base_url="http://localhost:8080") as caller:
        yield caller


@pytest.fixture(scope="module")
def store(client: TestClient) -> JobStore:
    found: JobStore = client.app.state.services.store  # type: ignore[attr-defined]
    return found


def upload_worn(client: TestClient, folder: Path) -> str:
    write_raw(folder / "worn.csv", make_worn(*DAY), Wearer())
    content = (folder / "worn.csv").read_bytes()
    return str(client.post("/api/v1/recordings?file_name=worn.csv", content=content).json()["id"])


@pytest.fixture(scope="module")
def recording_id(client: TestClient, tmp_path_factory: pytest.TempPathFactory) -> str:
    return upload_worn(client, tmp_path_factory.mktemp("worn"))


@contextmanager
def connect(client: TestClient, **first: Any) -> Iterator[WebSocketTestSession]:
    with client.websocket_connect(f"ws://localhost:8080{ADDRESS}") as socket:
        socket.send_json(first)
        yield socket


def ask_for(recording_id: str, speed: int = 1, **asked: Any) -> dict[str, Any]:
    return {"type": "start", "source": "recording", "recording": recording_id, "speed": speed, **asked}


def read_to_end(socket: WebSocketTestSession) -> list[dict[str, Any]]:
    messages: list[dict[str, Any]] = []
    while not messages or messages[-1]["type"] not in ("ended", "problem"):
        messages.append(socket.receive_json())
    return messages


def read_until(socket: WebSocketTestSession, kind: str) -> dict[str, Any]:
    while (message := socket.receive_json())["type"] != kind:
        pass
    return dict(message)


def read_frames(socket: WebSocketTestSession, frames: int) -> dict[str, Any]:
    """Return the first message after so many frames; the one before may be the history."""
    while (message := socket.receive_json())["status"]["frames"] < frames:
        pass
    return dict(message)


def stop(socket: WebSocketTestSession) -> dict[str, Any]:
    socket.send_json({"type": "stop"})
    return read_until(socket, "ended")


def list_recordings(client: TestClient) -> list[dict[str, Any]]:
    items: list[dict[str, Any]] = client.get("/api/v1/recordings").json()["items"]
    return items


def read_trail(store: JobStore, session: str) -> list[Row[Any]]:
    """Return the lines of the audit log about a session."""
    about = audit_log.c.other == json.dumps({"session": session})
    with store.engine.connect() as connection:
        return list(connection.execute(select(audit_log).where(about).order_by(audit_log.c.seq)))


@dataclass
class Played:
    """A session from its start to its end, and what was stored when it ended."""

    messages: list[dict[str, Any]]
    added: list[dict[str, Any]]

    @property
    def updates(self) -> list[dict[str, Any]]:
        return [message for message in self.messages if message["type"] == "update"]


def play(client: TestClient, recording_id: str, **asked: Any) -> Played:
    before = list_recordings(client)
    with connect(client, **ask_for(recording_id, 20, **asked)) as socket:
        messages = read_to_end(socket)
    return Played(messages, [one for one in list_recordings(client) if one not in before])


# --- a replay of which nothing is kept ------------------------------------------------------------------


@pytest.fixture(scope="module")
def replayed(client: TestClient, recording_id: str) -> Played:
    return play(client, recording_id)


def test_a_replay_sends_its_description_its_angles_and_its_end(replayed: Played) -> None:
    first, history, *updates, last = replayed.messages

    assert (first["type"], first["source"], first["rate_hz"]) == ("session", "worn.csv", 100.0)
    assert (history["type"], history["points"]) == ("history", [])
    assert {update["type"] for update in updates} == {"update"}  # no cues without rules
    assert [update["sequence"] for update in updates] == list(range(1, len(updates) + 1))
    assert (last["type"], last["state"]) == ("ended", "stopped")
    assert updates[-1]["status"]["rises"] == 1
    assert updates[-1]["status"]["above_s"][1] == pytest.approx(10.0, abs=0.5)
    assert updates[-1]["status"]["lost"] == 0


def test_the_angles_sent_are_those_of_live_elevation_fifty_times_a_second(replayed: Played) -> None:
    points = [point for update in replayed.updates for point in update["points"]]

    segment = make_worn(*DAY).segments[0]
    axis = segment.acc_g[500:1000].mean(axis=0, dtype=np.float64)
    expected = LiveElevation(100.0, axis / np.linalg.norm(axis)).update(segment.acc_g, segment.gyr_dps)
    assert [time_s for time_s, _ in points] == pytest.approx(np.arange(0.0, 32.0, 0.02))
    assert points[0][1] is None
    assert [angle for _, angle in points[150:]] == pytest.approx(expected[300::2], abs=0.5)


def test_a_replay_adds_no_recording_no_file_and_only_its_start_to_the_trail(
    replayed: Played, settings: Settings, store: JobStore
) -> None:
    session = replayed.messages[0]["session"]

    assert replayed.added == []
    assert list((settings.data_dir / LIVE_FOLDER).glob(f"*{session}*")) == []
    assert [line.act for line in read_trail(store, session)] == ["live.started"]


def test_the_end_of_a_session_is_still_told_after_a_lost_link(client: TestClient, replayed: Played) -> None:
    with connect(client, type="resume", session=replayed.messages[0]["session"]) as socket:
        assert read_until(socket, "ended")["state"] == "stopped"


# --- a replay that is kept, with cues -------------------------------------------------------------------


HOLD = {"kind": "hold", "angle_deg": 60, "limit": 4}


@pytest.fixture(scope="module")
def webhook_id(client: TestClient, settings: Settings) -> str:
    """The webhook that asks for cues, beside one that does not."""
    hooks = client.app.state.services.webhooks  # type: ignore[attr-defined]
    server = ServerSecret(settings.data_dir)
    hooks.add("https://hooks.example/ends", ("analysis.finished",), server)
    return str(hooks.add("https://hooks.example/cues", ("live.cue",), server).id)


@pytest.fixture(scope="module")
def kept(client: TestClient, recording_id: str, webhook_id: str) -> Played:
    return play(client, recording_id, keeps=True, subject="S012", side="right", cues=[HOLD])


def test_what_is_kept_becomes_an_ordinary_recording_with_an_analysis(
    client: TestClient, kept: Played
) -> None:
    (recording,) = kept.added

    assert (recording["subject"], recording["side"]) == ("S012", "right")
    analysis = client.get(f"/api/v1/analyses/{kept.messages[-1]['analysis']}").json()
    assert analysis["state"] == "queued"


def test_cues_are_sent_counted_and_noted(kept: Played) -> None:
    # The arm is above 60 deg from about 12 s to about 22 s: cues after 4 s and after 8 s.
    cues = [message for message in kept.messages if message["type"] == "cue"]

    assert [round(cue["time_s"]) for cue in cues] == [16, 20]
    assert (cues[0]["kind"], cues[0]["limit"]) == ("hold", 4)
    assert kept.messages[-1]["cues"] == 2
    assert kept.added[0]["note"] == "cues hold:60:4: 2; s: 16 20"


def test_cues_are_announced_to_the_webhooks_that_ask_for_them(
    kept: Played, store: JobStore, webhook_id: str
) -> None:
    with store.engine.connect() as connection:
        rows = connection.execute(select(deliveries.c.event, deliveries.c.webhook_id)).all()

    assert [tuple(row) for row in rows] == [("live.cue", webhook_id)] * kept.messages[-1]["cues"]


def test_a_webhook_that_names_no_events_is_told_of_no_cues(client: TestClient, kept: Played) -> None:
    made = client.post("/api/v1/webhooks", json={"url": "https://1.1.1.1/all"}).json()

    assert made["events"] == ["analysis.finished", "batch.finished"]


def test_the_trail_tells_who_started_a_session_and_what_became_of_it(
    kept: Played, recording_id: str, store: JobStore
) -> None:
    started, ended = read_trail(store, kept.messages[0]["session"])

    assert (started.act, started.recording_id) == ("live.started", recording_id)
    analysis = kept.messages[-1]["analysis"]
    told = (ended.act, ended.recording_id, ended.analysis_id, ended.who)
    assert told == ("live.ended", kept.added[0]["id"], analysis, started.who)


# --- moments that the person marks ----------------------------------------------------------------------


def test_a_marked_moment_becomes_a_row_of_the_diary(
    client: TestClient, recording_id: str, store: JobStore
) -> None:
    with connect(client, **ask_for(recording_id, keeps=True)) as socket:
        read_until(socket, "history")
        shown_s = read_frames(socket, 200)["status"]["elapsed_s"]
        socket.send_json({"type": "mark", "label": "pain"})
        mark = read_until(socket, "mark")
        analysis = stop(socket)["analysis"]

    assert (mark["label"], mark["count"]) == ("pain", 1)
    assert mark["time_s"] >= shown_s > 0
    (row,) = store.get(analysis).request.diary
    assert (row.start, row.kind, row.label) == (mark["time_s"], "mark", "pain")
    recording = store.find_recording(analysis)
    (kept,) = client.get(f"/api/v1/recordings/{recording}/periods").json()
    assert (kept["start_s"], kept["kind"]) == (mark["time_s"], "mark")


def test_a_replay_that_is_not_kept_has_no_marks(client: TestClient, recording_id: str) -> None:
    with connect(client, **ask_for(recording_id)) as socket:
        read_until(socket, "update")
        socket.send_json({"type": "mark"})
        socket.send_json({"type": "stop"})
        messages = read_to_end(socket)

    assert "mark" not in {message["type"] for message in messages}


# --- while a session runs -------------------------------------------------------------------------------


def test_a_pose_is_asked_for_again_and_the_clock_is_told(client: TestClient, recording_id: str) -> None:
    with connect(client, **ask_for(recording_id)) as socket:
        socket.send_json({"type": "ping", "sent_ms": 12.5})
        pong = read_until(socket, "pong")
        socket.send_json({"type": "pose", "countdown_s": 30})
        while (update := read_until(socket, "update"))["status"]["pose"] != "countdown":
            pass
        stop(socket)

    assert 28 < update["status"]["pose_left_s"] <= 30
    assert pong["sent_ms"] == 12.5
    assert pong["server_s"] > 0


def test_two_sessions_do_not_touch_each_other(client: TestClient, recording_id: str) -> None:
    with connect(client, **ask_for(recording_id)) as one:
        one_id = one.receive_json()["session"]
        *_, last, _end = play(client, recording_id).messages
        stop(one)

    assert last["status"]["frames"] == 3200
    assert one_id not in {last.get("session")}


@pytest.mark.parametrize(
    ("first", "code"),
    [
        ({"type": "start", "source": "moon"}, "E-PARAMETER"),
        ({"type": "start", "source": "demo", "speed": 21}, "E-PARAMETER"),
        ({"type": "start", "source": "recording", "recording": "rec_none"}, "E-NOT-FOUND"),
        ({"type": "start", "source": "port", "port": "/dev/zero", "keeps": True}, "E-LIVE-SOURCE"),
        ({"type": "resume", "session": "none"}, "E-NOT-FOUND"),
    ],
)
def test_what_cannot_be_is_refused_in_words(client: TestClient, first: dict[str, Any], code: str) -> None:
    with connect(client, **first) as socket:
        problem = socket.receive_json()

        assert (problem["type"], problem["code"]) == ("problem", code)
        assert problem["fix"]
        assert "speed" not in first or problem["detail"].startswith(
            "The value of start.speed is not allowed: 21"
        )
        with pytest.raises(WebSocketDisconnect):
            socket.receive_json()


def test_a_message_that_is_no_message_ends_the_connection_not_the_session(
    client: TestClient, recording_id: str
) -> None:
    with connect(client, **ask_for(recording_id)) as socket:
        session = socket.receive_json()["session"]
        socket.send_text("{")
        read_until(socket, "problem")

    with connect(client, type="resume", session=session) as socket:
        assert socket.receive_json()["state"] == "running"
        stop(socket)


def test_a_message_that_is_too_long_in_coming_ends_the_connection(
    client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("acromion.app.http.api.live.FIRST_LIMIT_S", 0.05)
    with client.websocket_connect(f"ws://localhost:8080{ADDRESS}") as socket:
        assert socket.receive_json()["code"] == "E-PARAMETER"


@pytest.mark.parametrize(
    "headers",
    [{"origin": "https://evil.example"}, {"host": "evil.example"}, {"sec-fetch-site": "cross-site"}],
)
def test_another_site_gets_no_socket(client: TestClient, headers: dict[str, str]) -> None:
    with (
        pytest.raises(WebSocketDisconnect),
        client.websocket_connect(f"ws://localhost:8080{ADDRESS}", headers=headers),
    ):
        pass


def test_while_paused_there_are_no_cues(client: TestClient, recording_id: str) -> None:
    with connect(client, **ask_for(recording_id, 20, cues=[HOLD])) as socket:
        socket.send_json({"type": "cues", "paused": True})
        assert read_until(socket, "cues")["paused"]
        messages = read_to_end(socket)

    assert messages[-1]["cues"] == 0


# --- a stop of the server, and a kill -------------------------------------------------------------------


@pytest.fixture
def fresh(tmp_path: Path) -> Settings:
    """Settings of a server that a test starts and stops."""
    return Settings(data_dir=tmp_path / "data", min_free_bytes=0)


def test_what_a_kill_left_of_a_session_becomes_a_recording_whose_end_is_in_the_trail(fresh: Settings) -> None:
    files = create_session_files(fresh.data_dir / LIVE_FOLDER, keeps=True)
    rules, wearer = (CueRule("hold", 60.0, 10.0),), Wearer("S007", "left")
    recorder = Recorder(files.raw, SourceFacts("other", "made", 100.0), wearer, rules)
    for frames in replay_frames(make_worn(*DAY), 1.0):
        recorder.take(frames)
    recorder.break_off()
    files.marks.write_text('{"time_s": 4.5, "label": "pain"}\n{"time_s": 9', "utf-8")

    with TestClient(create_app(fresh), base_url="http://localhost:8080") as caller:
        (recording,) = list_recordings(caller)
        store: JobStore = caller.app.state.services.store  # type: ignore[attr-defined]
        (line,) = read_trail(store, files.session_id)
        of_analysis = store.find_recording(line.analysis_id)
        marks = store.get(line.analysis_id).request.diary
        with store.engine.connect() as connection:
            tags = connection.execute(select(recordings.c.tags)).scalars().all()

    assert (recording["subject"], recording["side"], tags) == ("S007", "left", ['["cues"]'])
    assert count_stored_rows(fresh, recording["id"]) == 3200
    assert [(mark.start, mark.kind, mark.label) for mark in marks] == [(4.5, "mark", "pain")]
    assert list(files.folder.iterdir()) == []
    assert (line.act, line.who, line.recording_id) == ("live.ended", "system", recording["id"])
    assert of_analysis == recording["id"]


def test_a_server_that_stops_makes_recordings_of_its_sessions(fresh: Settings, tmp_path: Path) -> None:
    application = create_app(fresh)
    with TestClient(application, base_url="http://localhost:8080") as caller:
        with connect(caller, **ask_for(upload_worn(caller, tmp_path), keeps=True)) as socket:
            read_until(socket, "update")
        hub = application.state.services.live

    with TestClient(create_app(fresh), base_url="http://localhost:8080") as caller:
        assert len(list_recordings(caller)) == 2
    assert [session.state for session in hub._sessions.values()] == ["stopped"]


# --- a board --------------------------------------------------------------------------------------------


@pytest.fixture
def board(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Board]:
    """A board on a serial port; it writes 1,500 rows once its port is open, which drops earlier ones."""
    made, opening = Board(tmp_path), SerialPort.__init__
    monkeypatch.setattr("acromion.app.http.api.live.find_serial_ports", lambda: (str(made.path),))
    writing: list[threading.Thread] = []

    def open_and_write(port: SerialPort, name: str, baud: int = 115_200) -> None:
        opening(port, name, baud)
        writing.append(made.write_meanwhile(PREAMBLE + HEADER + write_rows(0, 1500)))

    monkeypatch.setattr(SerialPort, "__init__", open_and_write)
    yield made
    writing[0].join()
    made.unplug()


def test_a_board_on_a_serial_port_becomes_a_recording(client: TestClient, board: Board) -> None:
    asked = {"type": "start", "source": "port", "port": str(board.path), "keeps": True, "axis": "+z"}
    with connect(client, **asked) as socket:
        session = socket.receive_json()
        read_frames(socket, 1500)
        ended = stop(socket)

    assert (session["device"], session["keeps"]) == ("lsm9ds1", True)
    assert client.get(f"/api/v1/analyses/{ended['analysis']}").json()["state"] == "queued"


def test_a_page_that_is_closed_while_the_server_reads_a_port_ends_the_session_with_its_report(
    client: TestClient, board: Board, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("acromion.app.live.hub.CLOSED_TERM_S", 0.1)
    asked = {"type": "start", "source": "port", "port": str(board.path), "keeps": True, "axis": "+z"}
    with connect(client, **asked) as socket:
        session = socket.receive_json()["session"]
        read_frames(socket, 1500)

    hub = client.app.state.services.live  # type: ignore[attr-defined]
    analysis = wait_for(lambda: hub.get(session).analysis_id)

    assert client.get(f"/api/v1/analyses/{analysis}").json()["state"] == "queued"
    with connect(client, type="resume", session=session) as socket:
        assert read_until(socket, "ended")["was_left"]


def test_lines_go_on_after_a_lost_link_and_what_is_missing_is_a_hole(client: TestClient) -> None:
    with connect(client, type="start", source="lines", name="phone", axis="+z") as socket:
        socket.send_bytes((HEADER + write_rows(0, 300)).encode())
        session = socket.receive_json()["session"]
    with connect(client, type="resume", session=session) as socket:
        assert socket.receive_json()["state"] == "running"
        socket.send_bytes(write_rows(400, 500).encode())
        message = read_frames(socket, 400)
        stop(socket)

    assert (message["status"]["lost"], message["status"]["holes"]) == (100, 1)


def test_lines_without_a_header_are_refused_in_words_and_leave_no_file(
    client: TestClient, settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("acromion.app.live.ports.LEARN_LIMIT_S", 0.2)
    with connect(client, type="start", source="lines", name="phone", keeps=True) as socket:
        socket.send_bytes(b"1,2,3,4,5,6,7\n")

        assert read_until(socket, "problem")["code"] == "E-LIVE-SOURCE"

    assert list((settings.data_dir / LIVE_FOLDER).glob("*.early")) == []


def test_boards_that_are_silent_hold_up_no_other_request(
    client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("acromion.app.live.ports.LEARN_LIMIT_S", 600.0)
    silent = 45  # more than the threads that answer requests
    with ExitStack() as sockets:
        for _ in range(silent):
            sockets.enter_context(connect(client, type="start", source="lines", name="silent"))
        while count_starting(client) < silent:
            pass
        client.get("/healthz")

        assert count_starting(client) == silent
        monkeypatch.setattr("acromion.app.live.ports.LEARN_LIMIT_S", 0.0)


def count_starting(client: TestClient) -> int:
    assert client.portal is not None
    return int(client.portal.call(lambda: _find_limiter().borrowed_tokens))
