"""The road from finished analyses to the report of both arms, and to that of one day beside another.

Both start from the folders that finished analyses leave: nothing is fused again. The page, the API and the
command line take these same roads.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq

from app.errors import CannotPair
from app.report.change import build_comparison, describe_comparison
from app.report.export.parquet import encode_elevation_csv
from app.report.findings import Kept, decode_findings
from app.report.model import Report
from app.report.pair import ArmPair, TrunkClock, build_pair, describe_pair
from app.report.pairs import encode_document
from app.report.render.write import read_kept, write_report
from app.request import Language, OnStage, Paper, ReportKind, ReportRequest
from fusion.arms import PairedArms, TrunkRelative, pair_arms, relate_to_trunk
from fusion.elevation import Elevation, ElevationSegment
from fusion.errors import TooShort
from fusion.quality import leave_out
from fusion.recording import MICROSECONDS

# What is made of finished analyses when somebody asks; done in a child process.


def write_comparison(log: Path, _request: ReportRequest, out: Path, on_stage: OnStage) -> None:
    """Compare the two findings in the list ``log``: ``comparison.json`` in ``out``."""
    on_stage("counting", 0.0)
    before, after = (decode_findings(json.dumps(kept).encode()) for kept in json.loads(log.read_bytes()))
    (out / "comparison.json").write_text(json.dumps(describe_comparison(before, after)), "utf-8")


def write_elevation_csv(log: Path, _request: ReportRequest, out: Path, on_stage: OnStage) -> None:
    """Write the angles of the Parquet file ``log`` as ``elevation.csv.gz`` in ``out``."""
    on_stage("rendering", 0.0)
    (out / "elevation.csv.gz").write_bytes(encode_elevation_csv(log))


ELEVATION = "elevation.parquet"
PAIR, COMPARISON = "pair.json", "comparison.json"
HOLE_PERIODS = 1.5


@dataclass(frozen=True, slots=True)
class PairRequest:
    """What a report of two is asked with.

    ``trunk`` is the folder of a third analysis, of the trunk; ``offset_s`` tells when the right recording
    began, seconds after the left, where the clocks do not or are wrong; ``trunk_offset_s`` likewise when the
    trunk's began, after the left.
    """

    trunk: Path | None = None
    offset_s: float | None = None
    trunk_offset_s: float | None = None
    languages: tuple[Language, ...] = ("en", "fr")
    kinds: tuple[ReportKind, ...] = ("html", "pdf")
    paper: Paper = "a4"


def make_pair_report(left: Path, right: Path, request: PairRequest, out: Path) -> None:
    """Set two finished analyses of one shift side by side, into the existing folder ``out``.

    Writes ``pair.json`` and, for each language, ``report.<language>.<kind>`` and ``answer.<language>.txt``.

    Raises
    ------
    CannotPair
        When they are not both arms of one shift, or nothing tells how their clocks lie.
    """
    first, second = _read(left), _read(right)
    _refuse_strangers(first, second)
    offset_s = find_offset_s(first, second) if request.offset_s is None else request.offset_s
    angles = read_analysed(left, first), read_analysed(right, second)
    pair = ArmPair(
        first,
        second,
        offset_s,
        "clocks" if request.offset_s is None else "person",
        _share(*angles, offset_s, _find_sigmas(first, second)),
        *_relate(angles, request, (first, second), offset_s),
    )
    reports = [build_pair(pair, language) for language in request.languages]
    _write(reports, (PAIR, describe_pair(pair)), request, out)


def make_comparison_report(before: Path, after: Path, request: PairRequest, out: Path) -> None:
    """Set one finished analysis beside a later one, into the existing folder ``out``.

    Writes ``comparison.json`` and the reports as :func:`make_pair_report` does.

    Raises
    ------
    CannotPair
        When a folder holds no finished analysis.
    """
    first, second = _read(before), _read(after)
    reports = [build_comparison(first, second, language) for language in request.languages]
    _write(reports, (COMPARISON, describe_comparison(first, second)), request, out)


def find_offset_s(left: Kept, right: Kept) -> float:
    """Give by how many seconds the right recording began after the left, by their clocks.

    Where only one file tells its zone, both are taken for clocks of the same place.

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
    table = pq.read_table(folder / ELEVATION)
    columns = (table[name].to_numpy() for name in ("time_s", "elevation_deg", "valid"))
    return leave_out(Elevation(tuple(_split_runs(*columns)), None), kept.findings.exclusions)


def _split_runs(
    time_s: np.ndarray[Any, Any], angle_deg: np.ndarray[Any, Any], valid: np.ndarray[Any, Any]
) -> list[ElevationSegment]:
    """Cut the series where a step is longer than a sample and a half."""
    steps_s = np.diff(time_s)
    period_s = float(np.median(steps_s)) if len(steps_s) else 1.0
    cuts = [0, *(np.flatnonzero(steps_s > HOLE_PERIODS * period_s) + 1).tolist(), len(time_s)]
    return [
        ElevationSegment(
            start_us=round(float(time_s[a]) * MICROSECONDS),
            rate_hz=_fit_rate_hz(time_s[a:b], period_s),
            elevation_deg=angle_deg[a:b],
            valid=valid[a:b],
        )
        for a, b in pairwise(cuts)
        if b > a
    ]


def _fit_rate_hz(time_s: np.ndarray[Any, Any], period_s: float) -> float:
    return (len(time_s) - 1) / float(time_s[-1] - time_s[0]) if len(time_s) > 1 else 1 / period_s


def _read(folder: Path) -> Kept:
    try:
        return read_kept(folder)
    except (OSError, ValueError, KeyError):
        raise CannotPair(why="kept") from None


def _refuse_strangers(left: Kept, right: Kept) -> None:
    """Two recordings of one arm, or one recording twice, would look like a perfectly even worker."""
    _refuse_same(left, right)
    if left.subject.side == "right" or right.subject.side == "left":
        raise CannotPair(why="side")


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


def _relate(
    angles: tuple[Elevation, Elevation], request: PairRequest, arms: tuple[Kept, Kept], offset_s: float
) -> tuple[tuple[TrunkRelative, TrunkRelative], TrunkClock | None]:
    """Give each arm beside the trunk, all three on the clock of the left recording."""
    if request.trunk is None:
        return (relate_to_trunk(angles[0], None), relate_to_trunk(angles[1], None)), None
    found = _read(request.trunk)
    for arm in arms:
        _refuse_same(arm, found)
    body, told_s = read_analysed(request.trunk, found), request.trunk_offset_s
    if told_s is None:
        clock = TrunkClock(find_offset_s(arms[0], found), "clocks")
    else:
        clock = TrunkClock(told_s, "person")
    try:
        left = relate_to_trunk(angles[0], body, clock.offset_s)
        right = relate_to_trunk(angles[1], body, clock.offset_s - offset_s)
    except TooShort:
        raise CannotPair(why="apart") from None
    return (left, right), clock


def _write(
    reports: Sequence[Report], document: tuple[str, dict[str, Any]], request: PairRequest, out: Path
) -> None:
    name, values = document
    body = encode_document(values)
    (out / name).write_bytes(body)
    for report in reports:
        write_report(report, request.kinds, request.paper, {name: body}, out)
