"""From the logs of a request to one recording, read now or taken from the cache."""

import json
import logging
from dataclasses import dataclass, replace
from pathlib import Path

from app.request import ReportRequest
from app.storage.decoded import hash_entry_key
from app.storage.store import KnownLogs, hash_file
from app.version import identify_engine
from fusion.caveats import Caveat
from fusion.errors import FailedReader, FusionError
from fusion.readers import (
    identify_header,
    join_recordings,
    parse_profile,
    read_recording,
)
from fusion.recording import Recording

_FAILED = "the reader plug-in %s %s failed: %s"

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Logs:
    """The files to read, and the cache that may hold their samples."""

    log: Path
    request: ReportRequest
    known: KnownLogs

    def read(self) -> Recording:
        """Read the log and those joined to it."""
        paths = (self.log, *map(Path, self.request.joined))
        digests = self.known.digests or ("",) * len(paths)
        recordings = [self._read(path, digest) for path, digest in zip(paths, digests, strict=True)]
        return join_recordings(recordings) if self.request.joined else recordings[0]

    def _read(self, path: Path, digest: str) -> Recording:
        """Read the file, or what an earlier reading of the same bytes has kept."""
        cache = self.known.cache
        if cache is None:
            return self._parse(path, digest)
        sha256 = digest or hash_file(path)
        reading = [Path(self._find_name(path)).suffix, self.request.rate_hz, self.request.profile]
        key = hash_entry_key(sha256, json.dumps(reading), identify_engine())
        recording = cache.find(key)
        if recording is None:
            recording = self._parse(path, sha256)
            cache.keep(key, recording)
        return recording

    def _parse(self, path: Path, sha256: str) -> Recording:
        return read_file(path, replace(self.request, file_name=self._find_name(path)), sha256)

    def _find_name(self, path: Path) -> str:
        return self.request.file_name if path is self.log else path.name


def read_file(path: Path, request: ReportRequest, sha256: str = "") -> Recording:
    """Read one file as a request asks, and log every plug-in that failed: a line, and the traceback as INFO.

    Raises
    ------
    fusion.errors.FusionError
        As :func:`fusion.readers.read_recording`; where the file is a table, its facts identify the header.
    """
    profile = parse_profile(request.profile) if request.profile else None
    with path.open("rb") as file:
        try:
            recording = read_recording(
                file, file_name=request.file_name, rate_hz=request.rate_hz, sha256=sha256, profile=profile
            )
        except FusionError as refusal:
            if isinstance(refusal, FailedReader):
                logger.error(_FAILED, *refusal.facts.values())
                logger.info("its traceback", exc_info=True)
            header = identify_header(file)
            refusal.facts |= {"header": header} if header else {}
            raise
    for flag in recording.flags:
        if flag.code == Caveat.READER:
            logger.error(_FAILED, *flag.facts.values())
    return recording
