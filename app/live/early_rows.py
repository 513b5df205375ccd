"""The raw file of a session that a kill cut off before its angles ran, made from what came early."""

from contextlib import suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from app.live.cue_log import find_limit, format_rule, parse_rule
from app.live.early import read_about, read_pieces
from app.live.raw_file import PREFIX, RawFile, Wearer
from app.live.session_files import EARLY
from app.live.source import SourceFacts
from fusion.errors import FusionError
from fusion.live import Frames
from fusion.live.cues import CueRule
from fusion.live.lines import LineReader
from fusion.recording import MICROSECONDS


def write_early_rows(early: Path, raw: Path) -> bool:
    """Write the raw file anew from what came early, which is removed; False where that held no row.

    Raises OSError, or ValueError if what was asked of the session is not written whole.
    """
    content = early.read_bytes()
    raw.unlink(missing_ok=True)
    reader = LineReader()
    found: list[tuple[Frames | None, float]] = []
    with suppress(FusionError, ValueError):  # what came until then is kept
        came_s = 0.0
        for piece, came_s in read_pieces(content):
            found.append((reader.feed(piece, round(came_s * MICROSECONDS)), came_s))
        found.append((reader.finish(), came_s))
    read = [(frames, came_s) for frames, came_s in found if frames is not None]
    rows = [frames for frames, _ in read if len(frames)]
    if rows:
        asked, facts, (first, came_s) = read_about(content), reader.facts, read[0]
        assert facts is not None
        ago_s = float(first.time_us[-1] - first.time_us[0]) / MICROSECONDS
        source = SourceFacts(
            device=facts.device,
            name=asked["name"],
            rate_hz=facts.rate_hz,
            start=datetime.fromtimestamp(came_s, UTC).astimezone() - timedelta(seconds=ago_s),
            acc_range_g=facts.acc_range_g,
            gyr_range_dps=facts.gyr_range_dps,
        )
        cues = " ".join(format_rule(make_rule(rule)) for rule in asked["cues"])
        with RawFile(raw, source, Wearer(asked["subject"], asked["side"], asked["axis"]), cues) as opened:
            for frames in rows:
                opened.write(frames)
    early.unlink()
    return bool(rows)


def take_early(folder: Path) -> None:
    """Make raw files of what came early in sessions of a terminal that were cut; one that fails stays.

    They bear names of their own: another program may be writing the session of the same moment.
    """
    for early in sorted(folder.glob(f"{PREFIX}*{EARLY}")):
        with suppress(OSError, ValueError):
            write_early_rows(early, early.with_name(f"{early.stem}-early.csv"))


def describe_asked(name: str, wearer: Wearer, rules: tuple[CueRule, ...]) -> dict[str, Any]:
    """Give what the file of early bytes says of a session, for its raw file."""
    cues = [{"kind": rule.kind, "angle_deg": rule.angle_deg, "limit": find_limit(rule)} for rule in rules]
    return {
        "name": name,
        "subject": wearer.subject,
        "side": wearer.side,
        "axis": wearer.arm_axis,
        "cues": cues,
    }


def make_rule(asked: dict[str, Any]) -> CueRule:
    """Make a rule of cues from its kind, angle and limit. Raises ValueError."""
    return parse_rule(f"{asked['kind']}:{asked['angle_deg']}:{asked['limit']}")
