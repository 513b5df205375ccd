"""What all tests share."""

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Generator, Iterator
from pathlib import Path

import pytest
from hypothesis import settings
from playwright.sync_api import Browser, sync_playwright

from acromion.fusion.simulation import simulate_shift, write_shift
from tests import ROOT
from tests.postgres import BINARIES, PostgresServer
from tests.swift import SwiftServer, find_programs

# A first call may wait for the compiler: no test is timed.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")

# What is compiled is kept: hundreds of processes that tests start would compile it again.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# The servers of the tests ask for no secret; those of tests/app/accounts ask as every server does.
os.environ["ACROMION_NO_SECRET"] = "1"

SHARED_DATA = ROOT.parent / "shared" / "data"
BROWSERS = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome")
"""The first one that is installed is used. The headless shell needs a seventh less processor time."""
MEMORY = Path("/dev/shm")
MEMORY_NEEDED_BYTES = 4 << 30


def pytest_configure() -> None:
    """Put temporary files in memory, where an fsync costs nothing; the crash tests keep to the disk."""
    if "TMPDIR" in os.environ or not os.access(MEMORY, os.W_OK):
        return
    if shutil.disk_usage(MEMORY).free > MEMORY_NEEDED_BYTES:
        os.environ["TMPDIR"] = tempfile.tempdir = str(MEMORY)


@pytest.fixture(scope="session")
def shared_data() -> Callable[[str], Path]:
    """Return the path of a real recording, or skip by name where it is absent."""

    def find(name: str) -> Path:
        path = SHARED_DATA / name
        if not path.exists():
            pytest.skip(f"real recording absent: {name}")
        return path

    return find


@pytest.fixture(scope="session")
def shift_gt3x(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Simulate six minutes of work recorded by a GT9X Link."""
    folder = tmp_path_factory.mktemp("shift")
    return write_shift(folder, simulate_shift("gt9x", 0.1, seed=1), actilife_csv=False)[0]


@pytest.fixture(scope="session")
def certificate(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A certificate of 127.0.0.1, signed by itself, and its key."""
    folder = tmp_path_factory.mktemp("tls")
    cert, key = folder / "cert.pem", folder / "key.pem"
    command = [
        "openssl",
        "req",
        "-x509",
        "-newkey",
        "rsa:2048",
        "-nodes",
        "-days",
        "2",
        "-subj",
        "/CN=localhost",
    ]
    names = ["-addext", "subjectAltName=IP:127.0.0.1", "-keyout", str(key), "-out", str(cert)]
    subprocess.run([*command, *names], check=True, capture_output=True)
    return cert, key


@pytest.fixture(scope="session")
def postgres() -> Iterator[PostgresServer]:
    """A real PostgreSQL, or skip by name where it is not installed."""
    if BINARIES is None:
        pytest.skip("PostgreSQL is not installed")
    server = PostgresServer()
    yield server
    server.remove()


@pytest.fixture(scope="session")
def swift() -> Iterator[SwiftServer]:
    """A real S3 server, or skip by name where it is not installed."""
    if not find_programs():
        pytest.skip("OpenStack Swift or memcached is not installed")
    server = SwiftServer()
    yield server
    server.remove()


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """One Chromium for all tests, or skip by name where it is not installed.

    Pages of one context share a process, which keeps its compiled scripts from test to test.
    """
    chromium = next(filter(None, map(shutil.which, BROWSERS)), None)
    if chromium is None:
        pytest.skip("no Chromium found")
    with sync_playwright() as playwright:
        opened = playwright.chromium.launch(
            executable_path=chromium, args=["--no-sandbox", "--process-per-site"]
        )
        yield opened
        opened.close()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Escape what is no UTF-8 in captured text: reports go from one test process to another (``-n 2``)."""
    report = yield
    report.sections = [
        (name, text.encode(errors="backslashreplace").decode()) for name, text in report.sections
    ]
    return report


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """With ACROMION_NO_SKIP set (as CI sets it), say that a skipped test is a failure."""
    skipped = terminalreporter.stats.get("skipped", [])
    if skipped and os.environ.get("ACROMION_NO_SKIP"):
        terminalreporter.write_line(f"{len(skipped)} tests were skipped where none may be", red=True)


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    """Fail the run on an unexpected skip where none is allowed."""
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if reporter and reporter.stats.get("skipped") and os.environ.get("ACROMION_NO_SKIP"):
        session.exitstatus = pytest.ExitCode.TESTS_FAILED
