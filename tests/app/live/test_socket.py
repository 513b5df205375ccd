"""Live sessions over the WebSocket: what is sent, what is taken, and whose calls are refused."""

import json
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fastapi.testclient import TestClient
from sqlalchemy import Row, select
from starlette.testclient import WebSocketTestSession
from starlette.websockets import WebSocketDisconnect

from app.api.live import LIVE_FOLDER, _find_limiter, find_hub
from app.jobs.database.tables import audit_log, deliveries, recordings
from app.jobs.store import JobStore
from app.live.ports import SerialPort, SessionFiles, begin_files
from app.live.raw_file import RawFile, Wearer
from app.live.recorder import Recorder
from app.live.sources import SourceFacts
from app.main import create_app
from app.settings import Settings
from app.storage.server_secret import ServerSecret
from app.storage.store import Storage
from fusion.live import LiveElevation, replay_frames
from fusion.live.cues import CueRule
from fusion.recording import Recording
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


@pytest.fixture
def recording_id(client: TestClient, tmp_path: Path) -> str:
    write_raw(tmp_path / "worn.csv", make_worn(*DAY), Wearer())
    answer = client.post(
        "/api/v1/recordings?file_name=worn.csv", content=(tmp_path / "worn.csv").read_bytes()
    )
    return str(answer.json()["id"])


@contextmanager
def connect(client: TestClient, **first: Any) -> Iterator[WebSocketTestSession]:
    with client.websocket_connect(f"ws://localhost:8080{ADDRESS}") as socket:
        socket.send_json(first)
        yield socket


def play(client: TestClient, recording_id: str, **asked: Any) -> list[dict[str, Any]]:
    first = {"type": "start", "source": "recording", "recording": recording_id, "speed": 20, **asked}
    with connect(client, **first) as socket:
        return read_to_end(socket)


def read_to_end(socket: WebSocketTestSession) -> list[dict[str, Any]]:
    messages: list[dict[str, Any]] = []
    while not messages or messages[-1]["type"] not in ("ended", "problem"):
        messages.append(socket.receive_json())
    return messages


def read_until(socket: WebSocketTestSession, kind: str) -> dict[str, Any]:
    while (message := socket.receive_json())["type"] != kind:
        pass
    return dict(message)


def test_a_replay_sends_its_description_its_angles_and_its_end(client: TestClient, recording_id: str) -> None:
    first, history, *updates, last = play(client, recording_id)

    assert (first["type"], first["source"], first["rate_hz"]) == ("session", "worn.csv", 100.0)
    assert (history["type"], history["points"]) == ("history", [])
    assert {update["type"] for update in updates} == {"update"}
    assert (last["type"], last["state"]) == ("ended", "stopped")
    assert updates[-1]["status"]["rises"] == 1
    assert updates[-1]["status"]["above_s"][1] == pytest.approx(10.0, abs=0.5)
    assert updates[-1]["status"]["lost"] == 0


def test_the_angles_sent_are_those_of_live_elevation_fifty_times_a_second(
    client: TestClient, recording_id: str
) -> None:
    updates = [message for message in play(client, recording_id) if message["type"] == "update"]

    points = [point for update in updates for point in update["points"]]
    segment = make_worn(*DAY).segments[0]
    axis = segment.acc_g[500:1000].mean(axis=0, dtype=np.float64)
    expected = LiveElevation(100.0, axis / np.linalg.norm(axis)).update(segment.acc_g, segment.gyr_dps)
    assert [time_s for time_s, _ in points] == pytest.approx(np.arange(0.0, 32.0, 0.02))
    assert points[0][1] is None
    assert [angle for _, angle in points[150:]] == pytest.approx(expected[300::2], abs=0.5)


def test_the_messages_are_numbered(client: TestClient, recording_id: str) -> None:
    updates = [message for message in play(client, recording_id) if message["type"] == "update"]

    assert [update["sequence"] for update in updates] == list(range(1, len(updates) + 1))


def test_a_replay_adds_no_recording(client: TestClient, recording_id: str, settings: Settings) -> None:
    play(client, recording_id)

    assert len(client.get("/api/v1/recordings").json()["items"]) == 1
    assert list((settings.data_dir / LIVE_FOLDER).iterdir()) == []


def test_what_is_kept_becomes_an_ordinary_recording(client: TestClient, recording_id: str) -> None:
    *_, last = play(client, recording_id, keeps=True, subject="S012", side="right")

    analysis = client.get(f"/api/v1/analyses/{last['analysis']}").json()
    recordings = client.get("/api/v1/recordings").json()["items"]
    assert analysis["state"] == "queued"
    assert {one["subject"] for one in recordings} == {"", "S012"}


def test_a_session_goes_on_after_a_lost_link(client: TestClient, recording_id: str) -> None:
    first = {"type": "start", "source": "recording", "recording": recording_id, "speed": 1}
    with connect(client, **first) as socket:
        session = socket.receive_json()["session"]
        read_until(socket, "update")
    with connect(client, type="resume", session=session) as socket:
        again, history = socket.receive_json(), socket.receive_json()
        socket.send_json({"type": "stop"})
        ended = read_until(socket, "ended")

    assert again["session"] == session
    assert history["points"][0][0] == 0.0
    assert ended["state"] == "stopped"


def test_the_end_of_a_session_is_still_told_after_a_lost_link(client: TestClient, recording_id: str) -> None:
    first, *_ = play(client, recording_id)

    with connect(client, type="resume", session=first["session"]) as socket:
        assert read_until(socket, "ended")["state"] == "stopped"


def test_a_pose_is_asked_for_again(client: TestClient, recording_id: str) -> None:
    first = {"type": "start", "source": "recording", "recording": recording_id, "speed": 1}
    with connect(client, **first) as socket:
        read_until(socket, "update")
        socket.send_json({"type": "pose", "countdown_s": 30})
        while (update := read_until(socket, "update"))["status"]["pose"] != "countdown":
            pass
        socket.send_json({"type": "stop"})
        read_until(socket, "ended")

    assert 28 < update["status"]["pose_left_s"] <= 30


def test_the_clock_is_told(client: TestClient, recording_id: str) -> None:
    first = {"type": "start", "source": "recording", "recording": recording_id, "speed": 1}
    with connect(client, **first) as socket:
        socket.send_json({"type": "ping", "sent_ms": 12.5})
        pong = read_until(socket, "pong")
        socket.send_json({"type": "stop"})
        read_until(socket, "ended")

    assert pong["sent_ms"] == 12.5
    assert pong["server_s"] > 0


def test_two_sessions_do_not_touch_each_other(client: TestClient, recording_id: str) -> None:
    first = {"type": "start", "source": "recording", "recording": recording_id, "speed": 1}
    with connect(client, **first) as one:
        one_id = one.receive_json()["session"]
        *_, last, _end = play(client, recording_id)
        one.send_json({"type": "stop"})
        read_until(one, "ended")

    assert last["status"]["frames"] == 3200
    assert one_id not in {last.get("session")}


@pytest.mark.parametrize(
    ("first", "code"),
    [
        ({"type": "start", "source": "moon"}, "E-PARAMETER"),
        ({"type": "start", "source": "demo", "speed": 21}, "E-PARAMETER"),
        ({"type": "start", "source": "recording", "recording": "rec_none"}, "E-NOT-FOUND"),
        ({"type": "resume", "session": "none"}, "E-NOT-FOUND"),
    ],
)
def test_what_cannot_be_is_refused_in_words(client: TestClient, first: dict[str, Any], code: str) -> None:
    with connect(client, **first) as socket:
        problem = socket.receive_json()

        assert (problem["type"], problem["code"]) == ("problem", code)
        assert problem["fix"]
        with pytest.raises(WebSocketDisconnect):
            socket.receive_json()


def test_a_message_that_is_no_message_ends_the_connection_not_the_session(
    client: TestClient, recording_id: str
) -> None:
    first = {"type": "start", "source": "recording", "recording": recording_id, "speed": 1}
    with connect(client, **first) as socket:
        session = socket.receive_json()["session"]
        socket.send_text("{")
        read_until(socket, "problem")

    with connect(client, type="resume", session=session) as socket:
        assert socket.receive_json()["state"] == "running"
        socket.send_json({"type": "stop"})
        read_until(socket, "ended")


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


def test_a_session_with_cues_that_a_kill_cut_off_still_bears_the_tag(
    settings: Settings, store: JobStore
) -> None:
    leave_cut(settings, Wearer(), CueRule("hold", 60.0, 10.0))

    with TestClient(create_app(settings)), store.engine.connect() as connection:
        assert connection.execute(select(recordings.c.tags)).scalars().all() == ['["cues"]']


def leave_cut(settings: Settings, wearer: Wearer, *rules: CueRule) -> SessionFiles:
    """Leave the files of a session as a kill does."""
    files = begin_files(settings.data_dir / LIVE_FOLDER, keeps=True)
    recorder = Recorder(files.raw, SourceFacts("other", "made", 100.0), wearer, rules)
    for frames in replay_frames(make_worn(*DAY), 1.0):
        recorder.take(frames)
    recorder.break_off()
    return files


def test_what_a_kill_left_of_a_session_becomes_a_recording_and_is_gone(
    settings: Settings, store: JobStore, storage: Storage
) -> None:
    files = leave_cut(settings, Wearer("S007", "left"))

    with TestClient(create_app(settings), base_url="http://localhost:8080") as caller:
        (recording,) = caller.get("/api/v1/recordings").json()["items"]

    assert (recording["subject"], recording["side"]) == ("S007", "left")
    assert count_stored_rows(settings, recording["id"]) == 3200
    assert list(files.folder.iterdir()) == []


def test_the_lines_of_the_trail_tell_who_started_a_session_and_what_became_of_it(
    client: TestClient, recording_id: str, store: JobStore
) -> None:
    first, *_, last = play(client, recording_id, keeps=True)

    started, ended = read_trail(store, "live.started", "live.ended")
    kept = store.find_recording(last["analysis"])
    session = {"session": first["session"]}
    assert (started.act, started.recording_id, json.loads(started.other)) == (
        "live.started",
        recording_id,
        session,
    )
    assert (ended.act, ended.recording_id, ended.analysis_id) == ("live.ended", kept, last["analysis"])
    assert json.loads(ended.other) == session
    assert started.who == ended.who


def test_a_replay_that_adds_nothing_has_a_start_in_the_trail_and_no_end(
    client: TestClient, recording_id: str, store: JobStore
) -> None:
    play(client, recording_id)

    assert [line.act for line in read_trail(store, "live.started", "live.ended")] == ["live.started"]


def test_a_session_that_a_kill_cut_off_ends_in_the_trail_when_the_server_starts(
    settings: Settings, store: JobStore, storage: Storage
) -> None:
    files = leave_cut(settings, Wearer())

    with TestClient(create_app(settings)):
        (line,) = read_trail(store, "live.ended")

    assert (line.who, json.loads(line.other)) == ("system", {"session": files.session_id})
    assert line.recording_id == store.find_recording(line.analysis_id)


def read_trail(store: JobStore, *acts: str) -> list[Row[Any]]:
    with store.engine.connect() as connection:
        return list(
            connection.execute(select(audit_log).where(audit_log.c.act.in_(acts)).order_by(audit_log.c.seq))
        )


def test_boards_that_are_silent_hold_up_no_other_request(
    client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.live.sources.LEARN_LIMIT_S", 3.0)
    silent = 45  # more than the threads that answer requests
    with ExitStack() as sockets:
        for _ in range(silent):
            sockets.enter_context(connect(client, type="start", source="lines", name="silent"))
        while count_starting(client) < silent:
            pass
        client.get("/healthz")

        assert count_starting(client) == silent


def count_starting(client: TestClient) -> int:
    assert client.portal is not None
    return int(client.portal.call(lambda: _find_limiter().borrowed_tokens))


def test_the_part_of_a_message_that_cannot_be_is_named(client: TestClient) -> None:
    with connect(client, type="start", source="demo", speed=50) as socket:
        problem = socket.receive_json()

    assert problem["detail"].startswith("start.speed cannot be 50")


def test_a_message_that_is_too_long_in_coming_ends_the_connection(
    client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.api.live.FIRST_LIMIT_S", 0.05)
    with client.websocket_connect(f"ws://localhost:8080{ADDRESS}") as socket:
        assert socket.receive_json()["code"] == "E-PARAMETER"


def test_a_server_that_stops_makes_recordings_of_its_sessions(settings: Settings, tmp_path: Path) -> None:
    write_raw(tmp_path / "worn.csv", make_worn(*DAY), Wearer())
    application = create_app(settings)
    with TestClient(application, base_url="http://localhost:8080") as caller:
        content = (tmp_path / "worn.csv").read_bytes()
        stored = caller.post("/api/v1/recordings?file_name=worn.csv", content=content).json()["id"]
        asked = {"type": "start", "source": "recording", "recording": stored, "keeps": True}
        with connect(caller, **asked) as socket:
            read_until(socket, "update")
        hub = find_hub(application.state.services)

    with TestClient(create_app(settings), base_url="http://localhost:8080") as caller:
        assert len(caller.get("/api/v1/recordings").json()["items"]) == 2
    assert [session.state for session in hub._sessions.values()] == ["stopped"]


@pytest.fixture
def board(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Board]:
    """A board on a serial port; it writes 1,500 rows once its port is open, which drops earlier ones."""
    made, opening = Board(tmp_path), SerialPort.__init__
    monkeypatch.setattr("app.api.live.find_serial_ports", lambda: (str(made.path),))
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
        while socket.receive_json()["status"]["frames"] < 1500:  # the first may be the history
            pass
        socket.send_json({"type": "stop"})
        ended = read_until(socket, "ended")

    assert (session["device"], session["keeps"]) == ("lsm9ds1", True)
    assert client.get(f"/api/v1/analyses/{ended['analysis']}").json()["state"] == "queued"


def test_a_page_that_is_closed_while_the_server_reads_a_port_ends_the_session_with_its_report(
    client: TestClient, board: Board, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.live.hub.CLOSED_TERM_S", 0.1)
    asked = {"type": "start", "source": "port", "port": str(board.path), "keeps": True, "axis": "+z"}
    with connect(client, **asked) as socket:
        session = socket.receive_json()["session"]
        while socket.receive_json()["status"]["frames"] < 1500:
            pass

    hub = find_hub(client.app.state.services)  # type: ignore[attr-defined]
    analysis = wait_for(lambda: hub.get(session).analysis_id)

    assert client.get(f"/api/v1/analyses/{analysis}").json()["state"] == "queued"
    with connect(client, type="resume", session=session) as socket:
        assert read_until(socket, "ended")["was_left"]


def test_a_page_opens_no_other_file(client: TestClient) -> None:
    with connect(client, type="start", source="port", port="/dev/zero", keeps=True) as socket:
        assert socket.receive_json()["code"] == "E-LIVE-SOURCE"


HOLD = {"kind": "hold", "angle_deg": 60, "limit": 4}


def test_cues_are_sent_counted_and_noted(client: TestClient, recording_id: str) -> None:
    # The arm is above 60 deg from about 12 s to about 22 s: cues after 4 s and after 8 s.
    messages = play(client, recording_id, cues=[HOLD], keeps=True)

    cues = [message for message in messages if message["type"] == "cue"]
    assert [round(cue["time_s"]) for cue in cues] == [16, 20]
    assert (cues[0]["kind"], cues[0]["limit"]) == ("hold", 4)
    assert messages[-1]["cues"] == 2
    kept = client.get("/api/v1/recordings").json()["items"]
    assert [one["note"] for one in kept if one["note"]] == ["cues hold:60:4: 2; s: 16 20"]


def test_without_rules_it_is_quiet(client: TestClient, recording_id: str) -> None:
    messages = play(client, recording_id, keeps=True)

    assert not any(message["type"] == "cue" for message in messages)
    assert not any(one["note"] for one in client.get("/api/v1/recordings").json()["items"])


def test_while_paused_there_are_no_cues(client: TestClient, recording_id: str) -> None:
    first = {"type": "start", "source": "recording", "recording": recording_id, "speed": 5, "cues": [HOLD]}
    with connect(client, **first) as socket:
        socket.send_json({"type": "cues", "paused": True})
        assert read_until(socket, "cues")["paused"]
        messages = read_to_end(socket)

    assert messages[-1]["cues"] == 0


def test_a_cue_is_announced_to_the_webhooks_that_ask_for_it(
    client: TestClient, recording_id: str, store: JobStore, settings: Settings
) -> None:
    hooks = client.app.state.services.webhooks  # type: ignore[attr-defined]
    server = ServerSecret(settings.data_dir)
    told = hooks.add("https://hooks.example/cues", ("live.cue",), server)
    hooks.add("https://hooks.example/ends", ("analysis.finished",), server)

    play(client, recording_id, cues=[HOLD])

    with store.engine.connect() as connection:
        rows = connection.execute(select(deliveries.c.event, deliveries.c.webhook_id)).all()
    assert [tuple(row) for row in rows] == [("live.cue", told.id)] * 2


def test_a_webhook_that_names_no_events_is_told_of_no_cues(client: TestClient) -> None:
    made = client.post("/api/v1/webhooks", json={"url": "https://1.1.1.1/all"}).json()

    assert made["events"] == ["analysis.finished", "batch.finished"]


def test_lines_that_a_page_sends_become_a_recording(client: TestClient) -> None:
    with connect(client, type="start", source="lines", name="phone", keeps=True, axis="+z") as socket:
        text = (PREAMBLE + HEADER + write_rows(0, 1500)).encode()
        for first in range(0, len(text), 5000):
            socket.send_bytes(text[first : first + 5000])
        session = socket.receive_json()
        while socket.receive_json()["status"]["frames"] < 1500:  # the first may be the history
            pass
        socket.send_json({"type": "stop"})
        ended = read_until(socket, "ended")

    assert (session["source"], session["device"]) == ("phone", "lsm9ds1")
    assert client.get(f"/api/v1/analyses/{ended['analysis']}").json()["state"] == "queued"


def test_lines_go_on_after_a_lost_link_and_what_is_missing_is_a_hole(client: TestClient) -> None:
    with connect(client, type="start", source="lines", name="phone", axis="+z") as socket:
        socket.send_bytes((HEADER + write_rows(0, 300)).encode())
        session = socket.receive_json()["session"]
    with connect(client, type="resume", session=session) as socket:
        assert socket.receive_json()["state"] == "running"
        socket.send_bytes(write_rows(400, 500).encode())
        while (message := socket.receive_json())["status"]["frames"] < 400:
            pass
        socket.send_json({"type": "stop"})
        read_until(socket, "ended")

    assert (message["status"]["lost"], message["status"]["holes"]) == (100, 1)


def test_lines_without_a_header_are_refused_in_words(
    client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.live.sources.LEARN_LIMIT_S", 0.2)
    with connect(client, type="start", source="lines", name="phone") as socket:
        socket.send_bytes(b"1,2,3,4,5,6,7\n")

        assert read_until(socket, "problem")["code"] == "E-LIVE-SOURCE"
