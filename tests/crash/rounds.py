"""The rounds: kills at random instants, and power cuts of a loop-mounted disk."""

import os
import random
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from app.settings import Settings
from tests.crash.harness import VICTIMS, Clients, Journal, Site, check_acknowledged, check_settled

DISK_BYTES = 96 << 20


def can_cut_power() -> bool:
    """Tell whether a disk can be made and mounted here (Linux, root, loop devices)."""
    tools = all(shutil.which(name) for name in ("mkfs.ext4", "mount", "umount"))
    return sys.platform == "linux" and os.geteuid() == 0 and tools and Path("/dev/loop-control").exists()


def kill_rounds(folder: Path, rounds: int, seed: int) -> tuple[int, list[str]]:
    """Kill somebody in every round; gives the number of acknowledged uploads and what was broken."""
    dice, journal, broken = random.Random(seed), Journal(), list[str]()
    site = Site(folder / "data", folder / "log", workers=2)
    clients = Clients(site, journal, seed, pause_s=4.0)  # no faster than the workers
    try:
        for _ in range(rounds):
            time.sleep(dice.uniform(0.2, 1.5))
            site.kill(dice.choice(VICTIMS), dice)
            time.sleep(dice.uniform(0, 0.3))
            site.start()
            broken += check_acknowledged(site.settings, journal)
        clients.stop()
        site.kill("all", dice)  # what is left half-made now is swept by the start
        site.start()
        broken += check_settled(site.settings, journal)
    finally:
        clients.stop()
        site.end()
    return len(journal.recordings), broken


def power_cut(folder: Path, seed: int, sync: str = "synced") -> tuple[int, list[str]]:
    """Cut the power at a random instant; gives the same as :func:`kill_rounds`."""
    dice, journal = random.Random(seed), Journal()
    image, copy = folder / "disk.img", folder / "copy.img"
    _make_disk(image)
    with _mounted(image, folder / "disk") as disk:
        site = Site(disk / "data", folder / "log", sync)
        clients = Clients(site, journal, seed)
        try:
            time.sleep(dice.uniform(1.0, 3.0))
            site.freeze()
            _copy_at_rest(image, copy)
        finally:
            clients.stop()
            site.end()
    with _mounted(copy, folder / "after") as disk:
        broken = _check_after_power_cut(disk / "data", journal)
    image.unlink()
    copy.unlink()
    return len(journal.recordings), broken


def _copy_at_rest(image: Path, copy: Path) -> None:
    """Copy the disk as one instant saw it: again, while the kernel still wrote to it meanwhile."""
    same = False
    while not same:
        subprocess.run(["cp", "--sparse=always", str(image), str(copy)], check=True)
        same = subprocess.run(["cmp", "-s", str(image), str(copy)], check=False).returncode == 0


def _check_after_power_cut(data: Path, journal: Journal) -> list[str]:
    try:
        return check_acknowledged(Settings(data_dir=data), journal)
    except Exception as error:  # noqa: BLE001 - a database that cannot be read has lost everything
        return [f"I1 the database cannot be read: {error}"]


def _make_disk(image: Path) -> None:
    with image.open("wb") as file:
        file.truncate(DISK_BYTES)
    subprocess.run(
        ["mkfs.ext4", "-q", "-F", "-E", "lazy_itable_init=0,lazy_journal_init=0", str(image)], check=True
    )


@contextmanager
def _mounted(image: Path, at: Path) -> Iterator[Path]:
    at.mkdir()
    subprocess.run(["mount", "-o", "loop,commit=300", str(image), str(at)], check=True)
    try:
        yield at
    finally:
        subprocess.run(["umount", str(at)], check=True)
        at.rmdir()
