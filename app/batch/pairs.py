"""The pairs of a run: left and right arm, and perhaps the trunk, of one stated subject.

Only recordings with a stated subject and a stated side are proposed; nothing is guessed from names.
Recordings whose clocks overlap belong together, unless two of one side overlap each other. The others belong
together if the movement that both sensors share gives a certain match.

A child process computes the figures, because they need libraries that the process of the run does not load.
They are kept in ``pairs.json`` and computed again only if an analysis of the subject or the software changes.
"""

import hashlib
import json
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import datetime, timedelta
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from acromion.app.analysis.attempt import Attempt, Limits, choose_limits, load_and_call, run_and_wait
from acromion.app.batch.folder import PAIRS, Task
from acromion.app.errors import AppError, CannotPair, RecordedProblem
from acromion.app.report.export.tables import Row
from acromion.app.report.figures import Results, round_all
from acromion.app.request import OnStage, PairRequest, ReportRequest
from acromion.app.store.folder import hash_file, write_durably
from acromion.app.version import identify_engine
from acromion.fusion.errors import FusionError

if TYPE_CHECKING:
    from acromion.app.report.pairs import PairClock


@dataclass(frozen=True, slots=True)
class Proposal:
    """The recordings of one subject: at least one of each arm."""

    subject: str
    left: tuple[Task, ...]
    right: tuple[Task, ...]
    trunk: tuple[Task, ...]


def propose_pairs(tasks: Sequence[Task]) -> list[Proposal]:
    """Return the subjects with recordings of both arms, in the order of the tasks."""
    found = []
    for subject in dict.fromkeys(task.request.subject for task in tasks if task.request.subject):
        own = [task for task in tasks if task.request.subject == subject]
        left, right, trunk = (
            tuple(task for task in own if task.request.side == side) for side in ("left", "right", "trunk")
        )
        if left and right:
            found.append(Proposal(subject, left, right, trunk))
    return found


@dataclass(frozen=True, slots=True)
class _Analysis:
    """A finished analysis of one subject: its recording, its folder, and its time by the device's clock."""

    name: str
    folder: str
    start: str | None
    recorded_s: float


@dataclass(frozen=True, slots=True)
class _Subject:
    """The finished analyses of one subject by side."""

    subject: str
    left: tuple[_Analysis, ...]
    right: tuple[_Analysis, ...]
    trunk: tuple[_Analysis, ...]


def describe_pairs(out: Path, done: Sequence[tuple[Task, Results]]) -> list[Row]:
    """Return the rows of ``pairs.csv`` for the finished recordings and their results.

    Subjects whose analyses have not changed since the last run into ``out`` are not paired again.
    """
    kept = _read_kept(out / PAIRS)
    results = {task.folder: found for task, found in done}
    subjects = {}
    for proposal in propose_pairs([task for task, _ in done]):
        sides = {
            side: tuple(_find_analysis(task, results[task.folder]) for task in getattr(proposal, side))
            for side in ("left", "right", "trunk")
        }
        subject = _Subject(proposal.subject, **sides)
        subjects[_identify(subject)] = subject
    new = {key: subject for key, subject in subjects.items() if key not in kept}
    made, code = _pair_in_child(new)
    found = {key: rows for key, rows in (kept | made).items() if key in subjects}
    if found != kept:
        write_durably(out / PAIRS, json.dumps(found, indent=1, ensure_ascii=False).encode())
    lost: dict[str, list[Row]] = {
        key: [{"subject": subject.subject, "error_code": code}] for key, subject in new.items()
    }
    rows = lost | found
    return [row for key in subjects for row in rows[key]]


def _find_analysis(task: Task, results: Results) -> _Analysis:
    start, recorded_s = results["recording"]["start"], results["time"]["recorded_s"]
    return _Analysis(task.name, str(task.folder.resolve()), start, recorded_s)


def _identify(subject: _Subject) -> str:
    """Return a hash of all that determines the rows of a subject."""
    parts = [identify_engine(), subject.subject]
    for side in (subject.left, subject.right, subject.trunk):
        for one in side:
            angles = Path(one.folder) / "elevation.parquet"
            size_bytes = angles.stat().st_size if angles.exists() else 0
            parts += [one.name, hash_file(Path(one.folder) / "results.json"), str(size_bytes)]
        parts.append("")
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def _read_kept(path: Path) -> dict[str, list[Row]]:
    """Return the rows of the last run by the hash of their subject; none if there are none."""
    try:
        kept = json.loads(path.read_bytes())
    except (OSError, ValueError):
        return {}
    return kept if isinstance(kept, dict) else {}


def _pair_in_child(subjects: Mapping[str, _Subject]) -> tuple[dict[str, list[Row]], str]:
    """Return the rows of each subject; if the child process ends early, those it made and the code."""
    if not subjects:
        return {}, ""
    from acromion.app.settings import Settings  # noqa: PLC0415  slow import, not needed if nothing changed

    with tempfile.TemporaryDirectory(prefix="acromion_pairs_") as folder:
        plan = Path(folder) / "plan.json"
        plan.write_text(json.dumps({key: asdict(subject) for key, subject in subjects.items()}), "utf-8")
        one = choose_limits(Settings(), 0)
        matches = sum(len(own.left) * len((*own.right, *own.trunk)) for own in subjects.values())
        limits = Limits(one.memory_bytes, one.wall_s * matches)
        make = partial(load_and_call, __name__, "write_pairs")
        code = ""
        try:
            run_and_wait(Attempt(plan, ReportRequest(""), Path(folder), make, limits))
        except (AppError, RecordedProblem) as end:
            code = end.code
        made = {key: path for key in subjects if (path := Path(folder) / f"{key}.json").exists()}
        return {key: json.loads(path.read_bytes()) for key, path in made.items()}, code


def write_pairs(plan: Path, _request: ReportRequest, out: Path, on_stage: OnStage) -> None:
    """Write the rows of each subject of a plan to ``<key>.json``; runs in the child process."""
    subjects: dict[str, dict[str, Any]] = json.loads(plan.read_bytes())
    for rank, (key, known) in enumerate(subjects.items()):
        on_stage("rendering", rank / len(subjects))
        sides = {side: tuple(_Analysis(**one) for one in known[side]) for side in ("left", "right", "trunk")}
        rows = [
            _describe(known["subject"], found) for found in _find_pairs(_Subject(known["subject"], **sides))
        ]
        part = out / "part"
        part.write_text(json.dumps(rows), "utf-8")
        part.replace(out / f"{key}.json")  # whole, or not there


@dataclass(frozen=True, slots=True)
class _Found:
    """Two or three analyses of one subject, or the reason why a left arm has no pair.

    ``clock``, ``trunk_clock``: already found in the shared movement.
    """

    left: _Analysis
    right: _Analysis | None = None
    trunk: _Analysis | None = None
    clock: "PairClock | None" = None
    trunk_clock: "PairClock | None" = None
    refusal: AppError | None = None


def _find_pairs(own: _Subject) -> Iterator[_Found]:
    taken: set[_Analysis] = set()
    alone = []
    for left in own.left:
        partners = [right for right in own.right if _overlap(left, right)]
        taken.update(partners)
        for right in partners:
            lefts = [one for one in own.left if _overlap(one, left) and _overlap(one, right)]
            rights = [one for one in own.right if _overlap(one, right) and _overlap(one, left)]
            rivals = [one.name for side in (lefts, rights) if len(side) > 1 for one in side]
            if rivals:  # of two at once on one arm, one has a wrong subject, side or clock
                yield _Found(left, right, refusal=CannotPair(why="several at once", place=", ".join(rivals)))
            else:
                yield _find_trunk(own, _Found(left, right))
        if not partners:
            alone.append(left)
    for left in alone:  # no clocks, or clocks that are days apart
        free = [right for right in own.right if right not in taken]
        found = _match_one(left, free, "right")
        if isinstance(found, AppError):
            yield _Found(left, free[0] if len(free) == 1 else None, refusal=found)
        else:
            taken.add(found[0])
            yield _find_trunk(own, _Found(left, found[0], clock=found[1]))


def _overlap(one: _Analysis, other: _Analysis) -> bool:
    """Return whether the recorded times overlap by the clocks; False if one has no clock."""
    spans = []
    for analysis in (one, other):
        if not analysis.start:
            return False
        begin = datetime.fromisoformat(analysis.start).replace(tzinfo=None)
        spans.append((begin, begin + timedelta(seconds=analysis.recorded_s)))
    (a, b), (c, d) = spans
    return a < d and c < b


def _find_trunk(own: _Subject, pair: _Found) -> _Found:
    """Add the only trunk recording that overlaps the left arm's, by the clocks or by the movement."""
    overlapping = [trunk for trunk in own.trunk if _overlap(pair.left, trunk)]
    if overlapping:
        return replace(pair, trunk=overlapping[0]) if len(overlapping) == 1 else pair
    found = _match_one(pair.left, own.trunk, "trunk")
    return pair if isinstance(found, AppError) else replace(pair, trunk=found[0], trunk_clock=found[1])


def _match_one(
    left: _Analysis, others: Sequence[_Analysis], place: Literal["right", "trunk"]
) -> "tuple[_Analysis, PairClock] | AppError":
    """Return the first recording whose movement certainly matches, and its clock; or the last refusal."""
    from acromion.app.analysis.pair import match_movement  # noqa: PLC0415  slow import
    from acromion.app.report.pairs import PairClock  # noqa: PLC0415

    refusal: AppError = CannotPair(why="apart")
    for other in others:
        try:
            match = match_movement(Path(left.folder), Path(other.folder), place)
        except CannotPair as why:
            refusal = why
        else:
            return other, PairClock(match.offset_s, "signals", match)
    return refusal


def _describe(subject: str, found: _Found) -> Row:
    """Return the row of a pair; without a certain pair only the names and the code of the refusal.

    A trunk without time shared with both arms is named, without figures.
    """
    from acromion.app.analysis.pair import pair_analyses  # noqa: PLC0415  slow import
    from acromion.app.report.pairs import describe_pair  # noqa: PLC0415

    row: Row = {"subject": subject, "left": found.left.name}
    row |= {name: one.name for name, one in (("right", found.right), ("trunk", found.trunk)) if one}
    if found.right is None or found.refusal:
        return row | (_refuse(found.refusal) if found.refusal else {})
    request = PairRequest("pair", languages=("en",), kinds=())
    arms = (Path(found.left.folder), Path(found.right.folder))
    trunks = [Path(found.trunk.folder), None] if found.trunk else [None]
    for trunk in trunks:
        try:
            pair = pair_analyses(arms, trunk, request, (found.clock, found.trunk_clock))
            break
        except (AppError, FusionError) as refusal:
            if trunk is None:
                return row | _refuse(refusal)
    figures = describe_pair(pair)
    match = pair.clock.match
    certainty = pair.clock.certainty
    row |= {"offset_s": pair.clock.offset_s, "certainty": certainty, "drift_ppm": pair.clock.drift_ppm}
    row |= {"offset_margin_s": match.margin_s if match and certainty == "signals" else None}
    row |= {"movement_offset_s": match.offset_s if match else None, "shared_s": figures["shared_s"]}
    for side, arm in figures["arms"].items():
        row[f"{side}_time_above_60_percent"] = arm["time_above_percent"]["60"]
        row[f"{side}_elevation_p50_deg"] = arm["percentiles_deg"]["50"]
        relative = figures["trunk_relative"][side]["percentiles_deg"]
        row[f"{side}_minus_trunk_p50_deg"] = relative["50"] if relative else None
    row["both_above_60_percent"] = figures["both_above_60_percent"]
    row["right_to_left_time_above_60"] = figures["right_to_left"]["time_above_60"]
    row["trunk_certainty"] = pair.trunk_clock.certainty if pair.trunk_clock else None
    rounded: Row = round_all(row, 3)
    return rounded


def _refuse(refusal: AppError | FusionError) -> Row:
    why, place = (str(refusal.facts.get(name, "")) for name in ("why", "place"))
    return {"error_code": refusal.code, "why": f"{why}: {place}" if why == "several at once" else why}
