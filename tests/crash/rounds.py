"""The rounds: kills at random instants, and power cuts of a loop-mounted disk."""

import math
import os
import random
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from sqlalchemy import select

from acromion.app.errors import NotEmpty
from acromion.app.library.claims import DatabaseClock
from acromion.app.library.database.tables import analyses
from acromion.app.library.jobs import JobStore
from acromion.app.library.rows import JobState
from acromion.app.settings import Settings
from tests import ROOT
from tests.crash.harness import (
    PARTS,
    Clients,
    Journal,
    Site,
    check_acknowledged,
    check_settled,
    count_blamed,
    find_litter,
)
from tests.crash.stores import run_command
from tests.ways_in.servers import wait_for

DISK_BYTES = 96 << 20
RESTORED_UPLOADS_S = 4.0


@dataclass
class Result:
    """What some rounds came to.

    ``cut``: analyses that lost their worker by a kill, or restores killed before their end; ``set_aside``:
    analyses that ended as E-INTERRUPTED and succeeded when asked for again; ``blamed``: analyses that ended
    as E-CRASHED.
    """

    acknowledged: int = 0
    broken: list[str] = field(default_factory=list)
    cut: int = 0
    set_aside: int = 0
    blamed: int = 0


def can_cut_power() -> bool:
    """Return whether a disk can be made and mounted here (Linux, root, loop devices)."""
    tools = all(shutil.which(name) for name in ("mkfs.ext4", "mount", "umount"))
    return sys.platform == "linux" and os.geteuid() == 0 and tools and Path("/dev/loop-control").exists()


def kill_rounds(folder: Path, rounds: int, seed: int) -> Result:
    """Kill in every round: in every second one everything, while analyses run; in the others one part."""
    dice, journal, broken = random.Random(seed), Journal(), list[str]()
    site = Site(folder / "data", folder / "log", workers=2)
    clients = Clients(site, journal, seed, waits=True)
    try:
        clients.wait_for_first()
        for round_ in range(rounds):
            time.sleep(dice.uniform(0.2, 1.5))
            if round_ % 2:
                _kill_one(site, journal, dice)
            else:
                _kill_all_at_work(site, journal, dice)
            time.sleep(dice.uniform(0, 0.3))
            site.start()
            broken += check_acknowledged(site.settings, journal)
        clients.stop()
        site.kill("all", dice)  # what is left half-made now is swept by the start
        site.start()
        broken += check_settled(site.settings, journal)
    finally:
        site.end()
        clients.stop()
    cut = journal.cuts.total()
    return Result(len(journal.recordings), broken, cut, len(journal.retried), count_blamed(site.settings))


def _kill_one(site: Site, journal: Journal, dice: random.Random) -> None:
    victim = dice.choice(PARTS)
    site.kill(victim, dice)
    if victim == "worker":
        _count_cut(site.settings, journal)


def _kill_all_at_work(site: Site, journal: Journal, dice: random.Random) -> None:
    """Kill everything at a random instant of an analysis; again, when it had ended just before."""
    while True:
        store = JobStore(site.settings)
        wait_for(partial(_is_at_work, site, store), math.inf)
        store.close()
        time.sleep(dice.uniform(0, 0.1))
        site.kill("all", dice)
        if _count_cut(site.settings, journal):
            return
        site.start()


def _is_at_work(site: Site, store: JobStore) -> bool:
    site.check_lives()
    return bool(_find_held(store))


def _find_held(store: JobStore) -> list[str]:
    """Return the analyses whose worker gave a sign of life in the last seconds."""
    is_fresh = analyses.c.lease_until_s > DatabaseClock() + Settings().lease_s - 2.5
    query = select(analyses.c.id).where(analyses.c.state == JobState.RUNNING, is_fresh)
    with store.reader.connect() as connection:
        return list(connection.execute(query).scalars())


def _count_cut(settings: Settings, journal: Journal) -> int:
    """Write down which analyses have just lost their worker."""
    store = JobStore(settings)
    cut = _find_held(store)
    store.close()
    journal.cuts.update(cut)
    return len(cut)


def restore_kills(folder: Path, rounds: int, seed: int) -> Result:
    """Kill a restore in every round at a random instant, run it again, and check the restored files."""
    dice, journal, broken, cut = random.Random(seed), Journal(), list[str](), 0
    site, backup = Site(folder / "data", folder / "log", workers=2), folder / "backup.zip"
    clients = Clients(site, journal, seed, waits=True)
    try:
        clients.wait_for_first()
        time.sleep(RESTORED_UPLOADS_S)
        clients.stop()
        broken += check_settled(site.settings, journal)
        made = run_command("backup", backup, "--data", site.settings.data_dir)
        assert made.exit_code == 0, made.output
    finally:
        site.end()
        clients.stop()
    length_s = _time_restore(folder / "whole", backup)
    for _ in range(rounds):
        data = folder / "restored"
        with _restoring(data, backup) as restore:
            time.sleep(dice.uniform(0, length_s))
            restore.kill()
            cut += restore.wait() < 0
        again = run_command("restore", backup, "--data", data)
        finished = again.exit_code == 0 or again.code == NotEmpty.code  # the kill came after the last row
        broken += [] if finished else [f"R {again.output.strip()[-200:]}"]
        settings = Settings(data_dir=data, min_free_bytes=0)
        broken += check_acknowledged(settings, journal) + find_litter(settings)
        shutil.rmtree(data)
    return Result(len(journal.recordings), broken, cut)


def _time_restore(data: Path, backup: Path) -> float:
    """Return how long a restore works, without its imports."""
    with _restoring(data, backup) as restore:
        begun_s = time.monotonic()
        assert restore.wait() == 0
    return time.monotonic() - begun_s


@contextmanager
def _restoring(data: Path, backup: Path) -> Iterator[subprocess.Popen[bytes]]:
    """Start a restore and wait until it writes."""
    command = [sys.executable, "-m", "acromion", "restore", str(backup), "--data", str(data)]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL) as restore:
        wait_for(data.exists, math.inf)
        yield restore


def power_cut(folder: Path, seed: int, sync: str = "synced") -> Result:
    """Cut the power at a random instant after the first acknowledgement."""
    dice, journal = random.Random(seed), Journal()
    image, copy = folder / "disk.img", folder / "copy.img"
    _make_disk(image)
    with _mounted(image, folder / "disk") as disk:
        site = Site(disk / "data", folder / "log", sync)
        clients = Clients(site, journal, seed)
        try:
            clients.wait_for_first()
            time.sleep(dice.uniform(0.0, 2.0))
            site.freeze()
            _copy_at_rest(image, copy)
        finally:
            site.end()
            clients.stop()
    with _mounted(copy, folder / "after") as disk:
        broken = _check_after_power_cut(disk / "data", journal)
    image.unlink()
    copy.unlink()
    return Result(len(journal.recordings), broken)


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
