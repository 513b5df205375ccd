"""The backup of the keys, apart from that of rows and files, which opens with it alone.

One JSON line that says what it is, then one for each wrapped key. With it go the ledger of erasures and the
organisation's key, unless the administrator keeps that in a file of his own (``ACROMION_KEY_FILE``). After an
erasure it is replaced: an older one still holds the erased key.
"""

import base64
import json
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from app.errors import BackupRefused, KeyGone
from app.settings import Settings
from app.storage.keys import KeyStore, OrganisationKey, RecordingKey, open_keys
from app.storage.store import BrokenSeal
from app.upkeep.envelope import Recipients, read_envelope, write_envelope

FORMAT = "acromion.keys/1"


@dataclass(frozen=True, slots=True)
class KeyBackup:
    """What a backup of the keys holds."""

    wrapped: Mapping[str, bytes]
    erased: tuple[str, ...]
    organisation: OrganisationKey | None

    def get(self, recording_id: str) -> RecordingKey:
        """Give the key of a recording.

        Raises
        ------
        KeyGone
        """
        wrapped = self.wrapped.get(recording_id)
        if wrapped is None or self.organisation is None:
            raise KeyGone(id=recording_id)
        try:
            return self.organisation.unwrap(recording_id, wrapped)
        except BrokenSeal:
            raise KeyGone(id=recording_id) from None


def back_up_keys(settings: Settings, path: Path, recipients: Recipients) -> int:
    """Write every wrapped key; gives their number.

    Raises
    ------
    BackupRefused, KeyFileMissing, KeyMismatch, DiskFull, NotInstalled
    """
    keys = open_keys(settings)
    head: dict[str, Any] = {"format": FORMAT, "made_at": datetime.now(UTC).isoformat(timespec="seconds")}
    head["erased"] = [entry.id for entry in keys.ledger.read()]
    head["organisation"] = None if settings.key_file else keys.organisation.write_text().strip()
    entries = list(keys.export())
    with write_envelope(path, recipients) as file:
        file.write(json.dumps(head).encode() + b"\n")
        for name, wrapped in entries:
            file.write(
                json.dumps({"id": name, "wrapped": base64.b64encode(wrapped).decode()}).encode() + b"\n"
            )
    return len(entries)


def read_key_backup(path: Path, identity: Path | None = None) -> KeyBackup:
    """Read a backup of the keys.

    Raises
    ------
    BackupRefused
    """
    try:
        with read_envelope(path, identity) as file:
            head = json.loads(file.readline())
            if head["format"] != FORMAT:
                raise BackupRefused(why=str(head["format"])[:80])
            rows = [json.loads(line) for line in file]
        wrapped = {str(row["id"]): base64.b64decode(row["wrapped"]) for row in rows}
        secret = head["organisation"]
        organisation = None if secret is None else OrganisationKey(base64.b64decode(secret))
        return KeyBackup(wrapped, tuple(map(str, head["erased"])), organisation)
    except (KeyError, TypeError, ValueError, OSError) as error:
        raise BackupRefused(why=f"{path.name}: {error}"[:200]) from error


def import_key_backup(keys: KeyStore, found: KeyBackup) -> int:
    """Enter its erasures, then add the keys that are neither here nor erased; gives their number.

    Raises
    ------
    BackupRefused
        The organisation's key that wrapped them is neither here nor in it.
    """
    if found.erased:
        keys.ledger.append(found.erased)
        keys.destroy(*found.erased)
    try:
        return keys.import_wrapped(found.wrapped, found.organisation)
    except BrokenSeal:
        raise BackupRefused(why=str(keys.key_file)) from None
