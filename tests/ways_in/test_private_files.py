"""Everything that a server and its workers write is private, whatever the umask."""

import os
import sys
import time
from pathlib import Path

import pytest

from tests.ways_in.servers import RunningServer

OPEN_TO_OTHERS = 0o077


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such modes")
def test_no_file_of_a_run_is_open_to_others_under_a_wide_umask(tmp_path: Path, recording: Path) -> None:
    for name in ("tmp", "caches"):
        (tmp_path / name).mkdir()
    places = {"TMPDIR": str(tmp_path / "tmp"), "XDG_CACHE_HOME": str(tmp_path / "caches")}
    before = os.umask(0)
    try:
        server = RunningServer(tmp_path / "data", tmp_path / "log", 1, **places)
    finally:
        os.umask(before)
    seen: dict[str, int] = {}
    try:
        asked = server.send(recording, subject="P01")
        while (view := server.see(asked["id"]))["state"] in ("queued", "running"):  # temporary files, too
            seen |= _list_modes(tmp_path)
            time.sleep(0.1)
        tus = {"Tus-Resumable": "1.0.0", "Upload-Length": "9"}
        server.client.post("/api/v1/uploads", headers=tus)
        server.client.get(f"/api/v1/recordings/{asked['recording_id']}/inspection")
        seen |= _list_modes(tmp_path)
    finally:
        server.stop()
    seen |= _list_modes(tmp_path)

    log = (tmp_path / "log").read_text()
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
