"""What becomes of live sessions: the raw file of each that is kept is a recording in the end."""

import logging
import re
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, get_args

from app.errors import AppError
from app.intake import Intake
from app.jobs.audit_log import record
from app.jobs.job import Job
from app.live.session_files import (
    PLAYED,
    RAW,
    SessionFiles,
    find_left,
    has_content,
    open_left,
    read_unfinished,
)
from app.request import LONGEST_SUBJECT, ReportRequest
from app.services import Services
from app.storage.store import BrokenSeal
from fusion.conventions import Side

if TYPE_CHECKING:
    from app.live.hub import Ended
    from fusion.live.cues import Cue

LIVE_FOLDER = "live"
HEAD_BYTES = 4096
LONGEST_NOTE = 1000
CUED = "cues"
"""The tag of a recording in which cues were given: with and without can be told apart afterwards."""

logger = logging.getLogger(__name__)


class LiveLibrary:
    """Takes raw files in, as recordings with their analysis; announces cues."""

    def __init__(self, services: Services) -> None:
        self._services, self.keys = services, services.storage.keys

    def keep(self, ended: "Ended") -> str:
        """Store the file and queue its analysis; give the id of the analysis."""
        wearer = ended.request.wearer
        analysis = _take_in(self._services, ended.files, wearer.subject, wearer.side)
        if ended.request.rules:
            self._note_cues(analysis.recording_id, ended)
        return analysis.id

    def announce(self, session_id: str, cue: "Cue") -> None:
        """Write the deliveries."""
        rule = cue.rule
        facts = {"session": session_id, "time_s": f"{cue.time_s:.3f}", "kind": rule.kind}
        self._services.webhooks.announce_cue(facts | {"angle_deg": f"{rule.angle_deg:g}"})

    def _note_cues(self, recording_id: str, ended: "Ended") -> None:
        """Log the cues in the note of the recording, as many as it takes."""
        from app.live.cue_log import format_rule  # noqa: PLC0415  the science

        counts = Counter(format_rule(cue.rule) for cue in ended.cues)
        rules = [f"{format_rule(rule)}: {counts[format_rule(rule)]}" for rule in ended.request.rules]
        times = " ".join(f"{cue.time_s:.0f}" for cue in ended.cues)
        row = self._services.recordings.get(recording_id)
        note = f"cues {', '.join(rules)}; s: {times}"[:LONGEST_NOTE]
        self._services.recordings.describe(row, replace(row.about, note=note))
        self._services.recordings.tag([recording_id], [CUED])


def take_in_cut(services: Services) -> int:
    """At the start of a server: make recordings of the sessions that its end cut off; give how many."""
    folder = services.settings.data_dir / LIVE_FOLDER
    for path in (*folder.glob(f"{PLAYED}*{RAW}"), *folder.glob(f"{PLAYED}*.csv")):
        path.unlink()  # what was played is stored already
    count = 0
    for session_id in find_left(folder):
        count += _try(partial(_take_in_left, services, folder, session_id), session_id)
    for path in sorted(folder.glob("live-*.csv")):
        count += _try(partial(_take_in_clear, services, path), path.name)
    return count


def _try(take_in: Callable[[], bool], name: str) -> bool:
    try:
        return take_in()
    except (AppError, OSError, BrokenSeal):
        logger.exception("what a live session left stays in its folder: %s", name)
        return False


def _take_in_left(services: Services, folder: Path, session_id: str) -> bool:
    """Take in what a killed server left of a session; False where it held no row."""
    from app.live.early_rows import write_early_rows  # noqa: PLC0415  the science
    from app.live.raw_file import restate  # noqa: PLC0415

    keys = services.storage.keys
    files = open_left(folder, keys, session_id)
    is_early = files.early.exists()
    has_rows = write_early_rows(files.early, files.raw, files.key) if is_early else has_content(files.raw)
    if has_rows:
        head = next(restate(lambda: read_unfinished(files.raw, files.key)), b"")
        subject, side, has_cues = _read_head(head)
        _tag_cued(services, _take_in(services, files, subject, side), has_cues=has_cues)
    files.remove(keys)
    return has_rows


def _take_in(services: Services, files: SessionFiles, subject: str, side: Side | None) -> Job:
    """Make the raw file of a session a recording, and queue its analysis."""
    from app.live.raw_file import restate  # noqa: PLC0415  the science

    pieces = restate(lambda: read_unfinished(files.raw, files.key))
    name, size_bytes = f"live-{files.session_id}.csv", files.raw.stat().st_size
    request = ReportRequest(name, subject, side, paper=services.settings.paper)
    analysis = _find_intake(services).add_pieces(pieces, size_bytes, request, "web")
    with services.store.engine.begin() as connection:
        ended = {"session": files.session_id}
        record(connection, "live.ended", analysis.recording_id, analysis.id, other=ended)
    return analysis


def _take_in_clear(services: Services, path: Path) -> bool:
    """Take in a raw file that an earlier release wrote in clear."""
    with path.open("rb") as file:
        subject, side, has_cues = _read_head(file.read(HEAD_BYTES))
    request = ReportRequest(path.name, subject, side, paper=services.settings.paper)
    analysis = _find_intake(services).add(path, request, "web")
    _tag_cued(services, analysis, has_cues=has_cues)
    path.unlink()
    return True


def _find_intake(services: Services) -> Intake:
    return Intake(services.store, services.storage, services.settings)


def _read_head(head: bytes) -> tuple[str, Side | None, bool]:
    """Read from the lines above the table whose arm it is, and whether cues were chosen."""
    text = head[:HEAD_BYTES].decode("utf-8", "replace")
    found = dict(re.findall(r"^# (subject|side|cues): (.*)$", text, re.MULTILINE))
    side = next((one for one in get_args(Side) if one == found.get("side")), None)
    return found.get("subject", "")[:LONGEST_SUBJECT], side, "cues" in found


def _tag_cued(services: Services, analysis: Job, *, has_cues: bool) -> None:
    if has_cues:
        services.recordings.tag([analysis.recording_id], [CUED])
