"""Reports on several finished analyses: on two (both arms, or two days), or on many days.

They start from the folders of finished analyses; nothing is computed again from samples. Page, API and
command line share this pipeline.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Literal, get_args

from acromion.app.errors import AppError, CannotPair, CannotProfile
from acromion.app.report.findings import FinishedAnalysis
from acromion.app.report.model import Report, Table
from acromion.app.report.pairs import (
    ArmPair,
    PairClock,
    build_comparison,
    build_pair,
    check_comparable,
    describe_comparison,
    describe_pair,
    encode_document,
    has_mixed_methods,
    identify_hours,
    is_confirmed,
    judge_person,
    read_code,
)
from acromion.app.report.render.write import read_finished, write_report
from acromion.app.report.several.document import describe_profile, encode_day_table, encode_overlay_table
from acromion.app.report.several.people import MeasuredDay, Stage, group_days
from acromion.app.report.several.report import build_days
from acromion.app.request import PairClockSource, PairRequest, ProfileRequest
from acromion.fusion.angle_files.elevation_parquet import read_elevation
from acromion.fusion.clocks import measure_us
from acromion.fusion.comparison.arms import PairedArms, TrunkRelative, pair_arms, relate_to_trunk
from acromion.fusion.comparison.days import lay_on_clock, overlay_days
from acromion.fusion.comparison.movement import ClockMatch, match_clocks, read_movement
from acromion.fusion.conventions import Side
from acromion.fusion.elevation import Elevation
from acromion.fusion.errors import NotAligned, NothingInCommon, TooShort, UnreadableFile
from acromion.fusion.exposure.summary import join_intervals
from acromion.fusion.quality.time_account import leave_out
from acromion.fusion.recording import MICROSECONDS

ELEVATION = "elevation.parquet"


def make_report_of_two(folders: Sequence[Path], request: PairRequest, out: Path) -> None:
    """Write the report on two finished analyses (a pair may have three) to the existing folder ``out``.

    ``folders``: left, right and optionally trunk; or before and after. Writes ``pair.json`` or
    ``comparison.json`` and, for each language, ``report.<language>.<kind>`` and ``answer.<language>.txt``.

    Raises CannotPair if a folder has no finished analysis, if two are not both arms of one shift, if nothing
    states that they are from one person, if neither clocks nor request give their offset, if the shared
    movement asked for does not, or if methods are mixed without permission. Raises CannotCompare if two are
    from different people or from the same hours of one arm, if nothing states that they are from one person,
    or if methods are mixed without permission.
    """
    if request.kind == "pair":
        left, right, *trunk = folders
        pair = pair_analyses((left, right), trunk[0] if trunk else None, request)
        reports = [build_pair(pair, language) for language in request.languages]
        _write(reports, describe_pair(pair), request, out)
    else:
        before, after = (_read(folder, CannotPair(why="kept")) for folder in folders)
        same = request.same_subject
        check_comparable(before, after, same_subject=same, mixed_methods=request.mixed_methods)
        reports = [
            build_comparison(before, after, language, same_subject=same) for language in request.languages
        ]
        _write(reports, describe_comparison(before, after, same_subject=same), request, out)


def pair_analyses(
    arms: tuple[Path, Path],
    trunk: Path | None,
    request: PairRequest,
    clocks: tuple[PairClock | None, PairClock | None] = (None, None),
) -> ArmPair:
    """Return both arms, and perhaps the trunk, on one clock; raises CannotPair.

    ``clocks``: those of the right arm and of the trunk, if they are already known; else the request's source.
    """
    left, right = (_read(arm, CannotPair(why="kept")) for arm in arms)
    body = _read(trunk, CannotPair(why="kept")) if trunk else None
    _check_same_person(left, right)
    stated = (left.subject.side, right.subject.side, body.subject.side if body else None)
    if any(side not in {None, place} for side, place in zip(stated, get_args(Side), strict=True)):
        raise CannotPair(why="side")
    every = tuple(filter(None, (left, right, body)))
    one_person = judge_person(every, is_stated=request.same_subject)
    if one_person == "unknown":
        raise CannotPair(why="person")
    if has_mixed_methods(every) and not request.mixed_methods:
        raise CannotPair(why="methods")
    clock = clocks[0] or _relate_clocks((arms[0], left), (arms[1], right), request.offset_s, request.clock)
    angles = read_analysed(arms[0], left), read_analysed(arms[1], right)
    first, second = (kept.findings.exposure.angle_sigma_deg for kept in (left, right))
    sigmas_deg = (first, second) if first and second else None  # known for both arms, or for neither
    try:
        shared = pair_arms(*angles, clock.offset_s, sigmas_deg, clock.drift_ppm)
        if trunk is None or body is None:
            relative, trunk_clock = (relate_to_trunk(angles[0], None), relate_to_trunk(angles[1], None)), None
        else:
            for arm in (left, right):
                _check_same_person(arm, body)
            trunk_clock = clocks[1] or _relate_clocks(
                (arms[0], left), (trunk, body), request.trunk_offset_s, request.clock, "trunk"
            )
            relative = _relate(angles, read_analysed(trunk, body), clock, trunk_clock)
    except TooShort:
        raise CannotPair(why="apart") from None
    shared = widen_unconfirmed(shared, left, right)
    return ArmPair(left, right, clock, shared, relative, trunk_clock, one_person, body)


_Kept = tuple[Path, FinishedAnalysis]


def _relate_clocks(
    left: _Kept,
    other: _Kept,
    stated_s: float | None,
    source: PairClockSource,
    place: Literal["right", "trunk"] = "right",
) -> PairClock:
    """Return the start of a recording after the left arm's: stated, by the clocks, or by shared movement.

    The devices' clocks are compared with the movement, which corrects nothing.

    Raises CannotPair if there is no clock, or if the movement does not give a certain relation.
    """
    if stated_s is not None:
        return PairClock(stated_s, "person")
    if source == "signals":
        match = match_movement(left[0], other[0], place)
        return PairClock(match.offset_s, "signals", match)
    offset_s = find_offset_s(left[1], other[1])
    try:
        match = match_movement(left[0], other[0], place)
        return PairClock(offset_s, "clocks", match, left[1].findings.recording.duration_us / MICROSECONDS)
    except CannotPair:
        return PairClock(offset_s, "clocks")


def match_movement(left: Path, other: Path, place: Literal["right", "trunk"] = "right") -> ClockMatch:
    """Return the relation of the clocks of two finished analyses, from the movement that both sensors share.

    Raises CannotPair with the reason, unless it is certain.
    """
    try:
        return match_clocks(*(read_movement(folder / ELEVATION) for folder in (left, other)))
    except (NothingInCommon, UnreadableFile, OSError):
        why = "no movement stored"
    except NotAligned as refusal:
        reasons = {"motion_s": "little shared movement", "rival": "two shifts", "margin_s": "loose match"}
        why = next(reason for fact, reason in reasons.items() if fact in refusal.facts)
    raise CannotPair(why=why, place=f"clock {place}", cure="state the offset")


def find_offset_s(left: FinishedAnalysis, right: FinishedAnalysis) -> float:
    """Return the start of the right recording in seconds after the left, by their clocks.

    If only one file states its time zone, both clocks are assumed to show the same local time.

    Raises CannotPair if one of them has no clock.
    """
    first, second = left.findings.recording.start, right.findings.recording.start
    if first is None or second is None:
        raise CannotPair(why="offset")
    return measure_us(first, second) / MICROSECONDS


def read_analysed(folder: Path, kept: FinishedAnalysis) -> Elevation:
    """Read the angle series of a finished analysis; spans that its report excludes are not valid."""
    return leave_out(read_elevation(folder / ELEVATION), kept.findings.exclusions)


def _read(folder: Path, refusal: AppError) -> FinishedAnalysis:
    try:
        return read_finished(folder)
    except (OSError, ValueError):
        raise refusal from None


def _check_same_person(one: FinishedAnalysis, other: FinishedAnalysis) -> None:
    """Reject the same recording twice, which would look like perfect symmetry, and two people."""
    if identify_hours(one) == identify_hours(other):
        raise CannotPair(why="same")
    if len({read_code(one), read_code(other)} - {""}) > 1:
        raise CannotPair(why="subjects")


def widen_unconfirmed(shared: PairedArms, left: FinishedAnalysis, right: FinishedAnalysis) -> PairedArms:
    """Widen the ranges of an arm with an unconfirmed pose to include those of its single report.

    The ranges of the single report include the other stillnesses that may be the pose. A figure that cannot
    be widened has no range.
    """
    arms = {"left": left.findings, "right": right.findings}
    open_arms = {side: arm.exposure for side, arm in arms.items() if not is_confirmed(arm)}
    if not open_arms:
        return shared
    own = {
        f"{side}_{name}": interval
        for side, exposure in open_arms.items()
        for name, interval in (
            *exposure.intervals.items(),
            *((f"time_above_{one.threshold_deg:g}_percent", one.interval) for one in exposure.time_above),
        )
        if interval
    }
    closed = tuple(f"{side}_" for side in arms if side not in open_arms)
    kept = {
        name: join_intervals([interval, own[name]]) if name in own else interval
        for name, interval in shared.intervals.items()
        if name in own or (name.startswith(closed) and not name.startswith("right_to_left"))
    }
    return replace(shared, intervals=kept)


def _relate(
    angles: tuple[Elevation, Elevation], trunk: Elevation, right: PairClock, body: PairClock
) -> tuple[TrunkRelative, TrunkRelative]:
    """Relate each arm to the trunk; ``right``, ``body``: clocks of the right arm and of the trunk."""
    right_pace, body_pace = (1.0 + clock.drift_ppm / 1e6 for clock in (right, body))
    after_right_s = (body.offset_s - right.offset_s) * right_pace
    drift_ppm = (body_pace / right_pace - 1.0) * 1e6
    left = relate_to_trunk(angles[0], trunk, body.offset_s, body.drift_ppm)
    return left, relate_to_trunk(angles[1], trunk, after_right_s, drift_ppm)


def _write(reports: Sequence[Report], figures: dict[str, Any], request: PairRequest, out: Path) -> None:
    body = encode_document(figures)
    (out / request.figures_name).write_bytes(body)
    for report in reports:
        write_report(report, request.kinds, request.paper, {request.figures_name: body}, out)


# Several days: of a person, of both arms, of a group.


_NO_TABLE = Table("", (), ())


def make_profile(folders: Sequence[Path], request: ProfileRequest, out: Path) -> None:
    """Write the report on several finished analyses to the existing folder ``out``.

    ``folders``: the first ``request.before_count`` are before a change, the rest after it; if it is None, all
    are days of one period. Recordings of the trunk are skipped. Writes ``profile.json``, ``profile.csv``,
    ``overlay.csv`` and, for each language, ``report.<language>.<kind>`` and ``answer.<language>.txt``.

    Raises CannotProfile if a folder has no finished analysis, or if the analyses are not days that can be
    combined (:func:`acromion.app.report.several.people.group_days`).
    """
    days = []
    for rank, folder in enumerate(folders):
        stage: Stage = "all"
        if request.before_count is not None:
            stage = "before" if rank < request.before_count else "after"
        kept = _read(folder, CannotProfile(why="kept", name=folder.name))
        if kept.subject.side != "trunk":
            days.append(MeasuredDay(kept, stage, str(folder), request.min_hours))
    grouped = group_days(days, same_subject=request.same_subject, mixed_methods=request.mixed_methods)
    arms = []
    for arm in grouped.arms:
        # a day of more than 24 h would overlap itself
        short = [(Path(day.place), day) for day in arm.days if day.left_out != "long"]
        clocked = [
            lay_on_clock(read_analysed(place, day.kept), start)
            for place, day in short
            if (start := day.kept.findings.recording.start) and (place / ELEVATION).exists()
        ]
        arms.append(replace(arm, bands=overlay_days(clocked)))
    studied = replace(grouped, arms=tuple(arms))
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
