"""A reserve of disk space: on a full disk, reading, deleting and purging still write a little.

    root/reserve     is removed when a request finds the disk full, and created again once there is room

Readings and deletions add lines to the audit log and the ledger of erasures. Uploads and analyses may not use
this space: both are refused or delayed earlier.
"""

import os
import shutil
from contextlib import suppress
from pathlib import Path

from acromion.app.store.permissions import create_file

RESERVE_FILE = "reserve"
RESERVE_BYTES = 16 << 20
FULL_BYTES = RESERVE_BYTES // 2
"""With less free space the disk counts as full."""


def free_reserve(root: Path) -> None:
    """Remove the reserve if the disk is full, and the decoded samples if it is still full then."""
    with suppress(OSError):
        if shutil.disk_usage(root).free >= FULL_BYTES:
            return
        (root / RESERVE_FILE).unlink(missing_ok=True)
        if shutil.disk_usage(root).free < FULL_BYTES:
            for path in (root / "cache").glob("rec_*"):
                path.unlink(missing_ok=True)


def keep_reserve(root: Path) -> None:
    """Create the reserve if there is ample room."""
    path = root / RESERVE_FILE
    if path.exists() or shutil.disk_usage(root).free < 4 * RESERVE_BYTES:
        return
    part = root / f"{RESERVE_FILE}.part"
    part.unlink(missing_ok=True)  # of a server that was killed
    try:
        with create_file(part) as file:
            if hasattr(os, "posix_fallocate"):
                os.posix_fallocate(file.fileno(), 0, RESERVE_BYTES)
            else:
                file.write(os.urandom(RESERVE_BYTES))
        part.replace(path)
    except OSError:  # another process used the space, or keeps the reserve
        part.unlink(missing_ok=True)
