"""Backups encrypted to recipients (age, https://age-encryption.org), and read again with an identity.

Whoever makes a backup needs no secret for that: a recipient (``age1...``) is public. The identity
(``AGE-SECRET-KEY-1...``, in a file of ``age-keygen``) is kept by the person who restores, away from this
machine. The library is in the extra ``trust``.
"""

import os
import tempfile
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from app.errors import BackupRefused
from app.storage.open import load_extra
from app.storage.permissions import create_file
from app.storage.store import sync_file, sync_folder, translate_disk_full

MAGIC = b"age-encryption.org/v1\n"


@dataclass(frozen=True, slots=True)
class Recipients:
    """Whom a backup is encrypted to; none: it is written in clear."""

    names: tuple[str, ...] = ()

    def parse(self) -> list[Any]:
        """Give them as the library takes them. Raises BackupRefused: one of them is none."""
        x25519 = load_extra("pyrage").x25519
        found = []
        for name in self.names:
            try:
                found.append(x25519.Recipient.from_str(name.strip()))
            except Exception:  # noqa: BLE001 - the library's errors have no common class
                raise BackupRefused(why=f"--recipient {name[:80]}: age1...") from None
        return found


@contextmanager
def write_envelope(path: Path, recipients: Recipients) -> Iterator[IO[bytes]]:
    """Write a file that is there whole at the end of the block, or not at all; it cannot be sought in.

    Raises BackupRefused, DiskFull, NotInstalled.
    """
    if path.exists():
        raise BackupRefused(why=f"{path} exists")
    known = recipients.parse() if recipients.names else []
    part = path.with_name(f"{path.name}.part")
    part.unlink(missing_ok=True)
    try:
        with translate_disk_full():
            with _create(part) as file:
                if known:
                    with _encrypting(file, known) as pipe:
                        yield pipe
                else:
                    yield file
            sync_file(part)
            part.rename(path)
            sync_folder(path.resolve().parent)
    finally:
        part.unlink(missing_ok=True)


def _create(part: Path) -> IO[bytes]:
    try:
        return create_file(part)
    except (FileNotFoundError, PermissionError, NotADirectoryError) as error:
        raise BackupRefused(why=f"{part.parent}: {error.strerror}") from error


@contextmanager
def _encrypting(file: IO[bytes], recipients: Sequence[Any]) -> Iterator[IO[bytes]]:
    """Encrypt what is written, in a thread beside the writer: nothing of it touches the disk in clear."""
    read_end, write_end = os.pipe()
    trouble: list[BaseException] = []

    def encrypt() -> None:
        try:
            with os.fdopen(read_end, "rb") as source:
                load_extra("pyrage").encrypt_io(source, file, list(recipients))
        except BaseException as error:  # noqa: BLE001 - it is raised again where it was waited for
            trouble.append(error)

    thread = threading.Thread(target=encrypt, name="encrypt")
    thread.start()
    try:
        with os.fdopen(write_end, "wb") as pipe:
            yield pipe
    except BrokenPipeError:
        thread.join()
        raise trouble[0] from None
    finally:
        thread.join()
    if trouble:
        raise trouble[0]


@contextmanager
def read_envelope(path: Path, identity: Path | None = None) -> Iterator[IO[bytes]]:
    """Open a file for reading; one that is encrypted is decrypted into a temporary file without a name.

    Raises BackupRefused: it is encrypted, and no identity is given, or one that does not open it.
    """
    with path.open("rb") as file:
        is_encrypted = file.read(len(MAGIC)) == MAGIC
        file.seek(0)
        if not is_encrypted:
            yield file
            return
        if identity is None:
            raise BackupRefused(why=f"{path.name}: age, --identity FILE")
        with translate_disk_full(), tempfile.TemporaryFile(dir=path.resolve().parent) as clear:
            _decrypt(file, clear, identity)
            clear.seek(0)
            yield clear


def _decrypt(file: IO[bytes], clear: IO[bytes], identity: Path) -> None:
    pyrage = load_extra("pyrage")
    lines = [line.strip() for line in identity.read_text("utf-8").splitlines()]
    try:
        known = [pyrage.x25519.Identity.from_str(line) for line in lines if line and not line.startswith("#")]
        pyrage.decrypt_io(file, clear, known)
    except Exception as error:
        if isinstance(error, OSError) and error.errno is not None:
            raise
        raise BackupRefused(why=f"--identity {identity.name}: {error}"[:200]) from error
