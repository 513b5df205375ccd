"""The library: every recording with the report that counts, searched, filtered, counted and paged in SQL.

What counts is the newest analysis, unless it has no report and an earlier one has: a repetition that fails
takes nothing away. A batch shows each analysis that it asked for.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

from sqlalchemy import ColumnElement, Engine, Select, and_, case, func, or_, select

from app.jobs.database.tables import analyses, answers, recordings
from app.jobs.figures import Answer
from app.jobs.job import Job, JobState
from app.jobs.rows import STORED, read_job, select_items, select_jobs

Group = Literal["all", "active", "attention", "failed", "good", "caution", "poor", "cancelled"]
GROUPS: tuple[Group, ...] = get_args(Group)
Order = Literal["newest", "name", "subject", "above_60"]
ORDERS: tuple[Order, ...] = get_args(Order)

_ACTIVE = (JobState.QUEUED, JobState.RUNNING)
_DOUBTFUL = ("caution", "poor")


@dataclass(frozen=True, slots=True)
class LibraryFilter:
    """Which recordings are shown; "" asks for any. ``first_day`` and ``last_day`` are ISO dates.

    With ``batch`` the analyses of that batch are shown instead of what counts of each recording.
    """

    text: str = ""
    first_day: str = ""
    last_day: str = ""
    group: Group = "all"
    order: Order = "newest"
    batch: str = ""


@dataclass(frozen=True, slots=True)
class Entry:
    """What counts of a recording, its answer once it has one, and a newer ``attempt`` without a report."""

    job: Job
    answer: Answer | None
    attempt: Job | None = None


class Library:
    """Reads; nothing is ever changed here."""

    def __init__(self, reader: Engine) -> None:
        self._reader = reader

    def list_page(self, wanted: LibraryFilter, limit: int, skip: int = 0) -> tuple[Entry, ...]:
        """Give a page of the recordings, the newest first."""
        is_walked = wanted == LibraryFilter()
        query = (
            _select(wanted, is_walked=is_walked)
            .order_by(*_list_order(wanted.order))
            .limit(limit)
            .offset(skip)
        )
        return self._read(query)

    def count(self, wanted: LibraryFilter) -> Mapping[Group, int]:
        """Count the recordings of each group, among those that text and days ask for."""
        parts = _select(replace(wanted, group="all")).subquery()
        told = (parts.c.state, parts.c.verdict, parts.c.report_id.is_not(None))
        kinds = select(*told, func.count()).group_by(*told)
        counts = dict.fromkeys(GROUPS, 0)
        with self._reader.connect() as connection:
            for state, verdict, has_report, number in connection.execute(kinds):
                for group in _name_groups(JobState(state), verdict, has_report=bool(has_report)):
                    counts[group] += number
        return counts

    def list_others(self, job: Job, limit: int = 6) -> tuple[Entry, ...]:
        """Give other recordings of the same subject that have a report, the newest first."""
        if not job.request.subject:
            return ()
        same = recordings.c.subject == job.request.subject
        other = (analyses.c.recording_id != job.recording_id, _find_report().is_not(None))
        query = _select(LibraryFilter()).where(same, *other).order_by(*_newest_first()).limit(limit)
        return self._read(query)

    def find_neighbours(self, job: Job, wanted: LibraryFilter) -> tuple[str | None, str | None]:
        """Give the analyses shown before and after one, in the order of the list."""
        if wanted.order != "newest":
            return self._find_in_order(job, wanted)
        place = (analyses.c.created_at, analyses.c.id)
        moment, own_id = self._find_place(job, wanted)
        newer = or_(place[0] > moment, and_(place[0] == moment, place[1] > own_id))
        older = or_(place[0] < moment, and_(place[0] == moment, place[1] < own_id))
        before = _select(wanted).where(newer).order_by(place[0].asc(), place[1].asc()).limit(1)
        after = _select(wanted).where(older).order_by(*_newest_first()).limit(1)
        with self._reader.connect() as connection:
            first, second = (connection.execute(query).first() for query in (before, after))
        return _name_shown(first), _name_shown(second)

    def _find_in_order(self, job: Job, wanted: LibraryFilter) -> tuple[str | None, str | None]:
        with self._reader.connect() as connection:
            rows = connection.execute(_select(wanted).order_by(*_list_order(wanted.order))).all()
        shown = [_name_shown(row) for row in rows]
        here = next((k for k, row in enumerate(rows) if row.recording_id == job.recording_id), None)
        if here is None:
            return None, None
        return (shown[here - 1] if here else None), (shown[here + 1] if here + 1 < len(shown) else None)

    def _find_place(self, job: Job, wanted: LibraryFilter) -> tuple[str, str]:
        """Say where the row stands that shows a job: at the newest analysis of its recording."""
        if wanted.batch:
            return job.created_at.isoformat(timespec="microseconds"), job.id
        newest = select(analyses.c.created_at, analyses.c.id).where(
            analyses.c.recording_id == job.recording_id, analyses.c.replaced_by.is_(None)
        )
        with self._reader.connect() as connection:
            row = connection.execute(newest.order_by(*_newest_first()).limit(1)).one()
        return row.created_at, row.id

    def _read(self, query: Select[Any]) -> tuple[Entry, ...]:
        with self._reader.connect() as connection:
            rows = connection.execute(query).all()
            others = [row.report_id for row in rows if row.report_id not in (None, row.id)]
            found = connection.execute(select_jobs().where(analyses.c.id.in_(others))) if others else ()
            reports = {row.id: read_job(row) for row in found}
        return tuple(_read_entry(row, reports.get(row.report_id)) for row in rows)


def _name_shown(row: Any) -> str | None:
    return str(row.report_id or row.id) if row else None


def _list_order(order: Order) -> tuple[ColumnElement[Any], ...]:
    name, subject = func.lower(recordings.c.file_name), func.lower(recordings.c.subject)
    orders: Mapping[Order, tuple[ColumnElement[Any], ...]] = {
        "newest": (),
        "name": (name,),
        "subject": (subject, name),
        "above_60": (answers.c.above_60_percent.desc().nulls_last(),),
    }
    return *orders[order], *_newest_first()


def _newest_first() -> tuple[ColumnElement[Any], ColumnElement[Any]]:
    return analyses.c.created_at.desc(), analyses.c.id.desc()


def _select(wanted: LibraryFilter, *, is_walked: bool = False) -> Select[Any]:
    about = (recordings.c.file_name, recordings.c.size_bytes, recordings.c.sha256)
    told = (answers.c.verdict, answers.c.start, answers.c.recorded_s, answers.c.above_60_percent)
    is_shown: tuple[ColumnElement[bool], ...] = (analyses.c.id == _select_newest(),)
    if wanted.batch:
        is_shown = (analyses.c.id.in_(select_items(wanted.batch)),)
    report_id = _find_own_report() if wanted.batch else _find_report()
    query = (
        select(analyses, *about, *told, report_id.label("report_id"))
        .join(recordings, analyses.c.recording_id == recordings.c.id)
        .outerjoin(answers, answers.c.analysis_id == report_id)
        .where(_is_stored(is_walked=is_walked), *is_shown)
    )
    return query.where(*_list_conditions(wanted))


def _is_stored(*, is_walked: bool) -> ColumnElement[bool]:
    """Leave the trash out; ``is_walked`` hides the index on it, so that SQLite walks the analyses by age."""
    return (func.coalesce(recordings.c.state, "") if is_walked else recordings.c.state) == STORED


def _select_newest() -> Any:
    """Select the newest analysis of the same recording; one that was repeated or withdrawn counts no more."""
    other = analyses.alias()
    counts = (other.c.recording_id == analyses.c.recording_id, other.c.replaced_by.is_(None))
    newest = select(other.c.id).where(*counts)
    return newest.order_by(other.c.created_at.desc(), other.c.id.desc()).limit(1).scalar_subquery()


def _find_own_report() -> ColumnElement[Any]:
    return case((analyses.c.state == JobState.SUCCEEDED, analyses.c.id))


def _find_report() -> ColumnElement[Any]:
    """Find the analysis whose report counts for the recording: this one, or the newest that succeeded."""
    other = analyses.alias()
    good = (other.c.recording_id == analyses.c.recording_id, other.c.state == JobState.SUCCEEDED)
    counting = select(other.c.id).where(*good, other.c.replaced_by.is_(None))
    newest = counting.order_by(other.c.created_at.desc(), other.c.id.desc()).limit(1)
    return case((analyses.c.state == JobState.SUCCEEDED, analyses.c.id), else_=newest.scalar_subquery())


def _list_conditions(wanted: LibraryFilter) -> list[ColumnElement[bool]]:
    report_id = _find_own_report() if wanted.batch else _find_report()
    conditions = [_ask_group(wanted.group, report_id)] if wanted.group != "all" else []
    day = func.coalesce(answers.c.start, analyses.c.created_at)
    if wanted.text:
        text = wanted.text.lower()
        named = (recordings.c.subject, recordings.c.file_name)
        conditions.append(or_(*(func.lower(column).contains(text, autoescape=True) for column in named)))
    if wanted.first_day:
        conditions.append(day >= wanted.first_day)
    if wanted.last_day:
        conditions.append(day < wanted.last_day + "~")  # a whole day: "T07:00" sorts before "~"
    return conditions


def _ask_group(group: Group, report_id: ColumnElement[Any]) -> ColumnElement[bool]:
    failed = analyses.c.state == JobState.FAILED
    states: Mapping[str, ColumnElement[bool]] = {
        "active": analyses.c.state.in_(_ACTIVE),
        "failed": and_(failed, report_id.is_(None)),
        "cancelled": and_(analyses.c.state == JobState.CANCELLED, report_id.is_(None)),
        "attention": or_(failed, answers.c.verdict.in_(_DOUBTFUL)),
    }
    return states.get(group, answers.c.verdict == group)


def _name_groups(state: JobState, verdict: str | None, *, has_report: bool) -> list[Group]:
    groups: list[Group] = ["all"]
    if state in _ACTIVE:
        groups.append("active")
    if state is JobState.CANCELLED and not has_report:
        groups.append("cancelled")
    if state is JobState.FAILED and not has_report:
        groups.append("failed")
    if state is JobState.FAILED or verdict in _DOUBTFUL:
        groups.append("attention")
    groups += [group for group in GROUPS if group == verdict]
    return groups


def _read_entry(row: Any, report: Job | None) -> Entry:
    told = Answer(row.verdict, row.start, row.recorded_s, row.above_60_percent) if row.verdict else None
    return Entry(read_job(row), told) if report is None else Entry(report, told, read_job(row))
