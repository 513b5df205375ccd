"""The files of a server's live sessions, in their folder ``live``.

live-<session>.raw      the raw file (:mod:`app.live.raw_file`), until it is a recording
live-<session>.early    what came before the raw file had it (:mod:`app.live.early`), for some seconds
replay-<session>.raw    the raw file of a session that is not kept
"""

import secrets
from dataclasses import dataclass
from pathlib import Path

from app.storage.permissions import make_folder

KEPT, PLAYED = "live-", "replay-"
RAW, EARLY = ".raw", ".early"


@dataclass(frozen=True, slots=True)
class SessionFiles:
    """The id of a session, and where its files are."""

    folder: Path
    session_id: str
    is_kept: bool

    @property
    def raw(self) -> Path:
        """The raw file."""
        return self.folder / f"{KEPT if self.is_kept else PLAYED}{self.session_id}{RAW}"

    @property
    def early(self) -> Path:
        """What came before."""
        return self.folder / f"{KEPT}{self.session_id}{EARLY}"

    def remove(self) -> None:
        """Remove the files."""
        self.early.unlink(missing_ok=True)
        self.raw.unlink(missing_ok=True)


def begin_files(folder: Path, *, keeps: bool) -> SessionFiles:
    """Choose the id of a session, and create the folder."""
    make_folder(folder)
    return SessionFiles(folder, secrets.token_urlsafe(12), keeps)


def find_left(folder: Path) -> tuple[SessionFiles, ...]:
    """Find the files of sessions that are to be kept and that a killed server left."""
    names = {path.stem for ending in (RAW, EARLY) for path in folder.glob(f"{KEPT}*{ending}")}
    return tuple(SessionFiles(folder, name.removeprefix(KEPT), is_kept=True) for name in sorted(names))
