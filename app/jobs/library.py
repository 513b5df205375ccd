"""The library: every recording with its newest analysis, searched, filtered, counted and paged in SQL."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

from sqlalchemy import ColumnElement, Engine, Select, and_, func, or_, select

from app.jobs.answers import Answer
from app.jobs.job import Job, JobState
from app.jobs.reading import STORED, read_job
from app.jobs.tables import analyses, answers, recordings

Group = Literal["all", "active", "attention", "failed", "good", "caution", "poor", "cancelled"]
GROUPS: tuple[Group, ...] = get_args(Group)

_ACTIVE = (JobState.QUEUED, JobState.RUNNING)
_DOUBTFUL = ("caution", "poor")


@dataclass(frozen=True, slots=True)
class LibraryFilter:
    """Which recordings are shown; "" asks for any. ``first_day`` and ``last_day`` are ISO dates."""

    text: str = ""
    first_day: str = ""
    last_day: str = ""
    group: Group = "all"


@dataclass(frozen=True, slots=True)
class Entry:
    """A recording's newest analysis, and its answer once it has one."""

    job: Job
    answer: Answer | None


class Library:
    """Reads; nothing is ever changed here."""

    def __init__(self, reader: Engine) -> None:
        self._reader = reader

    def list_page(self, wanted: LibraryFilter, limit: int, skip: int = 0) -> tuple[Entry, ...]:
        """Give a page of the recordings, the newest first."""
        is_walked = wanted == LibraryFilter()
        query = _select(wanted, is_walked=is_walked).order_by(*_newest_first()).limit(limit).offset(skip)
        with self._reader.connect() as connection:
            return tuple(_read_entry(row) for row in connection.execute(query))

    def count(self, wanted: LibraryFilter) -> Mapping[Group, int]:
        """Count the recordings of each group, among those that text and days ask for."""
        parts = _select(replace(wanted, group="all")).subquery()
        kinds = select(parts.c.state, parts.c.verdict, func.count()).group_by(parts.c.state, parts.c.verdict)
        counts = dict.fromkeys(GROUPS, 0)
        with self._reader.connect() as connection:
            for state, verdict, number in connection.execute(kinds):
                for group in _name_groups(JobState(state), verdict):
                    counts[group] += number
        return counts

    def list_others(self, job: Job, limit: int = 6) -> tuple[Entry, ...]:
        """Give other recordings of the same subject that have a report, the newest first."""
        if not job.request.subject:
            return ()
        same = recordings.c.subject == job.request.subject
        other = (analyses.c.recording_id != job.recording_id, analyses.c.state == JobState.SUCCEEDED)
        query = _select(LibraryFilter()).where(same, *other).order_by(*_newest_first()).limit(limit)
        with self._reader.connect() as connection:
            return tuple(_read_entry(row) for row in connection.execute(query))

    def find_neighbours(self, job: Job, wanted: LibraryFilter) -> tuple[str | None, str | None]:
        """Give the analyses shown before and after one, in the order of the list."""
        moment = job.created_at.isoformat(timespec="microseconds")
        place = (analyses.c.created_at, analyses.c.id)
        newer = or_(place[0] > moment, and_(place[0] == moment, place[1] > job.id))
        older = or_(place[0] < moment, and_(place[0] == moment, place[1] < job.id))
        before = _select(wanted).where(newer).order_by(place[0].asc(), place[1].asc()).limit(1)
        after = _select(wanted).where(older).order_by(*_newest_first()).limit(1)
        with self._reader.connect() as connection:
            first, second = (connection.execute(query).first() for query in (before, after))
        return (first.id if first else None), (second.id if second else None)


def _newest_first() -> tuple[ColumnElement[Any], ColumnElement[Any]]:
    return analyses.c.created_at.desc(), analyses.c.id.desc()


def _select(wanted: LibraryFilter, *, is_walked: bool = False) -> Select[Any]:
    about = (recordings.c.file_name, recordings.c.size_bytes, recordings.c.sha256)
    told = (answers.c.verdict, answers.c.start, answers.c.recorded_s, answers.c.above_60_percent)
    query = (
        select(analyses, *about, *told)
        .join(recordings, analyses.c.recording_id == recordings.c.id)
        .outerjoin(answers, answers.c.analysis_id == analyses.c.id)
        .where(_is_stored(is_walked=is_walked), analyses.c.id == _select_newest())
    )
    return query.where(*_list_conditions(wanted))


def _is_stored(*, is_walked: bool) -> ColumnElement[bool]:
    """Leave the trash out; ``is_walked`` hides the index on it, so that SQLite walks the analyses by age."""
    return (func.coalesce(recordings.c.state, "") if is_walked else recordings.c.state) == STORED


def _select_newest() -> Any:
    """Select the newest analysis of the same recording."""
    other = analyses.alias()
    newest = select(other.c.id).where(other.c.recording_id == analyses.c.recording_id)
    return newest.order_by(other.c.created_at.desc(), other.c.id.desc()).limit(1).scalar_subquery()


def _list_conditions(wanted: LibraryFilter) -> list[ColumnElement[bool]]:
    conditions = [_ask_group(wanted.group)] if wanted.group != "all" else []
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


def _ask_group(group: Group) -> ColumnElement[bool]:
    failed = analyses.c.state == JobState.FAILED
    states: Mapping[str, ColumnElement[bool]] = {
        "active": analyses.c.state.in_(_ACTIVE),
        "failed": failed,
        "cancelled": analyses.c.state == JobState.CANCELLED,
        "attention": or_(failed, answers.c.verdict.in_(_DOUBTFUL)),
    }
    return states.get(group, answers.c.verdict == group)


def _name_groups(state: JobState, verdict: str | None) -> list[Group]:
    groups: list[Group] = ["all"]
    if state in _ACTIVE:
        groups.append("active")
    if state is JobState.CANCELLED:
        groups.append("cancelled")
    if state is JobState.FAILED:
        groups += ["failed", "attention"]
    if verdict in _DOUBTFUL:
        groups.append("attention")
    groups += [group for group in GROUPS if group == verdict]
    return groups


def _read_entry(row: Any) -> Entry:
    told = Answer(row.verdict, row.start, row.recorded_s, row.above_60_percent) if row.verdict else None
    return Entry(read_job(row), told)
