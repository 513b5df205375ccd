"""From the logs of a request to one recording, read now or taken from the cache."""

import json
import logging
from dataclasses import replace
from pathlib import Path

from app.request import ReportRequest
from app.store.decoded import hash_entry_key
from app.store.folder import KnownLogs, hash_file
from app.version import identify_engine
from fusion.caveats import Caveat
from fusion.errors import FailedReader, FusionError
from fusion.readers import identify_header, join_recordings, parse_profile, read_recording
from fusion.recording import Recording

_FAILED = "the reader plug-in %s %s failed: %s"

logger = logging.getLogger(__name__)


def read_logs(log: Path, request: ReportRequest, known: KnownLogs) -> Recording:
    """Read the log of a request and those joined to it; or take what an earlier reading of the bytes kept."""
    paths = (log, *map(Path, request.joined))
    recordings = []
    for path, digest in zip(paths, known.digests or ("",) * len(paths), strict=True):
        asked = request if path is log else replace(request, file_name=path.name)
        if known.cache is None:
            recordings.append(read_file(path, asked, digest))
            continue
        sha256 = digest or hash_file(path)
        reading = [Path(asked.file_name).suffix, request.rate_hz, request.profile]
        key = hash_entry_key(sha256, json.dumps(reading), identify_engine())
        recording = known.cache.find(key)
        if recording is None:
            recording = read_file(path, asked, sha256)
            known.cache.keep(key, recording)
        recordings.append(recording)
    return join_recordings(recordings) if request.joined else recordings[0]


def read_file(path: Path, request: ReportRequest, sha256: str = "") -> Recording:
    """Read one file as a request asks, and log every plug-in that failed: a line, and the traceback as INFO.

    Raises fusion.errors.FusionError as :func:`fusion.readers.read_recording`; where the file is a table, its
    facts identify the header.
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
