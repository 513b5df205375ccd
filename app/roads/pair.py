"""The road from finished analyses to a report of two: both arms of one shift, or a day beside an earlier one.

It starts from the folders that finished analyses leave; nothing is fused again. Page, API and command line
all take it.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from app.errors import CannotPair
from app.report.findings import Kept
from app.report.model import Report
from app.report.pairs import (
    ArmPair,
    TrunkClock,
    are_mixed,
    build_comparison,
    build_pair,
    describe_comparison,
    describe_pair,
    encode_document,
    is_confirmed,
    judge_person,
    read_code,
    refuse_no_comparison,
)
from app.report.render.write import read_kept, write_report
from app.request import PairRequest
from fusion.angle_files.elevation_parquet import read_elevation
from fusion.arms import PairedArms, TrunkRelative, pair_arms, relate_to_trunk
from fusion.elevation import Elevation
from fusion.errors import TooShort
from fusion.exposure.intervals import join_intervals
from fusion.exposure.types import Exposure, Interval
from fusion.quality.time_account import leave_out

ELEVATION = "elevation.parquet"


def make_report_of_two(folders: Sequence[Path], request: PairRequest, out: Path) -> None:
    """Make the report of two, or for a pair three, finished analyses into the existing folder ``out``.

    ``folders``: left, right and, where there is one, trunk; or before and after. Writes ``pair.json`` or
    ``comparison.json`` and, for each language, ``report.<language>.<kind>`` and ``answer.<language>.txt``.

    Raises
    ------
    CannotPair
        When a folder holds no finished analysis, when two are not both arms of one shift, when nothing says
        that they are of one person, when neither clocks nor request give their offset, or when methods are
        mixed unasked.
    CannotCompare
        When two are of different people or of the same hours of one arm, when nothing says that they are of
        one person, or when methods are mixed unasked.
    """
    if request.kind == "pair":
        left, right, *trunk = folders
        pair = _pair_arms((left, right), trunk[0] if trunk else None, request)
        reports = [build_pair(pair, language) for language in request.languages]
        _write(reports, describe_pair(pair), request, out)
    else:
        before, after = map(_read, folders)
        same = request.same_subject
        refuse_no_comparison(before, after, same_subject=same, mixed_methods=request.mixed_methods)
        reports = [
            build_comparison(before, after, language, same_subject=same) for language in request.languages
        ]
        _write(reports, describe_comparison(before, after, same_subject=same), request, out)


def _pair_arms(arms: tuple[Path, Path], trunk: Path | None, request: PairRequest) -> ArmPair:
    left, right = map(_read, arms)
    body = _read(trunk) if trunk else None
    _refuse_strangers(left, right)
    one_person = judge_person(tuple(filter(None, (left, right, body))), is_stated=request.same_subject)
    if one_person == "unknown":
        raise CannotPair(why="person")
    if are_mixed(filter(None, (left, right, body))) and not request.mixed_methods:
        raise CannotPair(why="methods")
    offset_s = find_offset_s(left, right) if request.offset_s is None else request.offset_s
    angles = read_analysed(arms[0], left), read_analysed(arms[1], right)
    return ArmPair(
        left,
        right,
        offset_s,
        "clocks" if request.offset_s is None else "person",
        widen_unconfirmed(_share(*angles, offset_s, _find_sigmas(left, right)), left, right),
        *_relate(angles, (trunk, body, request.trunk_offset_s), (left, right), offset_s),
        one_person,
    )


def find_offset_s(left: Kept, right: Kept) -> float:
    """Find by how many seconds the right recording began after the left, by their clocks.

    Where only one file states its zone, both are taken for clocks of the same place.

    Raises
    ------
    CannotPair
        When one of them has no clock.
    """
    first, second = left.findings.recording.start, right.findings.recording.start
    if first is None or second is None:
        raise CannotPair(why="offset")
    if first.tzinfo is None or second.tzinfo is None:
        first, second = first.replace(tzinfo=None), second.replace(tzinfo=None)
    return (second - first).total_seconds()


def read_analysed(folder: Path, kept: Kept) -> Elevation:
    """Read the angle series of a finished analysis; what its report leaves out is not valid."""
    return leave_out(read_elevation(folder / ELEVATION), kept.findings.exclusions)


def _read(folder: Path) -> Kept:
    try:
        return read_kept(folder)
    except (OSError, ValueError):
        raise CannotPair(why="kept") from None


def _refuse_strangers(left: Kept, right: Kept) -> None:
    """Refuse two recordings of one arm, or one twice: they would look like a perfectly even worker.

    Raises
    ------
    CannotPair
    """
    _refuse_same(left, right)
    _refuse_two_people(left, right)
    if left.subject.side == "right" or right.subject.side == "left":
        raise CannotPair(why="side")


def _refuse_two_people(*ones: Kept) -> None:
    if len({read_code(kept) for kept in ones} - {""}) > 1:
        raise CannotPair(why="subjects")


def _refuse_same(one: Kept, other: Kept) -> None:
    if one.findings.recording.sha256 == other.findings.recording.sha256:
        raise CannotPair(why="same")


def _find_sigmas(left: Kept, right: Kept) -> tuple[float, float] | None:
    """Give the error of each angle; None where that of one is not known."""
    first, second = (kept.findings.exposure.angle_sigma_deg for kept in (left, right))
    return (first, second) if first and second else None


def _share(
    left: Elevation, right: Elevation, offset_s: float, sigmas_deg: tuple[float, float] | None
) -> PairedArms:
    try:
        return pair_arms(left, right, offset_s, sigmas_deg)
    except TooShort:
        raise CannotPair(why="apart") from None


def widen_unconfirmed(shared: PairedArms, left: Kept, right: Kept) -> PairedArms:
    """Widen the ranges of an arm with an unconfirmed pose to include those of its own report.

    Those cover the other stillnesses that may be the pose. A figure that cannot be widened has no range.
    """
    arms = {"left": left.findings, "right": right.findings}
    open_arms = {side: arm.exposure for side, arm in arms.items() if not is_confirmed(arm)}
    if not open_arms:
        return shared
    own = {
        f"{side}_{name}": interval
        for side, exposure in open_arms.items()
        for name, interval in _list_ranges(exposure).items()
    }
    closed = tuple(f"{side}_" for side in arms if side not in open_arms)
    kept = {
        name: join_intervals([interval, own[name]]) if name in own else interval
        for name, interval in shared.intervals.items()
        if name in own or (name.startswith(closed) and not name.startswith("right_to_left"))
    }
    return replace(shared, intervals=kept)


def _list_ranges(exposure: Exposure) -> dict[str, Interval]:
    above = {f"time_above_{item.threshold_deg:g}_percent": item.interval for item in exposure.time_above}
    return {**exposure.intervals, **{name: interval for name, interval in above.items() if interval}}


def _relate(
    angles: tuple[Elevation, Elevation],
    trunk: tuple[Path | None, Kept | None, float | None],
    arms: tuple[Kept, Kept],
    offset_s: float,
) -> tuple[tuple[TrunkRelative, TrunkRelative], TrunkClock | None]:
    """Relate each arm to the trunk, all three on the clock of the left recording.

    ``trunk``: the folder of its analysis, what it holds, and its offset after the left arm as a person
    stated it.
    """
    folder, found, stated_s = trunk
    if folder is None or found is None:
        return (relate_to_trunk(angles[0], None), relate_to_trunk(angles[1], None)), None
    for arm in arms:
        _refuse_same(arm, found)
        _refuse_two_people(arm, found)
    body = read_analysed(folder, found)
    if stated_s is None:
        clock = TrunkClock(find_offset_s(arms[0], found), "clocks")
    else:
        clock = TrunkClock(stated_s, "person")
    try:
        left = relate_to_trunk(angles[0], body, clock.offset_s)
        right = relate_to_trunk(angles[1], body, clock.offset_s - offset_s)
    except TooShort:
        raise CannotPair(why="apart") from None
    return (left, right), clock


def _write(reports: Sequence[Report], figures: dict[str, Any], request: PairRequest, out: Path) -> None:
    body = encode_document(figures)
    (out / request.figures_name).write_bytes(body)
    for report in reports:
        write_report(report, request.kinds, request.paper, {request.figures_name: body}, out)
