"""The cache of decoded recordings: a moved window or a new diary need not read the file again.

An entry may be removed at any time; a damaged one is replaced from the file.

 folder/<recording>.<key>.samples    one line of JSON (the file's metadata) with the SHA-256 of the rest,
                                     then the samples as float32

The key is a digest of the file's digest, of the person's reading options, and of the software revision: a
newer reader never gets the samples of an older one. An entry is deleted with its recording.
"""

import hashlib
import json
import logging
import os
import secrets
import shutil
from collections.abc import Collection, Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass, fields
from datetime import datetime
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from acromion.app.store.permissions import create_file, make_folder
from acromion.fusion.clocks import in_zone
from acromion.fusion.recording import QualityFlag, Recording, Segment, Span, Stated

LONGEST_HEAD_BYTES = 16 << 20
SPARE_TIMES = 3
"""An entry is kept only if this many times its size is free."""

_FACTS = tuple(field.name for field in fields(Recording))

logger = logging.getLogger(__name__)


def hash_entry_key(sha256: str, reading: str, revision: str) -> str:
    """Return the key of an entry; ``reading`` contains all reading options as text."""
    return hashlib.sha256(f"{sha256}\n{revision}\n{reading}".encode()).hexdigest()[:40]


@dataclass(frozen=True, slots=True)
class DecodedCache:
    """A folder of decoded recordings with at most ``max_bytes``."""

    folder: Path
    max_bytes: int
    recording_id: str = ""
    """The recording to read or keep."""

    def find(self, key: str) -> Recording | None:
        """Return the recording; None if it is missing or incomplete."""
        path = self._path(key)
        try:
            with path.open("rb") as file:
                # a damaged entry raises ValueError, KeyError or TypeError
                sha256, _, described = file.readline(LONGEST_HEAD_BYTES).rstrip(b"\n").partition(b" ")
                digest = hashlib.sha256(described)
                facts = json.loads(described)
                segments = []
                for about in facts.pop("segments"):
                    rows = int(about.pop("rows"))
                    acc_g, gyr_dps = _read_samples(file, rows, digest), _read_samples(file, rows, digest)
                    bridged = tuple((first, stop) for first, stop in about.pop("bridged"))
                    segments.append(Segment(acc_g=acc_g, gyr_dps=gyr_dps, bridged=bridged, **about))
                if file.read(1) or digest.hexdigest().encode() != sha256:
                    raise ValueError
                recording = _build(facts, tuple(segments))
            os.utime(path)  # least recently used entries are removed first
        except FileNotFoundError:
            return None
        except (OSError, ValueError, KeyError, TypeError):
            logger.warning("a damaged cache entry is read again from the file: %s", path.name)
            path.unlink(missing_ok=True)
            return None
        return recording

    def keep(self, key: str, recording: Recording) -> None:
        """Store the samples if there is space; no result depends on it."""
        size_bytes = sum(segment.acc_g.nbytes + segment.gyr_dps.nbytes for segment in recording.segments)
        try:
            make_folder(self.folder)
            if size_bytes > self.max_bytes or shutil.disk_usage(self.folder).free < SPARE_TIMES * size_bytes:
                return
            self._make_room(size_bytes)
            self._write(key, recording)
        except OSError:
            logger.warning("the decoded samples could not be kept", exc_info=True)

    def find_recordings(self) -> frozenset[str]:
        """Return the id of every recording with samples in the cache."""
        return frozenset(path.name.partition(".")[0] for path in self.folder.glob("rec_*"))

    def forget(self, recording_ids: Collection[str]) -> None:
        """Remove the samples of these recordings, including entries that are being written."""
        for recording_id in recording_ids:
            for path in self.folder.glob(f"{recording_id}.*"):
                path.unlink(missing_ok=True)

    def _write(self, key: str, recording: Recording) -> None:
        part = self._path(key).with_suffix(f".{secrets.token_hex(4)}.part")
        try:
            with create_file(part) as file:
                described = json.dumps(_describe(recording))
                arrays = [
                    np.ascontiguousarray(samples, dtype="<f4")
                    for segment in recording.segments
                    for samples in (segment.acc_g, segment.gyr_dps)
                ]
                digest = hashlib.sha256(described.encode())
                for samples in arrays:
                    digest.update(samples.data.cast("B"))
                file.write(f"{digest.hexdigest()} {described}\n".encode())
                for samples in arrays:
                    file.write(samples.data.cast("B"))
            part.replace(self._path(key))
        finally:
            part.unlink(missing_ok=True)

    def _make_room(self, needed_bytes: int) -> None:
        """Remove the least recently used entries."""
        entries = sorted(_find_entries(self.folder), key=lambda entry: entry[1].st_mtime)
        held_bytes = sum(status.st_size for _, status in entries)
        for path, status in entries:
            if held_bytes + needed_bytes <= self.max_bytes:
                return
            path.unlink(missing_ok=True)
            held_bytes -= status.st_size

    def _path(self, key: str) -> Path:
        return self.folder / f"{self.recording_id}.{key}.samples"


def _find_entries(folder: Path) -> Iterator[tuple[Path, os.stat_result]]:
    for path in folder.iterdir():
        with suppress(FileNotFoundError):  # another worker may remove it meanwhile
            yield path, path.stat()


def _read_samples(file: IO[bytes], rows: int, digest: "hashlib._Hash") -> NDArray[np.float32]:
    content = file.read(12 * rows)
    digest.update(content)
    samples = np.frombuffer(content, dtype="<f4")
    return samples.reshape(rows, 3).astype(np.float32)


def _describe(recording: Recording) -> dict[str, Any]:
    """Return all fields except the samples, ready for JSON."""
    described = {name: getattr(recording, name) for name in _FACTS}
    return described | {
        "start": recording.start.isoformat() if recording.start else None,
        "excluded": [asdict(span) for span in recording.excluded],
        "flags": [asdict(flag) for flag in recording.flags],
        "understood": dict(recording.understood),
        "stated": asdict(recording.stated),
        "segments": [
            {"start_us": s.start_us, "rate_hz": s.rate_hz, "rows": len(s), "bridged": s.bridged}
            for s in recording.segments
        ],
    }


def _build(facts: dict[str, Any], segments: tuple[Segment, ...]) -> Recording:
    start = datetime.fromisoformat(facts["start"]) if facts["start"] else None
    flags = [(flag, tuple(map(tuple, flag.pop("spans_s")))) for flag in facts["flags"]]
    read = {
        "start": in_zone(start, facts["time_zone"]),
        "excluded": tuple(Span(**span) for span in facts["excluded"]),
        "flags": tuple(QualityFlag(spans_s=spans_s, **flag) for flag, spans_s in flags),
        "stated": Stated(**facts["stated"]),
        "reader": tuple(facts["reader"]) if facts["reader"] else None,
        "pose_windows_s": tuple(map(tuple, facts["pose_windows_s"])),
    }
    return Recording(segments=segments, **facts | read)
