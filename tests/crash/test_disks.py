"""Disks that fail: no inode left, reads and writes that end in an error; and deletions that are cut."""

import os
import random
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import httpx2
import pytest

from tests.crash.harness import Clients, Journal, Site, check_acknowledged, check_settled
from tests.crash.rounds import can_cut_power

FIU = [Path("/usr/lib/fiu") / f"fiu_{name}_preload.so" for name in ("run", "posix")]
CANARY = b"the bytes of somebody's arm"

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="looks up processes in /proc")


@pytest.fixture
def few_inodes(tmp_path: Path) -> Iterator[Path]:
    """A disk of 32 MB that has room for about a hundred files."""
    if not can_cut_power():
        pytest.skip("no root to mount a disk with")
    image, disk = tmp_path / "disk.img", tmp_path / "disk"
    image.write_bytes(b"")
    os.truncate(image, 32 << 20)
    subprocess.run(["mkfs.ext4", "-q", "-F", "-b", "1024", "-N", "128", str(image)], check=True)
    disk.mkdir()
    subprocess.run(["mount", "-o", "loop", str(image), str(disk)], check=True)
    yield disk
    subprocess.run(["umount", str(disk)], check=True)


def test_a_disk_without_inodes_is_reported_as_full_and_recovers(few_inodes: Path, tmp_path: Path) -> None:
    site, journal = Site(few_inodes / "data", tmp_path / "log"), Journal()
    try:
        with httpx2.Client(base_url=site.address, timeout=None) as client:
            kept = client.post("/api/v1/analyze", content=b"first").json()
            assert check_settled(site.settings, journal) == []
            ballast = [few_inodes / f"ballast{k}" for k in range(os.statvfs(few_inodes).f_favail)]
            for path in ballast:
                path.touch()
            full = client.post("/api/v1/analyze", content=b"second")
            still = client.get(f"/api/v1/analyses/{kept['id']}")
            for path in ballast:
                path.unlink()
            after = client.post("/api/v1/analyze", content=b"third")

        assert (full.status_code, full.json()["code"]) == (507, "E-DISK")
        assert still.json()["state"] == "succeeded"
        assert after.status_code == 202
        assert check_settled(site.settings, journal) == []
    finally:
        site.end()


@pytest.mark.skipif(not all(path.exists() for path in FIU), reason="libfiu is not installed")
def test_a_disk_that_fails_now_and_then_loses_nothing_that_was_acknowledged(tmp_path: Path) -> None:
    pipes = tmp_path / "fiu"
    environment = {"LD_PRELOAD": " ".join(map(str, FIU)), "FIU_CTRL_FIFO": str(pipes)}
    site, journal = Site(tmp_path / "data", tmp_path / "log", workers=0, environment=environment), Journal()
    clients = Clients(site, journal, seed=1)
    fail = "enable_random name=posix/io/{},probability=0.01"
    try:
        for kind in ("rw/write", "rw/pwrite", "sync/*", "oc/open"):
            command = ["fiu-ctrl", "-f", str(pipes), "-c", fail.format(kind), str(site.web_pid)]
            subprocess.run(command, check=True)
        clients.wait_for_first()
        time.sleep(4.0)
    finally:
        site.end()
        clients.stop()

    assert journal.recordings
    assert check_acknowledged(site.settings, journal) == []


def test_a_deletion_that_is_cut_is_finished_by_the_next_start(tmp_path: Path) -> None:
    site, dice, gone = Site(tmp_path / "data", tmp_path / "log", workers=0), random.Random(1), list[str]()
    try:
        for round_ in range(4):
            with httpx2.Client(base_url=site.address, timeout=None) as client:
                kept = [
                    client.post("/api/v1/recordings", content=CANARY + bytes([round_, k])).json()["id"]
                    for k in range(6)
                ]
                deleter = subprocess.Popen(
                    [sys.executable, "-c", DELETE, site.address, *kept], stdout=subprocess.PIPE, text=True
                )
                with deleter:
                    assert deleter.stdout is not None
                    gone += deleter.stdout.readline().split()  # the first, whenever it comes
                    time.sleep(dice.uniform(0, 0.1))
                    site.kill("web", dice)
                    gone += deleter.stdout.read().split()
            site.start()

        with httpx2.Client(base_url=site.address, timeout=None) as client:
            assert gone
            known = _list_stored(client, trashed=False) | _list_stored(client, trashed=True)
            left = {path.stem for path in (tmp_path / "data" / "recordings").iterdir()}  # side files, too
            assert left == known
            assert left.isdisjoint(gone)
            assert {client.get(f"/api/v1/recordings/{name}").status_code for name in gone} == {404}
    finally:
        site.end()


def _list_stored(client: httpx2.Client, *, trashed: bool) -> set[str]:
    """Name what the server knows; a deletion that was not acknowledged may have come as far as the trash."""
    page = client.get("/api/v1/recordings", params={"limit": 500, "trashed": trashed}).json()
    return {row["id"] for row in page["items"]}


DELETE = """
import sys, urllib.request
for name in sys.argv[2:]:
    address = f"{sys.argv[1]}/api/v1/recordings/{name}?purge=now"
    try:
        urllib.request.urlopen(urllib.request.Request(address, method="DELETE")).close()
    except OSError:
        break
    print(name, flush=True)
"""
