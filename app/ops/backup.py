"""Back up and restore: one ZIP with every row and every file, made while the server runs.

 manifest.json            {"format": "acromion.backup/3", "revision", "version", "made_at",
                           "faults": [{"name", "finding": "missing" or "damaged"}]}
 rows/<table>.jsonl       one row per line, all from one transaction, without short-lived rows
                          (sessions, links, failed sign-ins, known browsers)
 files/recordings/<id>    files/analyses/<analysis>/<attempt>/<name>
 erasures.jsonl           the ledger of erasures (:mod:`acromion.app.store.folder`)
 server.key               the secret of the server (:mod:`acromion.app.store.server_secret`)

It can be encrypted as a whole for recipients (age, https://age-encryption.org). Making a backup needs no
secret: a recipient (``age1...``) is public. The person who restores keeps the identity
(``AGE-SECRET-KEY-1...``, in a file of ``age-keygen``), away from this machine. The library is in the extra
``trust``. The newest ledger is stored beside the backups as ``erasures.jsonl``, so that a restored older
backup does not bring back recordings erased before the last backup.

Files never change once a row refers to them, so that they can be copied after the rows were read. If a file
is purged meanwhile the backup starts again. A damaged file is copied as it is; the manifest lists damaged and
missing files.
"""

import hashlib
import json
import os
import re
import tempfile
import threading
import time
import zipfile
import zlib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import IO, Any

from sqlalchemy import Connection, func, insert, select, text

from acromion.app.accounts.accounts import AccountStore
from acromion.app.errors import BackupRefused, NotEmpty, WrongSchema
from acromion.app.library.audit_log import AT_MACHINE, record
from acromion.app.library.database.connect import (
    LEFT_OUT,
    READ_ONLY,
    connect,
    create_tables,
    lock_tables,
    read_revision,
    read_rows,
    reflect_tables,
    reset_row,
    write_all_rows,
)
from acromion.app.library.database.tables import (
    REVISION,
    analyses,
    audit_log,
    facts,
    people,
    purged_uploads,
    schema_revision,
    uploads,
)
from acromion.app.library.jobs import JobStore
from acromion.app.library.recordings import drop_empty_batches
from acromion.app.ops.place import NO_ACCOUNTS, Accounts, find_accounts
from acromion.app.ops.recover import find_unknown, update_side_files
from acromion.app.ops.verify import ExpectedFile, Fault, find_expected, find_faults, find_files, read_expected
from acromion.app.settings import Settings
from acromion.app.store.folder import (
    COPY_BYTES,
    LEDGER_FILE,
    SIDE_SUFFIX,
    FolderLock,
    Storage,
    format_ledger,
    hash_file,
    load_extra,
    open_storage,
    parse_ledger,
    sync_file,
    sync_folder,
    translate_disk_full,
    translate_folder_errors,
    write_durably,
)
from acromion.app.store.permissions import FILE_MODE, create_file, make_folder
from acromion.app.store.server_secret import SECRET_FILE, ServerSecret
from acromion.app.version import software_version

FORMAT = "acromion.backup/3"
TRIES = 3
MAGIC = b"age-encryption.org/v1\n"


# The file of a backup, encrypted or not.


@contextmanager
def write_envelope(path: Path, recipients: Sequence[str]) -> Iterator[IO[bytes]]:
    """Write a file that is complete at the end of the block or does not exist; it is not seekable.

    Raises BackupRefused, DiskFull, NotInstalled.
    """
    if path.exists():
        raise BackupRefused(why=f"{path} exists")
    known = [_parse_recipient(name) for name in recipients]
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


def _parse_recipient(name: str) -> Any:
    x25519 = load_extra("pyrage").x25519
    try:
        return x25519.Recipient.from_str(name.strip())
    except Exception:  # noqa: BLE001 - the library's errors have no common class
        raise BackupRefused(why=f"--recipient {name[:80]}: age1...") from None


def _create(part: Path) -> IO[bytes]:
    try:
        return create_file(part)
    except (FileNotFoundError, PermissionError, NotADirectoryError) as error:
        raise BackupRefused(why=f"{part.parent}: {error.strerror}") from error


@contextmanager
def _encrypting(file: IO[bytes], recipients: Sequence[Any]) -> Iterator[IO[bytes]]:
    """Encrypt the written bytes in a thread: no plain text is written to disk."""
    read_end, write_end = os.pipe()
    trouble: list[BaseException] = []

    def encrypt() -> None:
        try:
            with os.fdopen(read_end, "rb") as source:
                load_extra("pyrage").encrypt_io(source, file, list(recipients))
        except BaseException as error:  # noqa: BLE001 - raised again in the waiting thread
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
    """Open a file for reading; decrypt an encrypted one into an unnamed temporary file.

    Raises BackupRefused if it is encrypted and the identity is missing or wrong.
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
            pyrage = load_extra("pyrage")
            lines = [line.strip() for line in identity.read_text("utf-8").splitlines()]
            try:
                known = [
                    pyrage.x25519.Identity.from_str(line)
                    for line in lines
                    if line and not line.startswith("#")
                ]
                pyrage.decrypt_io(file, clear, known)
            except Exception as error:
                if isinstance(error, OSError) and error.errno is not None:
                    raise
                raise BackupRefused(why=f"--identity {identity.name}: {error}"[:200]) from error
            clear.seek(0)
            yield clear


# Content.


@dataclass(frozen=True, slots=True)
class Copied:
    """Number of files in the rows, files that were not copied intact, and the restored accounts."""

    promised: int
    faults: tuple[Fault, ...]
    accounts: Accounts = NO_ACCOUNTS
    erased: int = 0
    """Number of recordings of the backup that were erased since, and are not restored."""


class _PurgedMeanwhileError(Exception):
    """A file was deleted together with its row while the backup was made."""


def back_up(settings: Settings, path: Path, recipients: Sequence[str] = ()) -> Copied:
    """Write a complete backup or none at all; encrypt it if there are recipients.

    Raises BackupRefused if ``path`` exists or cannot be written, if there is no database, or if recordings
    were purged during each of three tries. Raises StoreAway, DiskFull or NotInstalled.
    """
    storage = open_storage(settings)
    for _ in range(TRIES):
        with suppress(_PurgedMeanwhileError):
            copied = _write(settings, storage, path, recipients)
            erased, beside = storage.find_erased(), path.resolve().with_name(LEDGER_FILE)
            known = parse_ledger(beside.read_bytes()) if beside.is_file() else frozenset()
            if not erased <= known:
                write_durably(beside, format_ledger(erased | known))
            return copied
    raise BackupRefused(why="recordings are being purged")


def drop_older_backups(path: Path, keep: int) -> tuple[str, ...]:
    """Delete older backups of this name (encrypted or not; only digits differ); return their names."""
    name = path.name.removesuffix(".age")
    same = re.compile(r"\d+".join(map(re.escape, re.split(r"\d+", name))) + r"(\.age)?")
    found = [one for one in path.resolve().parent.iterdir() if one.is_file() and same.fullmatch(one.name)]
    found.sort(key=lambda one: (one.stat().st_mtime_ns, one.name))
    for one in found[:-keep]:
        one.unlink()
    return tuple(one.name for one in found[:-keep])


def _write(settings: Settings, storage: Storage, path: Path, recipients: Sequence[str]) -> Copied:
    envelope = write_envelope(path, recipients)
    with envelope as file, zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        manifest, files = _write_rows(settings, archive)
        copied = _write_files(settings, storage, archive, files)
        archive.writestr(LEDGER_FILE, format_ledger(storage.find_erased()))
        if (secret := ServerSecret(settings.data_dir).file).exists():
            archive.writestr(SECRET_FILE, secret.read_bytes())
        manifest["faults"] = [asdict(fault) for fault in copied.faults]
        archive.writestr("manifest.json", json.dumps(manifest, indent=1))
    return copied


def _write_rows(
    settings: Settings, archive: zipfile.ZipFile
) -> tuple[dict[str, Any], tuple[ExpectedFile, ...]]:
    """Write all rows from one transaction; return their part of the manifest, and the files they refer to."""
    engine = connect(settings.database_url).execution_options(**READ_ONLY)
    if engine.dialect.name == "postgresql":
        engine = engine.execution_options(isolation_level="REPEATABLE READ")
    try:
        with engine.connect() as connection:
            revision = read_revision(connection)
            if revision is None:
                raise BackupRefused(why=f"{engine.url.render_as_string()}: no tables")
            write_all_rows(connection, archive)
            files = read_expected(connection)
    finally:
        engine.dispose()
    made_at = datetime.now(UTC).isoformat(timespec="seconds")
    manifest = {"format": FORMAT, "revision": revision, "version": software_version(), "made_at": made_at}
    return manifest, files


def _write_files(
    settings: Settings, storage: Storage, archive: zipfile.ZipFile, files: tuple[ExpectedFile, ...]
) -> Copied:
    """Copy every file of the rows. Raises _PurgedMeanwhileError if a file is missing with its row."""
    storage.prepare()
    faults = tuple(fault for file in files if (fault := _write_file(storage, archive, file)))
    if faults:
        still = {file.name for file in find_expected(settings)}
        if any(fault.name not in still for fault in faults):
            raise _PurgedMeanwhileError
    with closing(JobStore(settings)) as store:  # a backup contains no recording without a row
        unknown = find_unknown(store, storage).recoverable
    return Copied(len(files), (*faults, *(Fault(f"recordings/{one}", "no_row") for one in unknown)))


def _write_file(storage: Storage, archive: zipfile.ZipFile, file: ExpectedFile) -> Fault | None:
    """Copy a file to its end, or as far as the disk can read it.

    Returns its fault; None if its content matches its row.
    """
    try:
        path = storage.fetch(file.name).path
    except FileNotFoundError:
        return Fault(file.name, "missing")
    except OSError:
        return Fault(file.name, "damaged")
    about = zipfile.ZipInfo(f"files/{file.name}")
    about.external_attr = FILE_MODE << 16
    try:
        with path.open("rb") as source, archive.open(about, "w", force_zip64=True) as member:
            while chunk := _read_chunk(source):
                member.write(chunk)
        return _compare(path, file)
    except FileNotFoundError:
        return Fault(file.name, "missing")
    except (PermissionError, IsADirectoryError):
        return Fault(file.name, "damaged")
    finally:
        storage.release(path)


def _read_chunk(source: IO[bytes]) -> bytes:
    try:
        return source.read(COPY_BYTES)
    except OSError:  # an unreadable sector
        return b""


def _compare(path: Path, file: ExpectedFile) -> Fault | None:
    """Compare the content of a file with its row."""
    try:
        sha256 = hash_file(path)
    except OSError:
        sha256 = ""
    return None if sha256 == file.sha256 else Fault(file.name, "damaged")


def _read_expected(archive: zipfile.ZipFile, erased: Collection[str] = ()) -> Iterator[ExpectedFile]:
    """Return the files that a backup must contain by its rows, without those of erased recordings."""
    tables = ("recordings", "analyses", "result_files")
    known, jobs, files = (tuple(read_rows(archive, table)) for table in tables)
    return find_files([row for row in known if row["id"] not in erased], jobs, files)


@contextmanager
def open_backup(
    path: Path, identity: Path | None = None
) -> Iterator[tuple[zipfile.ZipFile, Mapping[str, Any]]]:
    """Open a backup; yield the archive and its manifest. Raises BackupRefused, WrongSchema."""
    try:
        with read_envelope(path, identity) as file, zipfile.ZipFile(file) as archive:
            manifest = json.loads(archive.read("manifest.json"))
            if manifest["format"] != FORMAT:
                raise BackupRefused(why=str(manifest["format"])[:80])
            if manifest["revision"] != REVISION:
                raise WrongSchema(found=manifest["revision"], needed=REVISION)
            yield archive, manifest
    except (zipfile.BadZipFile, KeyError, TypeError, ValueError, OSError) as error:
        raise BackupRefused(why=str(error)[:200]) from error


def find_damage(path: Path, identity: Path | None = None) -> Copied:
    """Read every byte of a backup, and find files that do not match their rows.

    Faults that the manifest lists are reported as ``known_missing`` or ``known_damaged``. Raises
    BackupRefused, WrongSchema.
    """
    with open_backup(path, identity) as (archive, manifest):
        listed = {fault["name"] for fault in manifest.get("faults", ())}
        files = tuple(_read_expected(archive))
        faults = []
        for file in files:
            found, is_known = _read_member(archive, f"files/{file.name}"), file.name in listed
            if found.sha256 is None:
                faults.append(Fault(file.name, "known_missing" if is_known else "missing"))
            elif found.sha256 != file.sha256:
                is_as_listed = is_known and found.is_as_written
                faults.append(Fault(file.name, "known_damaged" if is_as_listed else "damaged"))
        rows = (name for name in archive.namelist() if name.startswith("rows/"))
        faults += [Fault(name, "damaged") for name in rows if not _read_member(archive, name).is_as_written]
        return Copied(len(files), tuple(faults))


@dataclass(frozen=True, slots=True)
class _Member:
    """A member of the ZIP: the digest of its content, None if it is missing or cannot be opened."""

    sha256: str | None
    is_as_written: bool


def _ignore(_chunk: bytes) -> None:
    """Discard the bytes, which are read only for their digest."""


def _read_member(archive: zipfile.ZipFile, name: str, write: Callable[[bytes], object] = _ignore) -> _Member:
    """Pass on every readable byte, and compare the bytes with the checksum of the ZIP."""
    digest, crc = hashlib.sha256(), 0
    try:
        with archive.open(name) as member:
            member._expected_crc = None  # type: ignore[attr-defined]  # noqa: SLF001 - zipfile withholds altered bytes
            while chunk := _read_rest(member):
                digest.update(chunk)
                crc = zlib.crc32(chunk, crc)
                write(chunk)
    except (KeyError, zipfile.BadZipFile):
        return _Member(None, is_as_written=False)
    return _Member(digest.hexdigest(), crc == archive.getinfo(name).CRC)


def _read_rest(member: IO[bytes]) -> bytes:
    try:
        return member.read(COPY_BYTES)
    except (EOFError, zlib.error):
        return b""


def restore(settings: Settings, path: Path, identity: Path | None = None) -> Copied:
    """Restore a backup into an empty database and store, including damaged files.

    The files are written first, then all rows in one transaction: an interrupted restore leaves nothing
    visible, and can be repeated. Analyses that ran when the backup was made are queued again. Entries of a
    ledger of erasures (of the data folder, in the backup, or beside it) are not restored. Accounts and tokens
    are restored; everyone must sign in again. Raises BackupRefused, WrongSchema, NotEmpty, FolderTaken,
    DiskFull, StoreAway.
    """
    with open_backup(path, identity) as (archive, _):
        with translate_folder_errors(settings.data_dir):
            make_folder(settings.data_dir)
            lock = FolderLock(settings.data_dir)
        try:
            secret = ServerSecret(settings.data_dir).file
            if SECRET_FILE in archive.namelist() and not secret.exists():
                write_durably(secret, archive.read(SECRET_FILE))
            beside = path.with_name(LEDGER_FILE)
            ledger = archive.read(LEDGER_FILE) if LEDGER_FILE in archive.namelist() else b""
            erased = parse_ledger(ledger + b"\n" + (beside.read_bytes() if beside.is_file() else b""))
            copied = _restore(settings, archive, erased)
            with closing(JobStore(settings)) as store:
                update_side_files(store, open_storage(settings))
                found = find_accounts(store.reader)
            AccountStore(settings).exist()  # marks the folder of a server with accounts
            return replace(copied, accounts=found)
        finally:
            lock.release()


def _restore(settings: Settings, archive: zipfile.ZipFile, erased: frozenset[str]) -> Copied:
    """Restore files and rows."""
    engine = connect(settings.database_url)
    try:
        with engine.begin() as connection:
            lock_tables(connection)
            _check_no_rows(connection)
            storage = open_storage(settings)
            storage.prepare()
            storage.add_erased(erased)
            erased = storage.find_erased()
            files, present = tuple(_read_expected(archive, erased)), frozenset(storage.find_names())
            beside = {f"{file.name}{SIDE_SUFFIX}" for file in files}
            strangers = sorted(present - {file.name for file in files} - beside)
            if strangers:
                raise NotEmpty(number=len(strangers), where=strangers[0])
            restored = (
                _restore_file(storage, archive, file, is_present=file.name in present) for file in files
            )
            faults = tuple(fault for fault in restored if fault)
            gone = sum(row["id"] in erased for row in read_rows(archive, "recordings"))
            copied = Copied(len(files), faults, erased=gone)
            for table in reversed(reflect_tables(connection)):
                table.drop(connection)
            schema_revision.drop(connection, checkfirst=True)
            _restore_rows(connection, archive, erased)
            number = connection.execute(select(func.count()).select_from(people)).scalar_one()
            record(connection, "store.restored", other={"people": number}, who=AT_MACHINE)
        return copied
    finally:
        engine.dispose()


def _check_no_rows(connection: Connection) -> None:
    """Reject a database with any row except the store id, the rows of a start, and sign-ins."""
    found = read_revision(connection)
    if found not in (None, REVISION):
        raise WrongSchema(found=found, needed=REVISION)
    for table in reflect_tables(connection):
        if connection.dialect.name == "postgresql":  # a running server must not add a row after the count
            connection.execute(text(f'LOCK TABLE "{table.name}" IN ACCESS EXCLUSIVE MODE'))
        number = connection.execute(select(func.count()).select_from(table)).scalar_one()
        transient = (facts.name, audit_log.name, purged_uploads.name, *LEFT_OUT)  # rows of a start or a purge
        if number and table.name not in transient:
            raise NotEmpty(number=number, where=table.name)


def _restore_file(
    storage: Storage, archive: zipfile.ZipFile, file: ExpectedFile, *, is_present: bool
) -> Fault | None:
    """Restore one file; a damaged copy never replaces a present file."""
    with suppress(OSError):
        if is_present and storage.hash(file.name)[0] == file.sha256:
            return None
    part = storage.root / "uploads" / "restored.part"
    part.unlink(missing_ok=True)
    try:
        with translate_disk_full(), create_file(part) as copy:
            found = _read_member(archive, f"files/{file.name}", copy.write)
        fault = Fault(file.name, "missing") if found.sha256 is None else _compare(part, file)
        if fault is None or (found.sha256 is not None and not is_present):
            storage.put(part, file.name)
    finally:
        part.unlink(missing_ok=True)
    if fault is not None and fault.finding == "missing" and is_present:
        return Fault(file.name, "damaged")
    return fault


def _restore_rows(connection: Connection, archive: zipfile.ZipFile, erased: frozenset[str]) -> None:
    """Add the rows of a backup, except those of erased recordings.

    Unfinished uploads are not restored because their bytes are in no backup; nor is the store id of the rows.
    """
    create_tables(connection)
    gone = {row["id"] for row in read_rows(archive, analyses.name) if row["recording_id"] in erased} | erased
    for table in reflect_tables(connection):
        rows = [reset_row(table.name, row) for row in read_rows(archive, table.name)]
        if table.name == uploads.name:
            rows = [row for row in rows if row["recording_id"] is not None]
        elif table.name == facts.name:
            rows = [row for row in rows if row["name"] != "store"]
        if table.name != audit_log.name:  # its entries outlive their subjects
            rows = [
                row
                for row in rows
                if gone.isdisjoint({row.get("id"), row.get("recording_id"), row.get("analysis_id")})
            ]
        if rows:
            connection.execute(insert(table), rows)
    if erased:
        drop_empty_batches(connection)


@dataclass(frozen=True, slots=True)
class Drilled:
    """Number of restored and read files, their faults, and the duration."""

    files: int
    faults: tuple[Fault, ...]
    minutes: float


def drill(backup: Path, identity: Path | None = None, place: Path | None = None) -> Drilled:
    """Restore into a temporary folder (in ``place``, else beside the backup), and read every byte.

    The drill does not use this installation: if it cannot open a file, a restore after a fire could not
    either.

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
        kept = find_expected(settings)
        found = {*restored.faults, *find_faults(settings, kept)}
        faults = tuple(sorted(found, key=lambda fault: fault.name))
        return Drilled(len(kept), faults, (time.monotonic() - begun_s) / 60)
