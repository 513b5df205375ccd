"""How long backups can still contain what was erased: what ``acromion backup`` writes down, and what follows.

backups.json    {"keep": number of kept backups or null, "made_at": [when the kept ones were made]}

Once a backup was made that nothing deletes (without ``--keep``), ``keep`` stays null: delete that
backup, then this file.
"""

import json
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Literal

from app.store.folder import Storage

FILE = "backups.json"
USUAL = timedelta(days=1)
"""The time between two backups where only one is known."""


@dataclass(frozen=True, slots=True)
class BackupTerm:
    """``none``: no backup is known; ``until`` a date; ``unlimited``: nothing deletes old backups."""

    kind: Literal["none", "until", "unlimited"]
    until: str = ""


def record_backup(storage: Storage, keep: int | None) -> None:
    """Write down that a backup was made."""
    kept, before = _read(storage)
    if before and kept is None:
        keep = None
    made_at = [*before, datetime.now(UTC).isoformat(timespec="seconds")]
    content = {"keep": keep, "made_at": made_at[-(keep or 2) :]}
    storage.write_small(FILE, json.dumps(content).encode())


def find_backup_term(storage: Storage) -> BackupTerm:
    """Return until when backups can contain what is erased now.

    The newest backup is deleted once as many further ones are made as are kept: at the pace of those known,
    and at most one a day.
    """
    keep, made_at = _read(storage)
    if not made_at:
        return BackupTerm("none")
    if keep is None:
        return BackupTerm("unlimited")
    moments = [datetime.fromisoformat(one) for one in made_at]
    between = (moments[-1] - moments[0]) / (len(moments) - 1) if len(moments) > 1 else USUAL
    return BackupTerm("until", (moments[-1] + keep * max(between, USUAL) + USUAL).date().isoformat())


def _read(storage: Storage) -> tuple[int | None, list[str]]:
    try:
        found = json.loads(storage.read_small(FILE) or b"{}")
        return found.get("keep"), list(found.get("made_at", ()))
    except ValueError:
        return None, []
