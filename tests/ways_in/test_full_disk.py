"""A server whose disk is really full: it reads, deletes and purges, and refuses uploads."""

import os
import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest

from acromion.app.store.reserve import RESERVE_BYTES, RESERVE_FILE, free_reserve, keep_reserve
from tests.crash.rounds import can_cut_power
from tests.ways_in.servers import RunningServer, wait_for

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="mounts a small disk")


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of 160 MB."""
    if not can_cut_power():
        pytest.skip("no root to mount a disk with")
    disk = tmp_path / "disk"
    disk.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=160m", "tmpfs", str(disk)], check=True)
    yield disk
    subprocess.run(["umount", str(disk)], check=True)


def test_a_full_disk_still_reads_deletes_and_purges(
    small_disk: Path, tmp_path: Path, recording: Path
) -> None:
    start = partial(RunningServer, small_disk / "data", tmp_path / "log", ACROMION_MIN_FREE_BYTES="33554432")
    server = start()
    try:
        views = [server.send(recording, subject=f"P{k:02d}") for k in range(4)]
        read, trashed, later, purged = (view["recording_id"] for view in views)
        wait_for(lambda: all(server.see(view["id"], 10)["state"] == "succeeded" for view in views))
        wait_for((small_disk / "data" / RESERVE_FILE).exists)
        _fill(small_disk)

        before = _read_everything(server, views[0]["id"], read)
        (small_disk / "ballast").unlink()
        wait_for((small_disk / "data" / RESERVE_FILE).exists)
        server.kill()
        _fill(small_disk)
        server = start()
        after = _read_everything(server, views[0]["id"], read)
        gone = [
            server.client.delete(f"/api/v1/recordings/{one}", params={"purge": purge})
            for one, purge in ((trashed, "false"), (later, "true"), (purged, "now"))
        ]
        refused = server.client.post("/api/v1/recordings", content=b"few bytes", params={"subject": "P9"})
        back = server.client.post(f"/api/v1/recordings/{trashed}/restore")
        (small_disk / "ballast").unlink()
        wait_for((small_disk / "data" / RESERVE_FILE).exists)
        again = server.send(recording, subject="P10")
        done = wait_for(lambda: server.see(again["id"], 10)["state"] == "succeeded")
    finally:
        server.stop()

    assert before == after == {200}
    assert [answer.status_code for answer in gone] == [204, 202, 200]
    assert not [path for path in (small_disk / "data" / "recordings").iterdir() if purged in path.name]
    assert (refused.status_code, refused.json()["code"]) == (507, "E-DISK")
    assert back.status_code == 200
    assert done


def test_the_reserve_is_freed_by_a_request_on_a_full_disk_and_renewed_afterwards(small_disk: Path) -> None:
    reserve = small_disk / RESERVE_FILE
    keep_reserve(small_disk)
    assert reserve.stat().st_size == RESERVE_BYTES
    _fill(small_disk)
    keep_reserve(small_disk)
    assert reserve.exists()  # until a request needs it
    free_reserve(small_disk)
    assert not reserve.exists()
    keep_reserve(small_disk)  # the room is not taken back at once
    assert not reserve.exists()
    (small_disk / "ballast").unlink()
    keep_reserve(small_disk)
    assert reserve.stat().st_blocks * 512 >= RESERVE_BYTES


def _fill(disk: Path) -> None:
    """Leave no free block."""
    with (disk / "ballast").open("ab", buffering=0) as ballast:
        piece = 1 << 20
        while piece:
            try:
                ballast.write(bytes(piece))
            except OSError:
                piece //= 2
    assert os.statvfs(disk).f_bavail == 0


def _read_everything(server: RunningServer, analysis: str, recording: str) -> set[int]:
    """Open pages, lists, reports and downloads; return their status codes."""
    pages = ("/", f"/analyses/{analysis}", "/trash", "/live", "/help")
    files = ("results.json", "elevation.csv.gz", "elevation.parquet", "report.pdf", "report.html")
    asked = (
        *(f"/api/v1/analyses/{analysis}/{name}" for name in files),
        "/api/v1/recordings",
        f"/api/v1/recordings/{recording}",
        f"/api/v1/recordings/{recording}/file",
        f"/api/v1/recordings/{recording}/inspection",
    )
    got = {page: server.client.get(page, headers={"Accept": "text/html"}).status_code for page in pages}
    got |= {path: server.client.get(path).status_code for path in asked}
    return set(got.values())
