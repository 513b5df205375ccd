"""The log file of a session's cues, and cue rules as text."""

import csv
from collections.abc import Iterable
from pathlib import Path
from typing import get_args

from acromion.fusion.live.cues import Cue, CueKind, CueRule

SUFFIX = ".cues.csv"
COLUMNS = ("time_s", "kind", "angle_deg", "limit")
CUE_HINT = "hold:60:10, share:60:10, stays:60:30"


def parse_rule(text: str) -> CueRule:
    """Parse ``hold:ANGLE_DEG:SECONDS``, ``share:ANGLE_DEG:PERCENT`` or ``stays:ANGLE_DEG:SECONDS``.

    Raises ValueError.
    """
    kind_text, angle_text, limit_text = text.split(":")
    kind = next((one for one in get_args(CueKind) if one == kind_text), None)
    angle_deg, limit = float(angle_text), float(limit_text)
    most = 100.0 if kind == "share" else 3600.0
    if kind is None or not 0.0 < angle_deg < 180.0 or not 0.0 < limit < most:
        raise ValueError(CUE_HINT)
    if kind == "share":
        return CueRule(kind, angle_deg, percent=limit)
    return CueRule(kind, angle_deg, seconds=limit)


def get_limit(rule: CueRule) -> float:
    """Return the limit of a rule, in seconds, or in percent for a share."""
    return rule.percent if rule.kind == "share" else rule.seconds


def format_rule(rule: CueRule) -> str:
    """Format a rule for :func:`parse_rule`."""
    return f"{rule.kind}:{rule.angle_deg:g}:{get_limit(rule):g}"


def write_log(raw: Path, cues: Iterable[Cue]) -> Path:
    """Write the cues to a file next to the raw file; times count from its first sample."""
    path = raw.with_suffix(SUFFIX)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        for cue in cues:
            writer.writerow(
                [f"{cue.time_s:.3f}", cue.rule.kind, f"{cue.rule.angle_deg:g}", f"{get_limit(cue.rule):g}"]
            )
    return path
