"""Everything that a server and its workers write is private, whatever the umask."""

import os
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.ways_in.servers import RunningServer

OPEN_TO_OTHERS = 0o077


@pytest.fixture
def base() -> Iterator[Path]:
    """A folder with a short path: the name of a socket has at most 107 bytes."""
    with tempfile.TemporaryDirectory(prefix="private-") as folder:
        yield Path(folder)


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such modes")
def test_no_file_of_a_run_is_open_to_others_under_a_wide_umask(base: Path, recording: Path) -> None:
    for name in ("tmp", "caches"):
        (base / name).mkdir()
    places = {"TMPDIR": str(base / "tmp"), "XDG_CACHE_HOME": str(base / "caches")}
    before = os.umask(0)
    try:
        server = RunningServer(base / "data", base / "log", 1, **places)
    finally:
        os.umask(before)
    seen: dict[str, int] = {}
    try:
        asked = server.send(recording, subject="P01")
        while (view := server.see(asked["id"]))["state"] in ("queued", "running"):  # temporary files, too
            seen |= _list_modes(base)
            time.sleep(0.1)
        tus = {"Tus-Resumable": "1.0.0", "Upload-Length": "9"}
        server.client.post("/api/v1/uploads", headers=tus)
        server.client.get(f"/api/v1/recordings/{asked['recording_id']}/inspection")
        seen |= _list_modes(base)
    finally:
        server.stop()
    seen |= _list_modes(base)

    log = (base / "log").read_text()
    assert view["state"] == "succeeded", (view, log)
    assert any("cache/" in name and name.endswith(".samples") for name in seen), (sorted(seen), log)
    assert any(name.endswith("results.json") for name in seen)
    assert {name: oct(mode) for name, mode in seen.items() if mode & OPEN_TO_OTHERS} == {}


def _list_modes(base: Path) -> dict[str, int]:
    found: dict[str, int] = {}
    for place in ("data", "tmp", "caches"):
        for path in (base / place).rglob("*"):
            try:
                found[str(path.relative_to(base))] = path.lstat().st_mode
            except FileNotFoundError:
                continue
    return found
