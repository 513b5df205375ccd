"""Recordings and reports as objects in a bucket (S3), shared by any number of machines.

 recordings/<recording>.json its side file erasures/<recording> the ledger of erasures recordings/<recording>
 complete or absent: an unfinished multipart put is invisible analyses/<analysis>/<attempt>/<file> put before
 the row that states that the attempt counts

No conditional put is used (some S3 servers lack it): names are random, and the rows decide which object
counts. The folder of this machine contains only temporary files, which may be lost.
"""

import hashlib
import secrets
import shutil
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import obstore
from obstore.exceptions import BaseError
from obstore.store import S3Store

from acromion.app.errors import StoreAway
from acromion.app.settings import Settings
from acromion.app.store.folder import (
    COPY_BYTES,
    Fetched,
    Mark,
    Storage,
    Upload,
    check_free,
    format_ledger,
    format_recording_name,
    format_result_name,
    format_side_file_name,
    make_recording_id,
    read_mark,
    translate_disk_full,
)
from acromion.app.store.permissions import create_file

if TYPE_CHECKING:
    from obstore import ObjectMeta
    from obstore.store import RetryConfig

PART_BYTES = 8 << 20
RETRIES: "RetryConfig" = {"max_retries": 4, "retry_timeout": timedelta(seconds=20)}


def open_bucket(settings: Settings) -> "BucketStorage":
    """Open ``s3://bucket``; endpoint, region and keys come from the usual ``AWS_*`` variables."""
    return BucketStorage(
        settings.data_dir, bucket=S3Store.from_url(settings.object_store, retry_config=RETRIES)
    )


class BucketUpload(Upload):
    """An upload to a bucket, sent on in parts as the bytes arrive."""

    def __init__(self, recording_id: str, max_bytes: int, bucket: S3Store) -> None:
        super().__init__(recording_id, max_bytes)
        self._bucket, self._name = bucket, format_recording_name(recording_id)
        self._writer = obstore.open_writer(bucket, self._name, buffer_size=PART_BYTES)

    def _write(self, chunk: bytes) -> None:
        with translate_store_errors():
            self._writer.write(chunk)

    def _keep(self) -> None:
        """Finish the put; from then on every machine can read the recording."""
        with translate_store_errors():
            self._writer.close()
            if obstore.head(self._bucket, self._name)["size"] != self.size_bytes:
                raise StoreAway

    def discard(self) -> None:
        """Stop sending. Parts of an unfinished put are invisible; a rule of the bucket removes them."""


@dataclass(frozen=True, slots=True)
class BucketStorage(Storage):
    """A bucket, and a folder of this machine for temporary files and running attempts."""

    is_local: ClassVar[bool] = False

    bucket: S3Store = field(kw_only=True)

    def prepare(self) -> None:
        """Create the folders of this machine, and check that the bucket responds."""
        Storage.prepare(self)  # no super(): a dataclass with slots is created twice
        with translate_store_errors():
            next(iter(obstore.list(self.bucket, "store.id", chunk_size=1)), None)

    def identify(self) -> str:
        """Return the permanent id of the bucket's content; the first call creates it."""
        with translate_store_errors():
            with suppress(FileNotFoundError):
                return bytes(obstore.get(self.bucket, "store.id").bytes()).decode()
            obstore.put(self.bucket, "store.id", f"bucket-{secrets.token_hex(8)}".encode())
            return bytes(obstore.get(self.bucket, "store.id").bytes()).decode()

    def open_upload(self, max_bytes: int) -> Upload:
        """Start an upload of a recording under a new name."""
        recording_id = make_recording_id()
        return BucketUpload(recording_id, max_bytes, self.bucket)

    def adopt(self, path: Path, recording_id: str) -> None:
        """Store a file of this machine as a recording; the caller removes the file after the commit."""
        self.put(path, format_recording_name(recording_id))

    def fetch(self, name: str) -> Fetched:
        """Copy an object to this machine without verifying it."""
        into = self.root / "uploads" / f"{secrets.token_hex(8)}.part"
        try:
            with translate_store_errors(), translate_disk_full():
                found = obstore.get(self.bucket, name)  # first, so that a missing object leaves no empty file
                with create_file(into) as file:
                    for chunk in found.stream(min_chunk_size=COPY_BYTES):
                        file.write(chunk)
            return Fetched(into, _read_mark(found.meta), read_mark(into))
        except BaseException:
            self.release(into)
            raise

    def hash(self, name: str) -> tuple[str, Mark]:
        """Return the SHA-256 of an object, and its size and ETag."""
        sha256 = hashlib.sha256()
        with translate_store_errors():
            found = obstore.get(self.bucket, name)
            for chunk in found.stream(min_chunk_size=COPY_BYTES):
                sha256.update(chunk)
        return sha256.hexdigest(), _read_mark(found.meta)

    def read_part(self, name: str, first_byte: int, count: int) -> bytes:
        """Return a part of an object."""
        with translate_store_errors():
            end_byte = min(first_byte + count, obstore.head(self.bucket, name)["size"])
            if end_byte <= first_byte:  # an empty range is not allowed
                return b""
            return bytes(obstore.get_range(self.bucket, name, start=first_byte, end=end_byte))

    def find_mark(self, name: str) -> Mark | None:
        """Return size and ETag of an object; None if it does not exist."""
        with translate_store_errors(), suppress(FileNotFoundError):
            return _read_mark(obstore.head(self.bucket, name))
        return None

    def drop_recording(self, recording_id: str) -> None:
        """Remove a recording, then its side file; ignore missing ones."""
        self._delete([format_recording_name(recording_id)])
        self._delete([format_side_file_name(recording_id), *self._find(f"quarantine/{recording_id}.")])

    def put(self, path: Path, name: str) -> None:
        """Store a copy of a file of this machine under a name."""
        with translate_store_errors(), path.open("rb") as file:
            obstore.put(self.bucket, name, file, chunk_size=PART_BYTES)

    def keep_attempt(self, analysis_id: str, token: str) -> None:
        """Store the attempt's files and remove the local ones; a repeated call does nothing."""
        folder = self.attempt(analysis_id, token)
        for path in sorted(folder.glob("*")):
            self.put(path, format_result_name(analysis_id, token, path.name))
        shutil.rmtree(folder.parent, ignore_errors=True)

    def share(self, kept: str, name: str) -> None:
        """Copy an object inside the bucket. Raises FileNotFoundError."""
        with translate_store_errors():
            obstore.copy(self.bucket, kept, name)

    def drop_attempt(self, analysis_id: str, token: str) -> None:
        """Remove the files of a discarded attempt, here and in the bucket."""
        Storage.drop_attempt(self, analysis_id, token)
        self._delete(self._find(f"analyses/{analysis_id}/{token}/"))

    def drop_analysis(self, analysis_id: str) -> None:
        """Remove every file of an analysis."""
        Storage.drop_analysis(self, analysis_id)
        self._delete(self._find(f"analyses/{analysis_id}/"))

    def release(self, path: Path) -> None:
        """Remove the copy."""
        path.unlink(missing_ok=True)

    def check_space(self, expected_bytes: int, min_free_bytes: int) -> None:  # noqa: ARG002
        """Check that this machine has space for temporary files; the recording goes to the bucket.

        Raises DiskFull.
        """
        check_free(self.root, min_free_bytes)

    def find_names(self) -> Iterator[str]:
        """Return the name of every stored recording and result."""
        with translate_store_errors():
            for kind in ("recordings", "analyses"):
                for objects in obstore.list(self.bucket, kind):
                    yield from (found["path"] for found in objects)

    def find_recordings(self) -> frozenset[str]:
        """Return every name among the recordings, including side files."""
        return frozenset(name.removeprefix("recordings/") for name in self._find("recordings/"))

    def write_small(self, name: str, content: bytes) -> None:
        """Store a small object."""
        with translate_store_errors():
            obstore.put(self.bucket, name, content)

    def read_small(self, name: str) -> bytes | None:
        """Return the content of a small object; None if it does not exist."""
        with translate_store_errors(), suppress(FileNotFoundError):
            return bytes(obstore.get(self.bucket, name).bytes())
        return None

    def quarantine(self, name: str) -> bool:  # noqa: ARG002
        """Leave it in place: another machine may be about to write its row (``acromion verify`` finds it)."""
        return False

    def unquarantine(self, name: str) -> bool:  # noqa: ARG002
        """Do nothing: no recording of a bucket is ever moved into quarantine."""
        return False

    def find_quarantined(self) -> tuple[str, ...]:
        """Return the names of everything in quarantine, in the bucket and on this machine."""
        kept = (name.removeprefix("quarantine/") for name in self._find("quarantine/"))
        return (*kept, *Storage.find_quarantined(self))

    def find_erased(self) -> frozenset[str]:
        """Return the id of every recording and analysis that was erased."""
        return frozenset(name.removeprefix("erasures/") for name in self._find("erasures"))

    def add_erased(self, ids: Collection[str]) -> None:
        """Store an object for each new id."""
        for one in sorted(set(ids) - self.find_erased()):
            self.write_small(f"erasures/{one}", format_ledger([one]))

    def _find(self, prefix: str) -> list[str]:
        with translate_store_errors():
            return [found["path"] for page in obstore.list(self.bucket, prefix) for found in page]

    def _delete(self, names: list[str]) -> None:
        with translate_store_errors(), suppress(FileNotFoundError):
            obstore.delete(self.bucket, names)


def _read_mark(found: "ObjectMeta") -> Mark:
    """Return size and ETag; without an ETag use a random value, so that the object is always verified."""
    return found["size"], found["e_tag"] or secrets.token_hex(8)


@contextmanager
def translate_store_errors() -> Iterator[None]:
    """Convert errors of an unreachable store to a refusal with a code."""
    try:
        yield
    except FileNotFoundError:
        raise
    except BaseError as error:
        raise StoreAway from error
    except OSError as error:
        if error.errno is None:  # an error of obstore's writers; the system's errors have a number
            raise StoreAway from error
        raise
