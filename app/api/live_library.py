"""What becomes of live sessions: the raw file of each that is kept is a recording in the end."""

import logging
import re
from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING, get_args

from app.errors import AppError
from app.intake import Intake
from app.jobs.audit_log import record
from app.jobs.job import Job
from app.live.early import PLAYED, RAW, SessionFiles, find_left
from app.request import LONGEST_SUBJECT, ReportRequest
from app.services import Services
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
        self._services = services

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
    for path in folder.glob(f"{PLAYED}*{RAW}"):
        path.unlink()  # what was played is stored already
    count = 0
    for files in find_left(folder):
        try:
            count += _take_in_left(services, files)
        except (AppError, OSError):
            logger.exception("what a live session left stays in its folder: %s", files.session_id)
    return count


def _take_in_left(services: Services, files: SessionFiles) -> bool:
    """Take in what a killed server left of a session; False where it held no row."""
    from app.live.raw_file import write_early_rows  # noqa: PLC0415  the science

    is_early = files.early.exists()
    has_rows = write_early_rows(files.early, files.raw) if is_early else files.raw.stat().st_size > 0
    if has_rows:
        with files.raw.open("rb") as file:
            subject, side, has_cues = _read_head(file.read(HEAD_BYTES))
        analysis = _take_in(services, files, subject, side)
        if has_cues:
            services.recordings.tag([analysis.recording_id], [CUED])
    files.remove()
    return has_rows


def _take_in(services: Services, files: SessionFiles, subject: str, side: Side | None) -> Job:
    """Make the raw file of a session a recording, and queue its analysis."""
    request = ReportRequest(f"live-{files.session_id}.csv", subject, side, paper=services.settings.paper)
    analysis = Intake(services.store, services.storage, services.settings).add(files.raw, request, "web")
    with services.store.engine.begin() as connection:
        ended = {"session": files.session_id}
        record(connection, "live.ended", analysis.recording_id, analysis.id, other=ended)
    return analysis


def _read_head(head: bytes) -> tuple[str, Side | None, bool]:
    """Read from the lines above the table whose arm it is, and whether cues were chosen."""
    text = head[:HEAD_BYTES].decode("utf-8", "replace")
    found = dict(re.findall(r"^# (subject|side|cues): (.*)$", text, re.MULTILINE))
    side = next((one for one in get_args(Side) if one == found.get("side")), None)
    return found.get("subject", "")[:LONGEST_SUBJECT], side, "cues" in found
