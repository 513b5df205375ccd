"""What a port brings while the science is loaded: on the disk within a second, a recording after a kill."""

import threading
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from fastapi.testclient import TestClient

from acromion.app.http.api import live as live_api
from acromion.app.http.api.live import LIVE_FOLDER
from acromion.app.live.ports import (
    SHOWN,
    EarlyFile,
    EarlyPort,
    PushedPort,
    SessionFiles,
    create_session_files,
    find_interrupted_files,
    read_pieces,
    read_session_options,
)
from acromion.app.live.raw_file import write_early_rows
from acromion.app.settings import Settings
from acromion.fusion.readers import read_recording
from acromion.fusion.recording import Recording
from tests.app.conftest import serving
from tests.app.live.made import count_stored_rows
from tests.app.live.test_socket import connect, read_until
from tests.fusion.live.test_lines import HEADER, PREAMBLE, write_rows
from tests.ways_in.servers import wait_for

BOARD = PREAMBLE + HEADER
ASKED = {"name": "phone", "subject": "S007", "side": "left", "axis": "+z", "cues": []}


@pytest.fixture
def files(tmp_path: Path) -> SessionFiles:
    return create_session_files(tmp_path / "live", keeps=True)


def write_early(files: SessionFiles, *pieces: str) -> None:
    early = EarlyFile(files.early, ASKED)
    for number, piece in enumerate(pieces):
        early.write(piece.encode(), 1_770_000_000.0 + number)
    early.close()


def open_raw(files: SessionFiles) -> Recording:
    with files.raw.open("rb") as file:
        return read_recording(file, file_name="live.csv")


def read_early(files: SessionFiles) -> bytes:
    return b"".join(piece for piece, _ in read_pieces(files.early.read_bytes()))


def wait_until_kept(files: SessionFiles, piece: bytes) -> None:
    wait_for(lambda: read_early(files).endswith(piece))


def test_what_came_is_kept_as_it_came_with_its_moment_and_what_was_asked(files: SessionFiles) -> None:
    write_early(files, "a", "bc")

    content = files.early.read_bytes()

    assert read_session_options(content) == ASKED
    assert list(read_pieces(content)) == [(b"a", 1_770_000_000.0), (b"bc", 1_770_000_001.0)]
    assert [place.stat().st_mode & 0o777 for place in (files.early, files.folder)] == [0o600, 0o700]


def test_a_port_is_read_while_nobody_takes_anything_from_it(files: SessionFiles) -> None:
    pushed = PushedPort()
    port = EarlyPort(pushed, EarlyFile(files.early, ASKED))

    pushed.push(b"1,2,3\n")

    wait_until_kept(files, b"1,2,3\n")
    assert port.read() == b"1,2,3\n"
    port.close()


def test_released_it_leaves_no_file_and_the_port_is_read_on(files: SessionFiles) -> None:
    pushed = PushedPort()
    port = EarlyPort(pushed, EarlyFile(files.early, ASKED))
    pushed.push(b"1\n")
    wait_for(lambda: port.is_behind)

    port.release()
    pushed.push(b"2\n")

    assert wait_for(port.read) + wait_for(port.read) == b"1\n2\n"
    assert not files.early.exists()
    port.close()


def test_what_came_early_and_was_not_read_yet_keeps_its_moment(files: SessionFiles) -> None:
    pushed = PushedPort()
    port = EarlyPort(pushed, EarlyFile(files.early, ASKED))
    for piece in (b"1\n", b"2\n"):
        pushed.push(piece)
        wait_until_kept(files, piece)

    port.read()
    first_s = port.now_s()
    port.read()

    assert first_s < port.now_s()
    port.close()


def test_of_early_rows_a_raw_file_is_made(files: SessionFiles) -> None:
    write_early(files, BOARD + write_rows(0, 150), write_rows(150, 301)[:-5])

    assert write_early_rows(files.early, files.raw)

    recording = open_raw(files)
    assert not files.early.exists()
    assert (recording.device, recording.arm_axis) == ("lsm9ds1", "+z")
    assert np.allclose(recording.segments[0].acc_g[:, 0], np.arange(300) / 1000)


@pytest.mark.parametrize(("rows", "begun"), [(60, None), (300, b"begun")], ids=["few rows", "begun before"])
def test_few_rows_are_kept_too_and_a_raw_file_that_was_begun_is_written_again(
    files: SessionFiles, rows: int, begun: bytes | None
) -> None:
    write_early(files, BOARD + write_rows(0, rows))
    if begun:
        files.raw.write_bytes(begun)

    assert write_early_rows(files.early, files.raw)

    assert sum(map(len, open_raw(files).segments)) == rows


@pytest.mark.parametrize("said", ["", "x", write_rows(0, 300)])
def test_what_holds_no_row_that_can_be_read_leaves_nothing(files: SessionFiles, said: str) -> None:
    write_early(files, said)

    assert not write_early_rows(files.early, files.raw)

    assert list(files.folder.iterdir()) == []


class Loading:
    """The science, loaded for as long as it is wanted."""

    def __init__(self, goes_on: Callable[..., object]) -> None:
        self.is_wanted, self._goes_on = threading.Event(), goes_on

    def __call__(self, *parts: object) -> object:
        self.is_wanted.wait()
        return self._goes_on(*parts)


@pytest.fixture
def loading(monkeypatch: pytest.MonkeyPatch) -> Loading:
    made = Loading(live_api._start_with)
    monkeypatch.setattr(live_api, "_start_with", made)
    return made


def count_early(settings: Settings) -> int:
    """Count the rows of the only session that are on the disk."""
    for files in find_interrupted_files(settings.data_dir / LIVE_FOLDER):
        return read_early(files).count(b"\n")
    return 0


def test_before_the_science_is_loaded_samples_are_on_the_disk_and_afterwards_in_the_session(
    client: TestClient, settings: Settings, loading: Loading
) -> None:
    with connect(client, type="start", source="lines", name="phone", keeps=True, axis="+z") as socket:
        socket.send_bytes((HEADER + write_rows(0, 500)).encode())
        wait_for(lambda: count_early(settings) == 501)
        loading.is_wanted.set()
        while socket.receive_json().get("status", {}).get("frames") != 500:
            pass
        wait_for(lambda: not list((settings.data_dir / LIVE_FOLDER).glob("*.early")))
        socket.send_json({"type": "stop"})
        read_until(socket, "ended")

    assert [path.suffix for path in (settings.data_dir / LIVE_FOLDER).iterdir()] == [SHOWN]


def test_what_a_kill_left_before_the_science_was_loaded_becomes_a_recording(settings: Settings) -> None:
    write_early(
        create_session_files(settings.data_dir / LIVE_FOLDER, keeps=True), BOARD + write_rows(0, 1000)
    )

    with serving(settings) as caller:
        (recording,) = caller.get("/api/v1/recordings").json()["items"]

    assert (recording["subject"], recording["side"]) == ("S007", "left")
    assert count_stored_rows(settings, recording["id"]) == 1000
    assert list((settings.data_dir / LIVE_FOLDER).iterdir()) == []
