"""The road from finished analyses to the report of several days: of a person, of both arms, of a group.

It starts from the folders that finished analyses leave; nothing is fused again. Page, API and command line
all take it.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path

from app.errors import CannotProfile
from app.report.days.document import describe_profile, encode_day_table, encode_overlay_table
from app.report.days.people import ArmDays, MeasuredDay, Stage, StudiedDays, group_days
from app.report.days.report import build_days
from app.report.findings import Kept
from app.report.model import Table
from app.report.pairs import encode_document
from app.report.render.write import read_kept, write_report
from app.request import ProfileRequest
from app.roads.pair import ELEVATION, read_analysed
from fusion.days import lay_on_clock, overlay_days

_NO_TABLE = Table("", (), ())


def make_profile(folders: Sequence[Path], request: ProfileRequest, out: Path) -> None:
    """Make the report of several finished analyses into the existing folder ``out``.

    ``folders``: the first ``request.before_count`` of them are before a change, the rest after it; all of
    them are days of the same time where it is None. Writes ``profile.json``, ``profile.csv``,
    ``overlay.csv`` and, for each language, ``report.<language>.<kind>`` and ``answer.<language>.txt``.

    Raises
    ------
    CannotProfile
        When a folder holds no finished analysis, or the analyses are no days to be set together
        (:func:`app.report.days.people.group_days`).
    """
    days = [
        MeasuredDay(_read(folder), _find_stage(rank, request.before_count), str(folder))
        for rank, folder in enumerate(folders)
    ]
    grouped = group_days(days, same_subject=request.same_subject, mixed_methods=request.mixed_methods)
    studied = replace(grouped, arms=tuple(_overlay(arm) for arm in grouped.arms))
    _write(studied, request, out)


def _find_stage(rank: int, before_count: int | None) -> Stage:
    if before_count is None:
        return "all"
    return "before" if rank < before_count else "after"


def _read(folder: Path) -> Kept:
    try:
        return read_kept(folder)
    except (OSError, ValueError):
        raise CannotProfile(why="kept", name=folder.name) from None


def _overlay(arm: ArmDays) -> ArmDays:
    """Overlay the days that have a clock; one of more than 24 h would lie over itself."""
    days = [
        lay_on_clock(read_analysed(Path(day.place), day.kept), day.start)
        for day in arm.days
        if day.start and day.left_out != "long" and (Path(day.place) / ELEVATION).exists()
    ]
    return replace(arm, bands=overlay_days(days))


def _write(studied: StudiedDays, request: ProfileRequest, out: Path) -> None:
    body = encode_document(describe_profile(studied))
    (out / "profile.json").write_bytes(body)
    (out / "profile.csv").write_bytes(encode_day_table(studied))
    (out / "overlay.csv").write_bytes(encode_overlay_table(studied))
    for language in request.languages:
        report = build_days(studied, language)
        write_report(report, request.kinds, request.paper, {"profile.json": body}, out)
        if request.has_drawings:
            charts = (*report.figures, *(chart for section in report.sections for chart in section.figures))
            shown = [asdict(replace(chart, table=_NO_TABLE)) for chart in charts]
            (out / f"drawings.{language}.json").write_text(json.dumps(shown), "utf-8")
