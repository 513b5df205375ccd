"""The drill: a backup is restored into a folder of its own, and read.

Nothing of this installation is used: what the drill cannot open, nobody could after a fire.
"""

import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from app.settings import Settings
from app.upkeep.backup import restore
from app.upkeep.verify import Fault, find_faults, find_kept


@dataclass(frozen=True, slots=True)
class Drilled:
    """How many files were restored and read, what is wrong with them, and how long it took."""

    files: int
    faults: tuple[Fault, ...]
    minutes: float


def drill(backup: Path, identity: Path | None = None, place: Path | None = None) -> Drilled:
    """Restore into a temporary folder (in ``place``, else beside the backup), and read every byte.

    Raises BackupRefused, WrongSchema, DiskFull, NotInstalled.
    """
    begun_s = time.monotonic()
    with tempfile.TemporaryDirectory(
        prefix="acromion-drill-", dir=place or backup.resolve().parent
    ) as folder:
        data_dir = Path(folder)
        settings = Settings(
            data_dir=data_dir,
            database_url=f"sqlite:///{data_dir / 'acromion.sqlite3'}",
            object_store="",
            engine="embedded",
        )
        restored = restore(settings, backup, identity)
        kept = find_kept(settings)
        found = {*restored.faults, *find_faults(settings, kept)}
        faults = tuple(sorted(found, key=lambda fault: fault.name))
        return Drilled(len(kept), faults, (time.monotonic() - begun_s) / 60)
