"""What keeps folder or database from being opened is told with code and cure, and nothing is changed."""

import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

from acromion.app.cli import app
from acromion.app.errors import DatabaseLocked
from acromion.app.library.database import connect as database_module
from acromion.app.queue.worker import open_worker_context
from acromion.app.request import ReportRequest
from acromion.app.settings import Settings
from acromion.app.store.folder import StoredRecording
from tests.postgres import PostgresServer

Damage = Callable[[bytes], bytes]
PAGE_BYTES = 4096
NOBODY = 65534
COMMANDS = ("serve", "worker", "verify", "backup")
HOLDER = """
import sqlite3, sys
held = sqlite3.connect(sys.argv[1], isolation_level=None)
held.execute("BEGIN IMMEDIATE")
print("held", flush=True)
sys.stdin.read()
"""


def overwrite_header(content: bytes) -> bytes:
    return b"no database here" * 8 + content[128:]


def cut_off(content: bytes) -> bytes:
    return content[: len(content) // 2]


def overwrite_page(content: bytes) -> bytes:
    return content[: 6 * PAGE_BYTES] + b"\xa5" * PAGE_BYTES + content[7 * PAGE_BYTES :]


def call(command: str, data: Path, *more: str) -> tuple[int, str]:
    """Call a command in this process; return its exit code and all that it says."""
    port = ["--port", "0"] if command == "serve" else []
    file = [str(data.with_name("b.zip"))] if command == "backup" else []
    result = CliRunner().invoke(app, [command, *file, "--data", str(data), *port, *more])
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result.exit_code, result.output


def is_told(command: str, answer: tuple[int, str], code: str) -> bool:
    exit_code, said = answer
    return exit_code == (2 if command in ("serve", "worker") else 3) and f"{code} " in said


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """A data folder with a database of some rows, closed."""
    folder = tmp_path / "data"
    settings = Settings(data_dir=folder)
    worker = open_worker_context(settings)
    for number in range(50):
        recording = StoredRecording(f"rec_{number}", "0" * 64, 1)
        worker.store.add(recording, ReportRequest("shift.gt3x"))
    worker.store.close()
    return folder


@pytest.mark.parametrize("damage", [overwrite_header, cut_off, overwrite_page])
def test_a_damaged_database_is_named_by_every_command_and_left_as_it_is(data: Path, damage: Damage) -> None:
    file = data / "acromion.sqlite3"
    file.write_bytes(damage(file.read_bytes()))
    before = file.read_bytes()
    commands = COMMANDS[:3] if damage is overwrite_page else COMMANDS  # a backup reads no such page

    for command in commands:
        answer = call(command, data)
        assert is_told(command, answer, "E-DATABASE-DAMAGED"), (command, answer)
    exit_code, said = call("doctor", data)

    assert (exit_code, "E-DATABASE-DAMAGED" in said) == (1, True)
    assert file.read_bytes() == before


@pytest.mark.parametrize("command", [*COMMANDS, "doctor"])
def test_a_data_path_that_is_a_file_is_named_with_its_cure(tmp_path: Path, command: str) -> None:
    (tmp_path / "data").write_text("mine")

    answer = exit_code, said = call(command, tmp_path / "data")

    assert (
        (exit_code, "FAIL" in said) == (1, True)
        if command == "doctor"
        else is_told(command, answer, "E-FOLDER-FILE")
    )
    assert (tmp_path / "data").read_text() == "mine"
    if command in ("serve", "worker"):
        first, *rest = said.splitlines()
        assert first.startswith(f"{command}: E-FOLDER-FILE ")
        assert rest[-1].strip() == "Choose another path with --data."


@pytest.fixture
def read_only(data: Path) -> Iterator[Path]:
    """The data folder on a disk that is mounted read-only."""
    if os.geteuid() != 0 or shutil.which("mount") is None:
        pytest.skip("no root to mount a disk with")
    place = data.with_name("disk")
    place.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "tmpfs", str(place)], check=True)
    shutil.copytree(data, place / "data")
    subprocess.run(["mount", "-o", "remount,ro", str(place)], check=True)
    yield place / "data"
    subprocess.run(["umount", str(place)], check=True)


@pytest.mark.parametrize("command", COMMANDS)
def test_a_read_only_folder_is_named(read_only: Path, command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(read_only.parents[1])
    answer = call(command, read_only)

    code = "E-BACKUP" if command == "backup" else "E-FOLDER-READ-ONLY"
    assert is_told(command, answer, code), answer


@pytest.fixture
def foreign_folder() -> Iterator[Path]:
    """A folder in which another user than its owner may only read."""
    if os.geteuid() != 0:
        pytest.skip("no root to become another user")
    place = Path(tempfile.mkdtemp(prefix="acromion-"))
    place.chmod(0o755)
    yield place
    shutil.rmtree(place)


@pytest.mark.parametrize("command", ["serve", "worker"])
def test_a_folder_without_permission_is_named(foreign_folder: Path, command: str) -> None:
    os.seteuid(NOBODY)
    try:
        answer = call(command, foreign_folder / "data")
    finally:
        os.seteuid(0)

    assert is_told(command, answer, "E-FOLDER-PERMISSION"), answer
    assert list(foreign_folder.iterdir()) == []


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("database", ["postgresql"], indirect=True)
def test_postgresql_away_is_named(
    database: str, postgres: PostgresServer, tmp_path: Path, command: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ACROMION_DATABASE_URL", database)
    postgres.stop()
    try:
        answer = call(command, tmp_path / "data")
    finally:
        postgres.start()

    assert is_told(command, answer, "E-DATABASE"), answer
    assert "postgres@" not in answer[1]


@pytest.fixture
def frozen_worker(data: Path) -> Iterator[int]:
    """A process that was stopped while it wrote to the database."""
    command = [sys.executable, "-c", HOLDER, str(data / "acromion.sqlite3")]
    holder = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert holder.stdout is not None
    assert holder.stdout.readline() == b"held\n"
    holder.send_signal(signal.SIGSTOP)
    yield holder.pid
    holder.kill()
    holder.communicate()


@pytest.mark.skipif(sys.platform != "linux", reason="stops a process")
@pytest.mark.parametrize("command", ["serve", "worker"])
def test_a_worker_frozen_with_the_write_lock_is_named_by_its_number(
    data: Path, frozen_worker: int, command: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(database_module, "BUSY_TIMEOUT_S", 1)

    answer = call(command, data)

    assert is_told(command, answer, "E-DATABASE-LOCKED"), answer
    assert f"number {frozen_worker})" in answer[1].replace("\u202f", "")


def test_a_lock_that_ends_while_it_is_asked_for_is_no_refusal(data: Path) -> None:
    held = sqlite3.connect(data / "acromion.sqlite3", isolation_level=None)
    held.execute("BEGIN IMMEDIATE")
    try:
        with pytest.raises(DatabaseLocked):
            database_module.check_writable(Settings(data_dir=data).database_url, 0)
    finally:
        held.close()

    database_module.check_writable(Settings(data_dir=data).database_url, 0)


# --- settings of the environment --------------------------------------------------------------------------

FROM_ENVIRONMENT = {
    "ACROMION_HOST": "::1",
    "ACROMION_PORT": "8181",
    "ACROMION_DATA_DIR": "clinic",
    "ACROMION_WORKERS": "0",
    "ACROMION_WATCH_DIR": "inbox",
}


def serve_with(monkeypatch: pytest.MonkeyPatch, *options: str) -> tuple[object, ...]:
    """Return address, folders and number of workers with which the command starts the server."""
    served: list[Settings] = []
    monkeypatch.setattr("acromion.app.main.serve", lambda settings, **_: served.append(settings))
    assert CliRunner().invoke(app, ["serve", *options]).exit_code == 0
    (used,) = served
    return used.host, used.port, str(used.data_dir), used.workers, str(used.watch_dir)


def test_serve_takes_its_settings_from_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in FROM_ENVIRONMENT.items():
        monkeypatch.setenv(name, value)

    assert serve_with(monkeypatch) == ("::1", 8181, "clinic", 0, "inbox")


def test_an_option_of_serve_overrides_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in FROM_ENVIRONMENT.items():
        monkeypatch.setenv(name, value)

    options = ("--host", "127.0.0.1", "--port", "0", "--data", "d", "-j", "1", "--watch", "w")

    assert serve_with(monkeypatch, *options) == ("127.0.0.1", 0, "d", 1, "w")


@pytest.mark.parametrize("command", ["serve", "worker", "doctor"])
@pytest.mark.parametrize("name", ["ACROMION_DATABASE_URL", "ACROMION_DATA_DIR", "ACROMION_PORT"])
def test_an_empty_setting_is_refused_by_its_name(
    monkeypatch: pytest.MonkeyPatch, command: str, name: str
) -> None:
    monkeypatch.setenv(name, "")

    refused = CliRunner().invoke(app, [command])

    assert refused.exit_code == 2
    assert f"E-PARAMETER This value is not allowed\n  The value of {name} is not" in refused.output
