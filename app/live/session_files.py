"""The files of a server's live sessions, in their folder ``live``, sealed as they grow.

    live-<session>.raw      the raw file (:mod:`app.live.raw_file`), until it is a recording
    live-<session>.early    what came before the raw file had it (:mod:`app.live.early`), for some seconds
    replay-<session>.raw    the raw file of a session that is not kept

The key of a session is its own: durable before its first byte, destroyed with its files. That of a session
which is not kept is in memory alone: what a kill leaves of it opens no more.
"""

import secrets
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from app.storage.keys import KeyStore, RecordingKey
from app.storage.permissions import make_folder
from app.storage.sealed import HEAD_BYTES, measure_grown, read_growing, read_head
from app.storage.store import BrokenSeal

KEPT, PLAYED = "live-", "replay-"
RAW, EARLY = ".raw", ".early"


@dataclass(frozen=True, slots=True)
class SessionFiles:
    """The id of a session, its key, and where its files are."""

    folder: Path
    session_id: str
    key: RecordingKey
    is_kept: bool

    @property
    def raw(self) -> Path:
        """The raw file."""
        return self.folder / f"{KEPT if self.is_kept else PLAYED}{self.session_id}{RAW}"

    @property
    def early(self) -> Path:
        """What came before."""
        return self.folder / f"{KEPT}{self.session_id}{EARLY}"

    def remove(self, keys: KeyStore) -> None:
        """Remove the files, then destroy the key."""
        self.early.unlink(missing_ok=True)
        self.raw.unlink(missing_ok=True)
        if self.is_kept:
            keys.destroy(self.key.id)


def begin_files(folder: Path, keys: KeyStore, *, keeps: bool) -> SessionFiles:
    """Choose the id of a session and make its key.

    Raises
    ------
    OSError, DiskFull, KeyFileMissing, KeyMismatch
    """
    make_folder(folder)
    session_id = secrets.token_urlsafe(12)
    key = keys.new(_name_key(session_id))
    return SessionFiles(folder, session_id, keys.keep(key) if keeps else key, keeps)


def find_left(folder: Path) -> tuple[str, ...]:
    """Find the ids of the sessions that are to be kept and whose files a killed server left."""
    names = {path.stem for ending in (RAW, EARLY) for path in folder.glob(f"{KEPT}*{ending}")}
    return tuple(sorted(name.removeprefix(KEPT) for name in names))


def open_left(folder: Path, keys: KeyStore, session_id: str) -> SessionFiles:
    """Give the files of such a session with their key.

    Raises
    ------
    KeyGone, KeyFileMissing, KeyMismatch
    """
    return SessionFiles(folder, session_id, keys.get(_name_key(session_id)), is_kept=True)


def read_unfinished(path: Path, key: RecordingKey | None) -> Iterator[bytes]:
    """Give what a file that was never closed holds, piece by piece; it is sealed where there is a key.

    Raises
    ------
    OSError, BrokenSeal
    """
    with path.open("rb") as file:
        if key is None:
            yield file.read()
            return
        head = read_head(file.read(HEAD_BYTES))
        if head is None:
            raise BrokenSeal
        yield from read_growing(file, key, head, measure_grown(path.stat().st_size))


def has_content(path: Path) -> bool:
    """Whether a sealed file holds anything."""
    return measure_grown(path.stat().st_size) > 0


def _name_key(session_id: str) -> str:
    return f"live_{session_id}"
