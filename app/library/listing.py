"""The library: every recording, or each shift of it, with its current report, filtered and paged in SQL.

The current report is that of the newest analysis; if that has none, the newest earlier report remains. A
batch shows each analysis that it requested.
"""

import json
import math
import secrets
import statistics
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from datetime import datetime
from pathlib import Path
from typing import Any, Literal, get_args

from sqlalchemy import (
    ColumnElement,
    Connection,
    Engine,
    Select,
    and_,
    case,
    delete,
    func,
    insert,
    or_,
    select,
    true,
    tuple_,
    update,
)

from acromion.app.library.audit_log import record
from acromion.app.library.database.tables import (
    analyses,
    answers,
    batch_items,
    batches,
    recordings,
    saved_views,
)
from acromion.app.library.rows import (
    STORED,
    Job,
    JobState,
    RowStore,
    format_diary,
    format_now,
    read_diary,
    read_job,
    read_tags,
    select_items,
    select_jobs,
    sort_tags,
)
from acromion.app.report.figures import load_results
from acromion.app.request import ReportRequest, find_code
from acromion.app.store.folder import Storage
from acromion.fusion.caveats import FEW_H
from acromion.fusion.conventions import METHOD_VERSION, Side
from acromion.fusion.exposure.types import Interval

Group = Literal["all", "active", "attention", "failed", "good", "caution", "poor", "older", "cancelled"]
GROUPS: tuple[Group, ...] = get_args(Group)
Order = Literal["newest", "name", "subject", "date", "side", "hours", "quality", "above_60"]
ORDERS: tuple[Order, ...] = get_args(Order)

DURATIONS_USED = 40
"""Number of earlier analyses from which the remaining time of one is estimated."""
VIEWS_FILE = "views.json"
_ACTIVE = (JobState.QUEUED, JobState.RUNNING)


# Stored copies of a finished analysis: headline figures for search and lists (the result files remain the
# source of every figure), and its description.


DAY_STEPS = 60
SHORT_S = FEW_H * 3600.0
MAX_OTHERS = 200
"""Most recordings of one person that are offered for a comparison."""

FIELDS = ("subject", "side", "diary")
"""Fields in the description of a recording that a correction on the page may change.

A shift changes the first two, because its diary has only its rows.
"""


def apply_description(connection: Connection, analysis_id: str) -> None:
    """Copy the corrected subject, side and diary of a successful analysis to its recording.

    Only an analysis requested on the page corrects its recording, and only once it has a report: a failed
    correction does not reach later analyses. If neither this analysis nor an earlier one was requested with
    the stored value, a person entered it in the meantime, and it stays.
    """
    about = (recordings.c.id, *(recordings.c[name] for name in FIELDS))
    made = (analyses.c.request, analyses.c.way_in, analyses.c.created_at.label("asked_at"))
    query = select(*made, *about).join(recordings, analyses.c.recording_id == recordings.c.id)
    row = connection.execute(query.where(analyses.c.id == analysis_id)).one()
    asked = ReportRequest.from_json(row.request)
    if row.way_in != "web" or asked.reference is not None:
        return
    names = FIELDS[:2] if asked.shift else FIELDS
    stored = {"subject": row.subject, "side": row.side, "diary": read_diary(row.diary)}
    present = {name: stored[name] for name in names}
    corrected = {name: getattr(asked, name) for name in names}
    if present == corrected:
        return
    until = (analyses.c.recording_id == row.id, analyses.c.created_at <= row.asked_at)
    asked_so_far = connection.execute(select(analyses.c.request).where(*until)).scalars()
    requests = [ReportRequest.from_json(text) for text in asked_so_far]
    known = {name: {getattr(request, name) for request in requests} for name in names}
    changed = {name: corrected[name] for name in names if corrected[name] != present[name] in known[name]}
    if "diary" in changed:
        changed["diary"] = format_diary(asked.diary)
    if changed:
        grown = {"version": recordings.c.version + 1, "revision": recordings.c.revision + 1}
        connection.execute(update(recordings).where(recordings.c.id == row.id).values(changed | grown))
        acts = dict.fromkeys(changed, "adopted")
        record(connection, "recording.changed", row.id, analysis_id, other=acts)


@dataclass(frozen=True, slots=True)
class HeadlineFigures:
    """The verdict and first figures of a report; ``start`` is the device's clock at the first sample.

    ``method`` and ``method_version`` of the angles, "" and 0 if the file contained angles. ``day`` summarises
    the day (:func:`summarise_day`), "" if unknown. ``calibration_state``: see
    :data:`acromion.fusion.conventions.CalibrationState`, "" if there is none. ``above_60_low_percent`` and
    ``above_60_high_percent``: ends of the 95 % range, None if there is none.
    """

    verdict: str
    start: str | None
    recorded_s: float | None
    above_60_percent: float | None
    method: str = ""
    method_version: int = 0
    day: str = ""
    calibration_state: str = ""
    above_60_low_percent: float | None = None
    above_60_high_percent: float | None = None
    analysed_s: float | None = None

    @property
    def is_short(self) -> bool:
        """Whether less than 4 h were analysed, as in the report, too little to rank it among working days."""
        return self.analysed_s is not None and self.analysed_s < SHORT_S

    @property
    def interval(self) -> Interval | None:
        """The 95 % range of the share above 60 deg; None if there is none."""
        low, high = self.above_60_low_percent, self.above_60_high_percent
        return None if low is None or high is None else Interval(low, high)


def read_headline(results: Path) -> HeadlineFigures | None:
    """Read the headline figures from ``results.json``; None if it lacks them."""
    try:
        found = load_results(results.read_bytes())
        recording = found.get("recording", {})
        rows = () if recording.get("side") == "trunk" else found["exposure"]["time_above"]
        above = {row["threshold_deg"]: row for row in rows}.get(60, {})
        method = found.get("method") or {"name": "", "version": 0}
        return HeadlineFigures(
            verdict=found["quality"]["verdict"],
            start=recording.get("start"),
            recorded_s=found["time"]["recorded_s"],
            above_60_percent=above.get("percent"),
            method=method["name"],
            method_version=int(method["version"]),
            day=summarise_day(found["exposure"]["minutes"]["p50_deg"]),
            calibration_state=(found.get("calibration") or {}).get("state") or "",
            above_60_low_percent=above.get("low"),
            above_60_high_percent=above.get("high"),
            analysed_s=found["time"]["analysed_s"],
        )
    except (OSError, ValueError, KeyError, TypeError):
        return None


def summarise_day(medians_deg: Sequence[float | None]) -> str:
    """Return the day in at most 60 steps of whole minutes: each the median of its minutes' medians.

    The values are whole degrees, separated by commas; a step without an analysed minute is empty.
    """
    width = max(1, math.ceil(len(medians_deg) / DAY_STEPS))
    steps = (medians_deg[first : first + width] for first in range(0, len(medians_deg), width))
    known = ([angle for angle in step if angle is not None] for step in steps)
    return ",".join(f"{statistics.median(step):.0f}" if step else "" for step in known)


# The list.


@dataclass(frozen=True, slots=True)
class LibraryFilter:
    """A filter for recordings; "" matches any. ``first_day`` and ``last_day`` are ISO dates.

    ``order`` starts with the newest, the most time above 60 deg, or the poorest quality; ``is_reversed``
    reverses it. Recordings of less than 4 h come last in the last two orders. ``subject`` is a whole code.

    With ``batch`` the list shows the analyses of that batch instead of the current one of each recording.
    """

    text: str = ""
    first_day: str = ""
    last_day: str = ""
    group: Group = "all"
    order: Order = "newest"
    batch: str = ""
    is_reversed: bool = False
    tag: str = ""
    subject: str = ""


@dataclass(frozen=True, slots=True)
class Entry:
    """The current analysis of a recording, with headline figures if available.

    ``attempt`` is a newer analysis without a report. ``folder``: where the file was when it was dropped;
    ``subject``, ``side``: of the recording; they are newer than those of an earlier report.
    """

    job: Job
    headline: HeadlineFigures | None
    attempt: Job | None = None
    tags: tuple[str, ...] = ()
    folder: str = ""
    subject: str = ""
    side: Side | None = None

    @property
    def is_set(self) -> bool:
        """Whether the report is being set again with another label, which is shown at once."""
        return self.attempt is not None and self.attempt.is_label and not self.attempt.is_over

    @property
    def label(self) -> ReportRequest:
        """The request with the subject and arm to show."""
        return self.attempt.request if self.attempt is not None and self.is_set else self.job.request

    @property
    def start(self) -> datetime | None:
        """Start by the device's clock, without its time zone; None if the file has no clock."""
        text = self.headline.start if self.headline else None
        return datetime.fromisoformat(text).replace(tzinfo=None) if text else None

    def find_shared_s(self, other: "Entry") -> float:
        """Return for how long both recorded at the same time, in s; 0 if a clock is missing."""
        starts, lengths = (
            (self.start, other.start),
            [e.headline and e.headline.recorded_s for e in (self, other)],
        )
        if starts[0] is None or starts[1] is None or not lengths[0] or not lengths[1]:
            return 0.0
        apart_s = (starts[1] - starts[0]).total_seconds()
        return max(0.0, min(lengths[0], apart_s + lengths[1]) - max(0.0, apart_s))


def find_other_arm(entry: Entry, others: Iterable[Entry]) -> Entry | None:
    """Return the recording of the other arm of the same shift: that with the longest shared time."""
    opposite: Mapping[Side | None, Side] = {"left": "right", "right": "left"}
    wanted = opposite.get(entry.job.request.side)
    shared = [(entry.find_shared_s(other), other) for other in others if other.job.request.side == wanted]
    most_s, found = max(shared, key=lambda pair: pair[0], default=(0.0, None))
    return found if wanted and most_s > 0 else None


@dataclass(frozen=True, slots=True)
class StudyName:
    """A named study or batch that contains a recording."""

    id: str
    name: str


@dataclass(frozen=True, slots=True)
class PersonRow:
    """A subject code with the number of its recordings."""

    subject: str
    count: int


@dataclass(frozen=True, slots=True)
class AnalysisDuration:
    """Duration of a finished analysis."""

    file_name: str
    size_bytes: int
    took_s: float


class Library(RowStore):
    """The read-only queries of the library."""

    def __init__(self, reader: Engine) -> None:
        super().__init__(reader, reader)

    def find_page(self, wanted: LibraryFilter, limit: int, skip: int = 0) -> tuple[Entry, ...]:
        """Return a page of the recordings, in the order of the filter."""
        query = _select(wanted).order_by(*_choose_order(wanted))
        return self._read(query.limit(limit).offset(skip))

    def find_chosen(self, recording_ids: Collection[str], batch: str = "") -> tuple[Entry, ...]:
        """Return the given recordings, newest first, without those in the trash."""
        chosen = recordings.c.id.in_(recording_ids)
        query = _select(LibraryFilter(batch=batch)).where(chosen)
        return self._read(query.order_by(*_newest_first()))

    def find_durations(self) -> tuple[AnalysisDuration, ...]:
        """Return the durations of the last analyses, from which the remaining time of others is estimated."""
        measured = (analyses.c.state == JobState.SUCCEEDED, analyses.c.priority >= 0)
        query = select_jobs().where(*measured).order_by(analyses.c.created_at.desc(), analyses.c.id.desc())
        jobs = [read_job(row) for row in self._read_all(query.limit(DURATIONS_USED))]
        return tuple(
            AnalysisDuration(job.file_name, job.size_bytes, (job.ended_at - job.started_at).total_seconds())
            for job in jobs
            if job.started_at and job.ended_at and job.request.reference is None
        )

    def find_tags(self) -> tuple[str, ...]:
        """Return every tag in alphabetical order."""
        query = select(recordings.c.tags).where(recordings.c.state == STORED, recordings.c.tags != "[]")
        return sort_tags(tag for row in self._read_all(query) for tag in read_tags(row.tags))

    def count(self, wanted: LibraryFilter) -> Mapping[Group, int]:
        """Count the recordings of each group that match text and days."""
        rows = _select(replace(wanted, group="all")).subquery()
        groups = [_is_in_group(group, rows.c, rows.c, rows.c.report_id) for group in GROUPS]
        query = select(*(func.count().filter(group) for group in groups)).select_from(rows)
        with self._reader.connect() as connection:
            return dict(zip(GROUPS, connection.execute(query).one(), strict=True))

    def find_people(self, text: str, limit: int, skip: int = 0) -> tuple[PersonRow, ...]:
        """Return the subject codes that contain a text, in alphabetical order."""
        query = select(recordings.c.subject, func.count().label("count")).group_by(recordings.c.subject)
        query = query.where(*self._are_people(text)).order_by(func.lower(recordings.c.subject))
        rows = self._read_all(query.limit(limit).offset(skip))
        return tuple(PersonRow(row.subject, row.count) for row in rows)

    def count_people(self, text: str) -> int:
        """Return the number of subject codes that contain a text."""
        query = select(func.count(recordings.c.subject.distinct())).where(*self._are_people(text))
        return int(self._read_value(query))

    def count_of_person(self, subject: str) -> int:
        """Return the number of recordings of a subject code, with a report or not; 0 for "" and unknown."""
        mine = (recordings.c.state == STORED, recordings.c.subject == subject, recordings.c.subject != "")
        return int(self._read_value(select(func.count(recordings.c.id)).where(*mine)))

    def _are_people(self, text: str) -> tuple[ColumnElement[bool], ...]:
        is_named = func.lower(recordings.c.subject).contains(text.lower(), autoescape=True)
        return recordings.c.state == STORED, recordings.c.subject != "", is_named

    def find_of_people(self, subjects: Collection[str]) -> tuple[Entry, ...]:
        """Return the recordings of these subjects that have a report, newest first."""
        mine = (recordings.c.subject.in_(subjects), answers.c.verdict.is_not(None))
        return self._read(_select(LibraryFilter()).where(*mine).order_by(*_newest_first()))

    def find_studies(self, recording_ids: Collection[str]) -> Mapping[str, tuple[StudyName, ...]]:
        """Return the named studies of each of these recordings."""
        query = (
            select(analyses.c.recording_id, batches.c.id, batches.c.name)
            .join(batch_items, batch_items.c.batch_id == batches.c.id)
            .join(analyses, analyses.c.id == batch_items.c.analysis_id)
            .where(analyses.c.recording_id.in_(recording_ids), batches.c.name != "")
            .distinct()
            .order_by(batches.c.name, batches.c.id)
        )
        found: dict[str, tuple[StudyName, ...]] = {}
        for row in self._read_all(query):
            known = found.get(row.recording_id, ())
            found[row.recording_id] = (*known, StudyName(row.id, row.name))
        return found

    def find_others(self, job: Job, limit: int = MAX_OTHERS) -> tuple[Entry, ...]:
        """Find other recordings and shifts of the same subject that have a report, newest first.

        A comparison with a reference does not count as a report.
        """
        if not find_code(job.request.subject):
            return ()
        same = recordings.c.subject == job.request.subject
        other = or_(analyses.c.recording_id != job.recording_id, analyses.c.shift != job.request.shift)
        query = _select(LibraryFilter()).where(same, other, answers.c.verdict.is_not(None))
        return self._read(query.order_by(*_newest_first()).limit(limit))

    def find_neighbours(self, job: Job, wanted: LibraryFilter) -> tuple[str | None, str | None]:
        """Find the analyses shown before and after one, in the order of the list."""
        if wanted.order != "newest" or wanted.is_reversed:
            return self._find_in_order(job, wanted)
        place = _PLACE if wanted.batch else _PLACE[:3]  # a batch may hold several analyses of a recording
        (here,) = self._read_all(_select_places(place).where(analyses.c.id == job.id))
        is_newer, is_older = tuple_(*place) > tuple_(*here), tuple_(*place) < tuple_(*here)
        before = _select(wanted).where(is_newer).order_by(*(column.asc() for column in place)).limit(1)
        after = _select(wanted).where(is_older).order_by(*_newest_first()).limit(1)
        with self._reader.connect() as connection:
            first, second = (connection.execute(query).first() for query in (before, after))
        return _read_shown_id(first), _read_shown_id(second)

    def _find_in_order(self, job: Job, wanted: LibraryFilter) -> tuple[str | None, str | None]:
        rows = self._read_all(_select(wanted).order_by(*_choose_order(wanted)))
        shown = [_read_shown_id(row) for row in rows]
        place = (job.recording_id, job.request.shift)
        here = next((k for k, row in enumerate(rows) if (row.recording_id, row.shift) == place), None)
        if here is None:
            return None, None
        return (shown[here - 1] if here else None), (shown[here + 1] if here + 1 < len(shown) else None)

    def _read(self, query: Select[Any]) -> tuple[Entry, ...]:
        with self._reader.connect() as connection:
            rows = connection.execute(query).all()
            others = [row.report_id for row in rows if row.report_id not in (None, row.id)]
            found = connection.execute(select_jobs().where(analyses.c.id.in_(others))) if others else ()
            reports = {row.id: read_job(row) for row in found}
        return tuple(_read_entry(row, reports.get(row.report_id)) for row in rows)


def _read_shown_id(row: Any) -> str | None:
    return str(row.report_id or row.id) if row else None


DESCENDING: Mapping[Order, ColumnElement[Any]] = {
    "date": answers.c.start,
    "hours": answers.c.recorded_s,
    "above_60": answers.c.above_60_percent,
}
"""Orders that start with the largest value."""
_RANKS = {"poor": 0, "caution": 1, "good": 2}


_WORD_ORDERS: Mapping[str, tuple[ColumnElement[Any], ...]] = {
    "name": (func.lower(recordings.c.file_name),),
    "subject": (func.lower(recordings.c.subject), func.lower(recordings.c.file_name)),
    "side": (recordings.c.side, func.lower(recordings.c.subject)),
}


def _choose_order(wanted: LibraryFilter) -> tuple[ColumnElement[Any], ...]:
    """Return the columns to sort by; rows without a value come last in both directions."""
    if wanted.order == "newest":
        return tuple(column.asc() for column in _PLACE) if wanted.is_reversed else _newest_first()
    words = _WORD_ORDERS.get(wanted.order)
    if words is not None:
        unnamed = (case((recordings.c.subject == "", 1), else_=0),) if wanted.order == "subject" else ()
        turned_words = [(word.desc() if wanted.is_reversed else word.asc()).nulls_last() for word in words]
        return (*unnamed, *turned_words, *_newest_first())
    is_quality = wanted.order == "quality"
    column = case(_RANKS, value=answers.c.verdict) if is_quality else DESCENDING[wanted.order]
    is_falling = (wanted.order in DESCENDING) != wanted.is_reversed
    turned = (column.desc() if is_falling else column.asc()).nulls_last()
    is_ranking = wanted.order in ("quality", "above_60")
    short_last = (case((answers.c.analysed_s < SHORT_S, 1), else_=0),) if is_ranking else ()
    return (*short_last, turned, *_newest_first())


_PLACE: tuple[ColumnElement[Any], ...] = (
    *(recordings.c.created_at, recordings.c.id, analyses.c.shift),
    *(analyses.c.created_at, analyses.c.id),
)
"""A row has the place of its recording and shift: it does not move when its report is made again."""


def _newest_first() -> tuple[ColumnElement[Any], ...]:
    return tuple(column.desc() for column in _PLACE)


def _select_places(place: Sequence[ColumnElement[Any]]) -> Select[Any]:
    return select(*place).join_from(analyses, recordings, analyses.c.recording_id == recordings.c.id)


def _select(wanted: LibraryFilter) -> Select[Any]:
    stored = ("file_name", "size_bytes", "sha256", "tags", "folder", "subject", "side")
    about = (recordings.c[name] for name in stored)
    headline = (answers.c[field.name] for field in fields(HeadlineFigures))
    newest = _select_newest(analyses.alias())
    is_shown: tuple[ColumnElement[bool], ...] = (analyses.c.id == newest,)
    if wanted.batch:
        is_shown = (analyses.c.id.in_(select_items(wanted.batch)),)
    report_id = _select_report(is_own=bool(wanted.batch))
    query = (
        select(analyses, *about, *headline, report_id.label("report_id"))
        .join(recordings, analyses.c.recording_id == recordings.c.id)
        .outerjoin(answers, answers.c.analysis_id == report_id)
        .where(recordings.c.state == STORED, *is_shown)
    )
    return query.where(*_build_conditions(wanted, report_id))


def _select_report(*, is_own: bool) -> ColumnElement[Any]:
    """Select the analysis of the current report: this one, or the newest successful one unless ``is_own``."""
    other = analyses.alias()
    is_made = other.c.state == JobState.SUCCEEDED
    newest = None if is_own else _select_newest(other, is_made)
    return case((analyses.c.state == JobState.SUCCEEDED, analyses.c.id), else_=newest)


def _select_newest(other: Any, *conditions: ColumnElement[bool]) -> Any:
    """Select the newest analysis of a recording and shift that was not replaced and meets the conditions."""
    same = [other.c[name] == analyses.c[name] for name in ("recording_id", "shift")]
    same += [other.c.replaced_by.is_(None), *conditions]
    newest_first = other.c.created_at.desc(), other.c.id.desc()
    return select(other.c.id).where(*same).order_by(*newest_first).limit(1).scalar_subquery()


def _build_conditions(wanted: LibraryFilter, report_id: ColumnElement[Any]) -> list[ColumnElement[bool]]:
    conditions = []
    if wanted.group != "all":
        conditions.append(_is_in_group(wanted.group, analyses.c, answers.c, report_id))
    if wanted.text:
        named = (func.lower(recordings.c[name]) for name in ("subject", "file_name"))
        conditions.append(or_(*(name.contains(wanted.text.lower(), autoescape=True) for name in named)))
    if wanted.subject:
        conditions.append(recordings.c.subject == wanted.subject)
    if wanted.tag:  # tags are JSON: a quoted tag matches only as a whole and with its case
        conditions.append(func.replace(recordings.c.tags, json.dumps(wanted.tag), "") != recordings.c.tags)
    day = func.coalesce(answers.c.start, analyses.c.created_at)
    if wanted.first_day:
        conditions.append(day >= wanted.first_day)
    if wanted.last_day:
        conditions.append(day < wanted.last_day + "~")  # includes the whole day: "T07:00" sorts before "~"
    return conditions


def _is_in_group(group: Group, job: Any, headline: Any, report_id: ColumnElement[Any]) -> ColumnElement[bool]:
    """Return the condition of a group from the columns of analyses and answers."""
    failed, has_no_report = job.state == JobState.FAILED, report_id.is_(None)
    is_long = func.coalesce(headline.analysed_s, SHORT_S) >= SHORT_S
    conditions: Mapping[str, ColumnElement[bool]] = {
        "all": true(),
        "active": job.state.in_(_ACTIVE),
        "failed": and_(failed, has_no_report),
        "cancelled": and_(job.state == JobState.CANCELLED, has_no_report),
        # made by an older method; files with angles have no method
        "older": headline.method_version.between(1, int(METHOD_VERSION) - 1),
        # a short recording is expected to be doubtful: only what makes it unusable needs attention
        "attention": or_(failed, headline.verdict == "poor", and_(headline.verdict == "caution", is_long)),
    }
    return conditions.get(group, headline.verdict == group)


def _read_entry(row: Any, report: Job | None) -> Entry:
    headline, tags = None, read_tags(row.tags)
    if row.verdict:
        figures = (row.verdict, row.start, row.recorded_s, row.above_60_percent)
        made = (row.method or "", row.method_version or 0, row.day or "", row.calibration_state or "")
        interval = row.above_60_low_percent, row.above_60_high_percent
        headline = HeadlineFigures(*figures, *made, *interval, row.analysed_s)
    if report is None:
        return Entry(read_job(row), headline, None, tags, row.folder, row.subject, row.side)
    return Entry(report, headline, read_job(row), tags, row.folder, row.subject, row.side)


@dataclass(frozen=True, slots=True)
class SavedView:
    """A named filter and order of the list; ``query`` is the query string of its address."""

    id: str
    name: str
    query: str
    created_at: str


class SavedViews(RowStore):
    """Saved views, stored in the database and in a file beside the recordings."""

    def __init__(self, engine: Engine, reader: Engine, storage: Storage) -> None:
        super().__init__(engine, reader)
        self._storage = storage

    def find_all(self) -> tuple[SavedView, ...]:
        """Return every view, by name."""
        found = [SavedView(*row) for row in self._read_all(select(saved_views))]
        return tuple(sorted(found, key=lambda view: (view.name, view.id)))

    def add(self, name: str, query: str) -> None:
        """Save a view, replacing one of the same name."""
        view_id = f"view_{secrets.token_hex(8)}"
        row = {"id": view_id, "name": name, "query": query, "created_at": format_now()}
        same = [view.id for view in self.find_all() if view.name == name]
        with self._engine.begin() as connection:
            connection.execute(delete(saved_views).where(saved_views.c.id.in_(same)))
            connection.execute(insert(saved_views).values(row))
            record(connection, "view.saved", other={"view": view_id})
        self.write_file()

    def drop(self, view_id: str) -> None:
        """Delete a view; ignore a missing one."""
        with self._engine.begin() as connection:
            if connection.execute(delete(saved_views).where(saved_views.c.id == view_id)).rowcount == 1:
                record(connection, "view.dropped", other={"view": view_id})
        self.write_file()

    def write_file(self) -> None:
        """Write the file of all views if it differs from the rows."""
        content = json.dumps(
            [asdict(view) for view in self.find_all()], ensure_ascii=False, indent=1
        ).encode()
        if (self._storage.read_small(VIEWS_FILE) or b"[]") != content:
            self._storage.write_small(VIEWS_FILE, content)

    def recover(self) -> int:
        """Add views from the file that the database lacks; return their number."""
        try:
            found = [SavedView(**row) for row in json.loads(self._storage.read_small(VIEWS_FILE) or b"[]")]
        except (ValueError, TypeError):
            return 0
        known = {view.id for view in self.find_all()}
        rows = [asdict(view) for view in found if view.id not in known]
        if rows:
            with self._engine.begin() as connection:
                connection.execute(insert(saved_views), rows)
        return len(rows)
