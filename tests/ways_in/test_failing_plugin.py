"""A reader of another package that fails: one line for a person, the traceback for the log of a server."""

import subprocess
from pathlib import Path

import pytest

from tests import ROOT
from tests.plugin import install, make_environment, write_wheel
from tests.ways_in.servers import RunningServer

FAILING = """
def recognise(source):
    return source.head.startswith(b"ACME")

def read(source, rate_hz):
    return rows_of(source)
"""
LINE = "the reader plug-in acme-armband 1.2 failed: NameError: name 'rows_of' is not defined"


@pytest.fixture(scope="module")
def python(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The Python of a fresh environment with the failing reader."""
    folder = tmp_path_factory.mktemp("failing")
    made = make_environment(folder / "venv")
    install(made, write_wheel(folder, FAILING, "1.2"))
    return made


@pytest.fixture
def armband(tmp_path: Path) -> Path:
    path = tmp_path / "shift.acme"
    path.write_bytes(b"ACME")
    return path


def test_a_command_prints_one_line_with_type_and_message_and_no_traceback(
    python: Path, armband: Path, tmp_path: Path
) -> None:
    command = [str(python), "-m", "acromion", "run", str(armband), "-o", str(tmp_path / "out")]
    told = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False).stderr

    assert told.count(LINE) == 1
    assert "E-READER" in told
    assert "Traceback" not in told


def test_the_log_of_a_server_has_the_traceback(python: Path, armband: Path, tmp_path: Path) -> None:
    log = tmp_path / "server.log"
    server = RunningServer(tmp_path / "data", log, python=str(python))
    try:
        job = server.send(armband)["id"]
        view = server.see(job, wait=60)
    finally:
        server.stop()

    assert view["problem"]["code"] == "E-READER"
    assert LINE in log.read_text("utf-8")
    assert "| Traceback" in log.read_text("utf-8")
