"""The raw file of a session that a kill cut off before its angles ran, made from what came early."""

from collections.abc import Iterator
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from app.live.cue_log import find_limit, format_rule, parse_rule
from app.live.early import read_about, read_pieces
from app.live.raw_file import PREFIX, RawFile, RawHeader, Wearer
from app.live.session_files import EARLY
from fusion.errors import FusionError
from fusion.live import Frames
from fusion.live.cues import CueRule
from fusion.live.lines import LineReader
from fusion.recording import MICROSECONDS


def write_early_rows(early: Path, raw: Path) -> bool:
    """Write the raw file anew from what came early, which is removed; False where that held no row.

    Raises
    ------
    OSError
    """
    content = early.read_bytes()
    raw.unlink(missing_ok=True)
    reader = LineReader()
    found: list[tuple[Frames, float]] = []
    with suppress(FusionError, ValueError):  # what came until then is kept
        found.extend(_read_frames(reader, content))
    rows = [frames for frames, _ in found if len(frames)]
    if rows:
        with RawFile(raw, _make_header(reader, read_about(content), *found[0])) as opened:
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


def _read_frames(reader: LineReader, content: bytes) -> Iterator[tuple[Frames, float]]:
    came_s = 0.0
    for piece, came_s in read_pieces(content):
        frames = reader.feed(piece, round(came_s * MICROSECONDS))
        if frames is not None:
            yield frames, came_s
    last = reader.finish()
    if last is not None:
        yield last, came_s


def _make_header(reader: LineReader, asked: dict[str, Any], first: Frames, came_s: float) -> RawHeader:
    facts = reader.facts
    assert facts is not None
    ago_s = float(first.time_us[-1] - first.time_us[0]) / MICROSECONDS
    return RawHeader(
        device=facts.device,
        source=asked["name"],
        start=datetime.fromtimestamp(came_s, UTC).astimezone() - timedelta(seconds=ago_s),
        rate_hz=facts.rate_hz,
        wearer=Wearer(asked["subject"], asked["side"], asked["axis"]),
        acc_range_g=facts.acc_range_g,
        gyr_range_dps=facts.gyr_range_dps,
        cues=" ".join(format_rule(make_rule(rule)) for rule in asked["cues"]),
    )


def make_rule(asked: dict[str, Any]) -> CueRule:
    """Make a rule of cues from its kind, angle and limit.

    Raises
    ------
    ValueError
    """
    return parse_rule(f"{asked['kind']}:{asked['angle_deg']}:{asked['limit']}")
