"""Keys: each recording has one of its own, wrapped by the organisation's.

    data_dir/organisation.key     the organisation's key, base64 (or the file of ``ACROMION_KEY_FILE``)
    data_dir/keys/organisation    which organisation's key wrapped the others
    data_dir/keys/<recording>     one wrapped key: a few dozen bytes

Where the rows are in PostgreSQL, the wrapped keys are in a table beside them instead
(:mod:`app.storage.key_table`), so that every machine reaches them. No backup of the rows or files holds them.

To erase a recording is to destroy its key: every copy of its bytes, also in places that nobody can reach,
opens no more.
"""

import base64
import binascii
import importlib
import os
import secrets
import threading
from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import AESGCM
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.kdf.hkdf import HKDF

from app.errors import KeyFileMissing, KeyGone, KeyMismatch
from app.storage.erasures import FolderLedger, Ledger
from app.storage.permissions import create_file, make_folder
from app.storage.store import BrokenSeal, sync_folder, translate_disk_full

if TYPE_CHECKING:  # an analysis uses this module without the settings, and without pydantic
    from app.settings import Settings

KEY_BYTES, NONCE_BYTES, TAG_BYTES, FINGERPRINT_BYTES = 32, 12, 16, 8
VERSION = b"\x01"
"""The first byte of a wrapped key and of what :meth:`RecordingKey.seal` gives."""
ORGANISATION = "organisation"
"""The name, among the wrapped keys, of the fingerprint of the key that wrapped them."""
RECORDING = "rec_"
"""The names of all keys of recordings begin so; others are those of labels, views, accounts."""
KEY_FILE, LEDGER_FILE = "organisation.key", "erasures.jsonl"


@dataclass(frozen=True, slots=True)
class RecordingKey:
    """The key of one recording; what it sealed opens with it alone."""

    id: str
    secret: bytes = field(repr=False)

    def seal(self, content: bytes, about: str) -> bytes:
        """Seal something small; ``about`` says what it is (``side file``, ``subject``), and is bound to it.

        Larger things are sealed in pieces (:mod:`app.storage.sealed`).
        """
        nonce = secrets.token_bytes(NONCE_BYTES)
        small = AESGCM(self.derive(b"", b"small"))
        return VERSION + nonce + small.encrypt(nonce, content, self._bind(about))

    def open(self, sealed: bytes, about: str) -> bytes:
        """Open what :meth:`seal` gave, for the same ``about``.

        Raises
        ------
        BrokenSeal
        """
        nonce, body = sealed[1 : 1 + NONCE_BYTES], sealed[1 + NONCE_BYTES :]
        if sealed[:1] != VERSION or len(body) < TAG_BYTES:
            raise BrokenSeal
        try:
            return AESGCM(self.derive(b"", b"small")).decrypt(nonce, body, self._bind(about))
        except InvalidTag:
            raise BrokenSeal from None

    def derive(self, salt: bytes, purpose: bytes) -> bytes:
        """Derive the 32 bytes of a key for one purpose (HKDF-SHA256)."""
        return HKDF(SHA256(), KEY_BYTES, salt, b"acromion " + purpose).derive(self.secret)

    def _bind(self, about: str) -> bytes:
        return f"{self.id}\n{about}".encode()


@dataclass(frozen=True, slots=True)
class OrganisationKey:
    """The key that wraps those of the recordings."""

    secret: bytes = field(repr=False)

    @property
    def fingerprint(self) -> bytes:
        """Eight bytes by which this key is told from another; they say nothing about it."""
        return HKDF(SHA256(), FINGERPRINT_BYTES, None, b"acromion fingerprint").derive(self.secret)

    def wrap(self, key: RecordingKey) -> bytes:
        """Wrap a recording's key; the recording's id is bound to it."""
        nonce = secrets.token_bytes(NONCE_BYTES)
        body = AESGCM(self.secret).encrypt(nonce, key.secret, key.id.encode())
        return VERSION + self.fingerprint + nonce + body

    def unwrap(self, recording_id: str, wrapped: bytes) -> RecordingKey:
        """Give the key in ``wrapped``.

        Raises
        ------
        BrokenSeal
            It is damaged, another recording's, or another organisation's.
        """
        start = 1 + FINGERPRINT_BYTES
        nonce, body = wrapped[start : start + NONCE_BYTES], wrapped[start + NONCE_BYTES :]
        if wrapped[:1] != VERSION or len(body) != KEY_BYTES + TAG_BYTES:
            raise BrokenSeal
        try:
            return RecordingKey(recording_id, AESGCM(self.secret).decrypt(nonce, body, recording_id.encode()))
        except InvalidTag:
            raise BrokenSeal from None

    def write_text(self) -> str:
        """Give the content of the key's file."""
        return base64.b64encode(self.secret).decode() + "\n"


class WrappedKeys(Protocol):
    """Where wrapped keys are: a folder or a table; every change is durable when the call returns."""

    def add(self, name: str, wrapped: bytes) -> bool:
        """Keep one under a name; False, and nothing changed, where the name has one already."""

    def read(self, name: str) -> bytes | None:
        """Give one; None where there is none."""

    def read_all(self) -> Mapping[str, bytes]:
        """Give all of them by name."""

    def is_empty(self) -> bool:
        """Tell whether no recording has one."""

    def remove(self, names: Collection[str]) -> None:
        """Destroy some: what held them is overwritten; no harm where they are gone."""


@dataclass(frozen=True, slots=True)
class FolderKeys:
    """Wrapped keys as files of a folder: two fsyncs for a new one."""

    folder: Path

    def add(self, name: str, wrapped: bytes) -> bool:
        """Write the file under a name of its own, and link it: whole or not at all."""
        make_folder(self.folder)
        part = self.folder / f"{name}.{secrets.token_hex(8)}.part"
        try:
            with translate_disk_full(), create_file(part) as file:
                file.write(wrapped)
                file.flush()
                os.fsync(file.fileno())
            os.link(part, self.folder / name)
        except FileExistsError:
            return False
        finally:
            part.unlink(missing_ok=True)
        sync_folder(self.folder)
        return True

    def read(self, name: str) -> bytes | None:
        """Read the file."""
        try:
            return (self.folder / name).read_bytes()
        except FileNotFoundError:
            return None

    def read_all(self) -> Mapping[str, bytes]:
        """Read every file."""
        names = os.listdir(self.folder) if self.folder.is_dir() else []  # noqa: PTH208 - names are all we need
        found = ((name, self.read(name)) for name in sorted(names) if not name.endswith(".part"))
        return {name: wrapped for name, wrapped in found if wrapped is not None}

    def is_empty(self) -> bool:
        """Look for any file of a recording."""
        if not self.folder.is_dir():
            return True
        with os.scandir(self.folder) as entries:
            return not any(entry.name.startswith(RECORDING) for entry in entries)

    def remove(self, names: Collection[str]) -> None:
        """Overwrite each file with random bytes, then remove it."""
        for name in names:
            path = self.folder / name
            with suppress(FileNotFoundError), path.open("r+b") as file:
                file.write(secrets.token_bytes(path.stat().st_size))
                file.flush()
                os.fsync(file.fileno())
            path.unlink(missing_ok=True)
        if names and self.folder.is_dir():
            sync_folder(self.folder)


@dataclass(slots=True)
class KeyStore:
    """The keys of all recordings. Nothing is kept in memory: a destroyed key is gone for every process."""

    wrapped: WrappedKeys
    ledger: Ledger
    key_file: Path
    may_create: bool = True
    """Whether a missing organisation's key is made, where it has wrapped nothing yet."""
    _organisation: OrganisationKey | None = field(default=None, repr=False)
    _lock: threading.Lock = field(default_factory=threading.Lock, repr=False)

    @property
    def organisation(self) -> OrganisationKey:
        """The organisation's key, read once; made at its first use.

        Raises
        ------
        KeyFileMissing, KeyMismatch
        """
        with self._lock:
            if self._organisation is None:
                self._organisation = self._load()
            return self._organisation

    def check(self) -> None:
        """Check that the organisation's key is there and the one that it was.

        Raises
        ------
        KeyFileMissing, KeyMismatch
        """
        _ = self.organisation

    def new(self, recording_id: str) -> RecordingKey:
        """Make a key that is nowhere but in memory, until :meth:`keep`."""
        return RecordingKey(recording_id, secrets.token_bytes(KEY_BYTES))

    def keep(self, key: RecordingKey) -> RecordingKey:
        """Make a key durable; gives the one that counts, where a peer was quicker."""
        if self.wrapped.add(key.id, self.organisation.wrap(key)):
            return key
        return self.get(key.id)

    def create(self, recording_id: str) -> RecordingKey:
        """Make the key of a recording, durable when this returns; gives the one it has already, if any."""
        return self.find(recording_id) or self.keep(self.new(recording_id))

    def find(self, recording_id: str) -> RecordingKey | None:
        """Give the key of a recording; None where there is none, or none that opens.

        Raises
        ------
        KeyFileMissing, KeyMismatch
        """
        wrapped = self.wrapped.read(recording_id)
        if wrapped is None:
            return None
        try:
            return self.organisation.unwrap(recording_id, wrapped)
        except BrokenSeal:
            return None

    def get(self, recording_id: str) -> RecordingKey:
        """Give the key of a recording.

        Raises
        ------
        KeyGone, KeyFileMissing, KeyMismatch
        """
        found = self.find(recording_id)
        if found is None:
            raise KeyGone(id=recording_id)
        return found

    def find_all(self) -> Mapping[str, RecordingKey]:
        """Give every key at once, for an index that is held in memory."""
        found = {}
        for name, wrapped in self._read_recordings():
            with suppress(BrokenSeal):
                found[name] = self.organisation.unwrap(name, wrapped)
        return found

    def erase(self, *recording_ids: str) -> None:
        """Enter recordings in the ledger of erasures, then destroy their keys."""
        self.ledger.append(recording_ids)
        self.destroy(*recording_ids)

    def find_erased(self) -> frozenset[str]:
        """Give the id of every recording that was erased."""
        return frozenset(entry.id for entry in self.ledger.read())

    def destroy(self, *recording_ids: str) -> None:
        """Destroy keys for good; no harm where they are gone."""
        self.wrapped.remove(recording_ids)

    def export(self) -> Iterator[tuple[str, bytes]]:
        """Give every wrapped key with the id of its recording."""
        yield from self._read_recordings()

    def import_wrapped(self, entries: Mapping[str, bytes], wrapper: OrganisationKey | None = None) -> int:
        """Add wrapped keys that are neither here nor erased; gives their number.

        ``wrapper``: the key that wrapped them, where it is not this organisation's; they are wrapped anew.

        Raises
        ------
        BrokenSeal
            One of them is damaged, or was wrapped by another key than that.
        """
        wrapper, erased = wrapper or self.organisation, self.find_erased()
        keys = [wrapper.unwrap(name, wrapped) for name, wrapped in entries.items() if name not in erased]
        return sum(self.wrapped.add(key.id, self.organisation.wrap(key)) for key in keys)

    def _read_recordings(self) -> Iterator[tuple[str, bytes]]:
        yield from ((name, one) for name, one in self.wrapped.read_all().items() if name != ORGANISATION)

    def _load(self) -> OrganisationKey:
        known = self.wrapped.read(ORGANISATION)
        organisation = read_key_file(self.key_file)
        if organisation is None:
            if known is not None or not self.may_create:
                raise KeyFileMissing(file=str(self.key_file))
            organisation = create_key_file(self.key_file)
        if known is None and not self.wrapped.add(ORGANISATION, organisation.fingerprint):
            known = self.wrapped.read(ORGANISATION)
        if known not in (None, organisation.fingerprint):
            raise KeyMismatch(file=str(self.key_file))
        return organisation


def open_keys(settings: "Settings") -> KeyStore:
    """Open the keys of the settings; nothing is created before the first use."""
    key_file = settings.key_file or settings.data_dir / KEY_FILE
    wrapped, ledger = _open_places(settings)
    return KeyStore(wrapped, ledger, key_file, may_create=settings.key_file is None)


def _open_places(settings: "Settings") -> tuple[WrappedKeys, Ledger]:
    if settings.database_url.startswith("sqlite"):
        return FolderKeys(settings.data_dir / "keys"), FolderLedger(settings.data_dir / LEDGER_FILE)
    tables = importlib.import_module("app.storage.key_table")
    wrapped = tables.TableKeys(settings.database_url)
    return wrapped, tables.TableLedger(wrapped)


def read_key_file(path: Path) -> OrganisationKey | None:
    """Read the organisation's key; None where there is no file.

    Raises
    ------
    KeyFileMissing
        The file holds no key.
    """
    try:
        secret = base64.b64decode(path.read_text("ascii").strip(), validate=True)
    except FileNotFoundError:
        return None
    except (ValueError, binascii.Error):
        secret = b""
    if len(secret) != KEY_BYTES:
        raise KeyFileMissing(file=str(path))
    return OrganisationKey(secret)


def create_key_file(path: Path) -> OrganisationKey:
    """Make the organisation's key, durable when this returns; gives a peer's that was quicker."""
    organisation = OrganisationKey(secrets.token_bytes(KEY_BYTES))
    make_folder(path.parent)
    part = path.with_name(f"{path.name}.{secrets.token_hex(8)}.part")
    try:
        with create_file(part) as file:
            file.write(organisation.write_text().encode())
            file.flush()
            os.fsync(file.fileno())
        os.link(part, path)
    except FileExistsError:
        return read_key_file(path) or organisation
    finally:
        part.unlink(missing_ok=True)
    sync_folder(path.parent)
    return organisation
