"""Seal what an earlier release stored in clear, a little at a time, while the server runs.

A file is replaced only after what was sealed has been read again and found to be what the row says; a damaged
one stays as it is, for ``acromion verify`` names it. Whoever reads a file meanwhile goes on with the copy he
has.
"""

import logging
from collections.abc import Iterator
from dataclasses import dataclass, field

from app.errors import KeyGone
from app.jobs.side_files import SideWriter
from app.jobs.store import JobStore
from app.settings import Settings
from app.storage.sealing import SealedStorage
from app.storage.store import format_side_file_name
from app.upkeep.verify import KeptFile, find_kept

FILES_AT_ONCE = 20

logger = logging.getLogger(__name__)


@dataclass(slots=True)
class EarlierFiles:
    """What is still to be looked at; nothing in clear comes while this release serves."""

    settings: Settings
    store: JobStore
    storage: SealedStorage
    side_files: SideWriter
    sealed: int = 0
    _left: Iterator[KeptFile] | None = field(default=None)

    def seal_next(self) -> bool:
        """Look at the next few files, and seal those in clear; False when none is left."""
        if self._left is None:
            self._left = iter(find_kept(self.settings))
        for _ in range(FILES_AT_ONCE):
            file = next(self._left, None)
            if file is None:
                if self.sealed:
                    logger.info("%d files of an earlier release are sealed now", self.sealed)
                return False
            self._seal(file)
        return True

    def _seal(self, file: KeptFile) -> None:
        kind, name = file.name.split("/")[:2]
        recording_id = name if kind == "recordings" else self.store.find_recording(name)
        if not recording_id:  # the analysis was deleted meanwhile
            return
        try:
            is_new = self.storage.seal(file.name, recording_id, file.sha256)
            if kind == "recordings" and not self.storage.is_small_sealed(format_side_file_name(name)):
                self.side_files.write(name)
        except KeyGone:  # erased meanwhile
            return
        self.sealed += is_new
        if is_new and self._is_gone(recording_id):  # erased while its copy was written
            self.storage.drop_recording(recording_id)
            self.storage.drop_analysis(name)

    def _is_gone(self, recording_id: str) -> bool:
        erased = self.storage.keys.find_erased()
        return recording_id in erased or not self.store.may_hold(recording_id)
