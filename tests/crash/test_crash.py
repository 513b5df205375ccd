"""A short round of the crash matrix; the long one is ``python -m benchmarks.crash``."""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import httpx2
import pytest

from tests import ROOT
from tests.crash.harness import Journal, Site, check_settled
from tests.crash.rounds import can_cut_power, kill_rounds, power_cut

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="looks up processes in /proc")
needs_disks = pytest.mark.skipif(not can_cut_power(), reason="no root to mount a disk with")


def test_kills_lose_nothing_leave_nothing_and_blame_no_sound_recording(tmp_path: Path) -> None:
    result = kill_rounds(tmp_path, rounds=6, seed=2)

    assert result.acknowledged > 0
    assert result.cut >= 3
    assert result.blamed == 0
    assert result.broken == []


@pytest.mark.slow
def test_after_two_hundred_kills_the_acts_are_the_lines(tmp_path: Path) -> None:
    result = kill_rounds(tmp_path, rounds=200, seed=3)

    assert result.acknowledged > 200
    assert result.broken == []


@needs_disks
def test_a_power_cut_loses_nothing_that_was_acknowledged(tmp_path: Path) -> None:
    result = power_cut(tmp_path, seed=1)

    assert result.acknowledged > 0
    assert result.broken == []


@needs_disks
def test_without_fsync_the_same_power_cut_loses_recordings(tmp_path: Path) -> None:
    result = power_cut(tmp_path, seed=1, sync="unsynced")

    assert result.acknowledged > 0
    assert result.broken != []


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of 96 MB in memory: room for the reserve, and for what analyses leave free."""
    disk = tmp_path / "small"
    disk.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=96m", "tmpfs", str(disk)], check=True)
    yield disk
    subprocess.run(["umount", str(disk)], check=True)


@needs_disks
def test_a_full_disk_is_said_so_and_the_server_recovers_when_there_is_room(
    small_disk: Path, tmp_path: Path
) -> None:
    site, journal = Site(small_disk / "data", tmp_path / "log"), Journal()
    try:
        with httpx2.Client(base_url=site.address, timeout=None) as client:
            kept = client.post("/api/v1/analyze", content=b"first").json()
            (small_disk / "ballast").write_bytes(bytes(56 << 20))
            full = client.post("/api/v1/analyze", content=bytes(40 << 20))
            still = client.get(f"/api/v1/analyses/{kept['id']}")
            (small_disk / "ballast").unlink()
            after = client.post("/api/v1/analyze", content=b"second")

        assert (full.status_code, full.json()["code"]) == (507, "E-DISK")
        assert still.status_code == 200
        assert after.status_code == 202
        assert check_settled(site.settings, journal) == []
    finally:
        site.end()


def test_a_second_server_of_one_folder_is_refused(tmp_path: Path) -> None:
    site = Site(tmp_path / "data", tmp_path / "log", workers=0)
    command = [sys.executable, "-m", "acromion", "serve", "--port", "0", "--data", str(tmp_path / "data")]

    second = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)

    site.end()
    assert second.returncode == 2
    assert "E-FOLDER-IN-USE" in second.stderr


@pytest.mark.skipif(not Path("/usr/bin/faketime").exists(), reason="faketime is not installed")
@pytest.mark.parametrize("step", ["+1y", "-1h"])
def test_a_stepped_clock_takes_no_job_from_a_living_worker(tmp_path: Path, step: str) -> None:
    site = Site(tmp_path / "data", tmp_path / "log", workers=0)
    with httpx2.Client(base_url=site.address, timeout=None) as client:
        job = client.post("/api/v1/analyze", content=b"recording").json()
    command = [sys.executable, "-m", "tests.crash.stepped_worker", str(tmp_path / "data")]
    preload = {"LD_PRELOAD": _find_faketime(), "FAKETIME": step, "FAKETIME_DONT_FAKE_MONOTONIC": "1"}

    done = subprocess.run(command, cwd=ROOT, env=os.environ | preload, check=False)

    with httpx2.Client(base_url=site.address, timeout=None) as client:
        seen = client.get(f"/api/v1/analyses/{job['id']}").json()
    site.end()
    assert done.returncode == 0
    assert (seen["state"], seen["attempts"]) == ("succeeded", 1)


def _find_faketime() -> str:
    return str(next(Path("/usr/lib").glob("*/faketime/libfaketime.so.1")))
