"""Data governance: retention, releases and published group figures.

A kind without a row is kept permanently; the trash then has the term of the server's settings. Ages are
counted in the running time of the server, never by the clock: a clock that is set forward deletes nothing.
Recordings on hold are not deleted.
"""

import json
import secrets
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from statistics import fmean
from typing import Any, Literal, get_args

from sqlalchemy import ColumnElement, Connection, Select, delete, func, insert, select, text, update

from acromion.app.errors import BadParameter, NoSuchFile, NotHere
from acromion.app.library.audit_log import Act, record
from acromion.app.library.database.tables import (
    aggregate_blocks,
    aggregate_members,
    analyses,
    answers,
    audit_log,
    batch_items,
    batches,
    facts,
    recordings,
    releases,
    result_files,
    retention,
    running_time,
)
from acromion.app.library.recordings import drop_empty_batches
from acromion.app.library.rows import (
    STORED,
    TRANSITIONS,
    TRASHED,
    Job,
    JobState,
    RowStore,
    format_now,
    select_running_s,
)
from acromion.app.library.side_files import increment_revision
from acromion.app.request import find_code
from acromion.fusion.caveats import FEW_H
from acromion.fusion.conventions import FEWEST_PEOPLE

Kind = Literal["recordings", "results", "trash", "trail"]
KINDS: tuple[Kind, ...] = get_args(Kind)
DAY_S = 24 * 3600.0
LONGEST_DAYS = 36_500
GRACE_DAYS = 7
"""Days of running time before a shorter term, or a purge that a script asks for, takes effect."""
MOST_AT_ONCE = 50


class RetentionStore(RowStore):
    """Retention terms in the database, and the data that has reached them."""

    def find_all(self) -> Mapping[Kind, int | None]:
        """Return the term of each kind in days; None if no term is set."""
        rows = {row.kind: int(row.days) for row in self._read_all(select(retention))}
        return {kind: rows.get(kind) for kind in KINDS}

    def put(self, kind: str, days: int | None, *, now: bool = False) -> None:
        """Change the term of a kind; None removes the term.

        After a term was shortened, no data of its kind are deleted for :data:`GRACE_DAYS`, unless ``now``.
        Raises BadParameter.
        """
        check_term(kind, days)
        with self._engine.begin() as connection:
            before = connection.execute(select(retention.c.days).where(retention.c.kind == kind)).scalar()
            is_shorter = days is not None and (before is None or days < before)
            if now or days is None or is_shorter:  # any other change leaves a grace period that has begun
                connection.execute(delete(facts).where(facts.c.name == _GRACE + kind))
            if is_shorter and not now:
                ends_s = connection.execute(select(select_running_s())).scalar_one() + GRACE_DAYS * DAY_S
                connection.execute(insert(facts).values(name=_GRACE + kind, value=str(ends_s)))
            connection.execute(delete(retention).where(retention.c.kind == kind))
            if days is not None:
                connection.execute(insert(retention).values(kind=kind, days=days))
            record(connection, "retention.changed", other={"kind": kind, "days": days or "for_good"})

    def is_in_grace(self, kind: Kind) -> bool:
        """Return whether the term of a kind was shortened less than :data:`GRACE_DAYS` ago."""
        with self._reader.connect() as connection:
            ends_s = connection.execute(select(facts.c.value).where(facts.c.name == _GRACE + kind)).scalar()
            running_s = connection.execute(select(select_running_s())).scalar_one()
        return ends_s is not None and running_s < float(ends_s)

    def count_due(self, kind: str, days: int | None) -> int:
        """Return how many of a kind a term would delete now. Raises BadParameter."""
        check_term(kind, days)
        if days is None:
            return 0
        queries: Mapping[str, Select[Any]] = {
            "recordings": _select_due_recordings(days),
            "results": _select_due_results(days),
            "trash": select(recordings.c.id).where(
                recordings.c.state == TRASHED,
                recordings.c.hold.is_(None),
                recordings.c.trashed_s >= days * DAY_S,
            ),
            "trail": select(audit_log.c.seq).where(_is_old_line(days)),
        }
        with self._reader.connect() as connection:
            counted = select(func.count()).select_from(queries[kind].subquery())
            return int(connection.execute(counted).scalar_one())

    def add_running_time(self, elapsed_s: float) -> None:
        """Add running time."""
        with self._engine.begin() as connection:
            longer = {"running_s": running_time.c.running_s + elapsed_s}
            if connection.execute(update(running_time).values(longer)).rowcount == 0:
                connection.execute(insert(running_time).values(id=1, running_s=elapsed_s))

    def find_due_recordings(self) -> tuple[str, ...]:
        """Return some of the recordings whose term has passed, none on hold."""
        days = self.find_all()["recordings"]
        if days is None or self.is_in_grace("recordings"):
            return ()
        return tuple(row.id for row in self._read_all(_select_due_recordings(days).limit(MOST_AT_ONCE)))

    def find_due_results(self) -> tuple[str, ...]:
        """Return some of the analyses whose term has passed since they ended, none of a recording on hold."""
        days = self.find_all()["results"]
        if days is None or self.is_in_grace("results"):
            return ()
        return tuple(row.id for row in self._read_all(_select_due_results(days).limit(MOST_AT_ONCE)))

    def find_trash_term_s(self, otherwise_s: float) -> float:
        """Return how long the trash is kept; ``otherwise_s`` if no term is set."""
        days = self.find_all()["trash"]
        return otherwise_s if days is None else days * DAY_S

    def drop_analysis(self, analysis_id: str) -> bool:
        """Delete the rows of a finished analysis; return False if its recording is on hold by now.

        Remove its files afterwards: the next start moves files without a row into quarantine.
        """
        mine = analyses.c.id == analysis_id
        held = (
            select(recordings.c.id, recordings.c.hold)
            .join(analyses, analyses.c.recording_id == recordings.c.id)
            .where(mine, _is_over())
        )
        with self._engine.begin() as connection:
            row = connection.execute(held.with_for_update(of=recordings)).one_or_none()
            if row is None or row.hold is not None:
                return False
            connection.execute(delete(result_files).where(result_files.c.analysis_id == analysis_id))
            connection.execute(delete(answers).where(answers.c.analysis_id == analysis_id))
            connection.execute(delete(analyses).where(mine))
            drop_empty_batches(connection)
            increment_revision(connection, row.id)
            record(connection, "analysis.purged", row.id, analysis_id)
        return True

    def shorten_audit_log(self) -> int:
        """Delete lines of the audit log whose term has passed; return their number. A new line records it."""
        days = self.find_all()["trail"]
        if days is None or self.is_in_grace("trail"):
            return 0
        with self._engine.begin() as connection:
            gone = connection.execute(delete(audit_log).where(_is_old_line(days))).rowcount
            if gone:
                record(connection, "trail.shortened", other={"lines": gone})
        return int(gone)


_GRACE = "grace_"
"""Prefix of a fact's name, before the kind; the fact is the running time, s, at which deletions begin."""


def check_term(kind: str, days: int | None) -> None:
    """Check a kind and its term. Raises BadParameter."""
    if kind not in KINDS:
        raise BadParameter(name="kind", value=kind[:20], allowed=", ".join(KINDS))
    if days is not None and not 1 <= days <= LONGEST_DAYS:
        raise BadParameter(name="days", value=str(days)[:20], allowed=f"1 … {LONGEST_DAYS}")


def _select_due_recordings(days: int) -> Select[Any]:
    is_old = select_running_s() - recordings.c.since_s >= days * DAY_S
    return select(recordings.c.id).where(recordings.c.state == STORED, recordings.c.hold.is_(None), is_old)


def _select_due_results(days: int) -> Select[Any]:
    is_old = select_running_s() - func.coalesce(analyses.c.ended_s, 0.0) >= days * DAY_S
    joined = select(analyses.c.id).join(recordings, analyses.c.recording_id == recordings.c.id)
    return joined.where(recordings.c.hold.is_(None), recordings.c.state == STORED, is_old, _is_over())


def _is_old_line(days: int) -> ColumnElement[bool]:
    return audit_log.c.since_s <= select_running_s() - days * DAY_S


def _is_over() -> ColumnElement[bool]:
    return analyses.c.state.in_([state for state in JobState if not TRANSITIONS[state]])


# Releases. A release is a separate row for one report, not for a later version. A further row withdraws it:
# the bytes of the report stay unchanged.


REPORT = "report.pdf"


@dataclass(frozen=True, slots=True)
class Release:
    """Who released a report, and when. ``report_id`` is the SHA-256 of its results."""

    analysis_id: str
    who: str
    at: str
    method_version: str
    report_id: str
    is_taken_back: bool


_COLUMNS = tuple(field.name for field in fields(Release))


class ReleaseStore(RowStore):
    """Releases in the database."""

    def find(self, analysis_id: str) -> Release | None:
        """Return the release of an analysis; None if it was never released or the release was withdrawn."""
        query = select(releases).where(releases.c.analysis_id == analysis_id)
        rows = self._read_all(query.order_by(releases.c.at.desc(), releases.c.id.desc()).limit(1))
        if not rows or rows[0].is_taken_back:
            return None
        columns = rows[0]._asdict()
        return Release(**{name: columns[name] for name in _COLUMNS} | {"is_taken_back": False})

    def release(self, job: Job, who: str) -> Release | None:
        """Release the report of an analysis, unless it is already released.

        Raises NoSuchFile if there is no report, or another has replaced it.
        """
        known = self.find(job.id)
        return known if known is not None else self._add(job, who, "report.released")

    def withdraw(self, job: Job, who: str) -> Release | None:
        """Withdraw a release; a report without one stays unchanged."""
        return None if self.find(job.id) is None else self._add(job, who, "report.taken_back")

    def _add(self, job: Job, who: str, act: Act) -> Release | None:
        if job.state is not JobState.SUCCEEDED or job.replaced_by is not None:
            raise NoSuchFile(name=REPORT)
        row = {"id": f"rel_{secrets.token_hex(8)}", "analysis_id": job.id, "who": who, "at": format_now()}
        version = select(answers.c.method_version).where(answers.c.analysis_id == job.id)
        results = select(result_files.c.sha256).where(
            result_files.c.analysis_id == job.id, result_files.c.name == "results.json"
        )
        with self._engine.begin() as connection:
            connection.execute(select(analyses.c.id).where(analyses.c.id == job.id).with_for_update())
            row |= {"method_version": str(connection.execute(version).scalar() or "")}
            row |= {"report_id": str(connection.execute(results).scalar() or "")}
            taken = {"is_taken_back": int(act == "report.taken_back")}
            connection.execute(insert(releases).values(row | taken))
            increment_revision(connection, job.recording_id)
            record(connection, act, job.recording_id, job.id)
        return self.find(job.id)


# Published group figures of a study for an employer, by the rule of the group profile: five people or more. A
# published block has the rounded means over at least five people of a study who are in no block yet. It is
# computed once and never again. A person counts in one block of the whole organisation. The blocks are
# therefore disjoint: no difference between two blocks, studies or dates describes fewer than five people.
# There is no filter. Subject codes distinguish people; a recording without one does not count.


STEP_PERCENT = 1
STEP_H = 0.5
_LOCK = 0x616767


@dataclass(frozen=True, slots=True)
class Block:
    """Published means over a group; ``people`` and ``recordings`` are rounded down to a multiple of five."""

    id: str
    published_at: str
    people: int
    recordings: int
    time_above_60_percent: float
    recorded_h: float


@dataclass(frozen=True, slots=True)
class StudyGroup:
    """A study and its published blocks, oldest first."""

    id: str
    name: str
    blocks: tuple[Block, ...]


class AggregateStore(RowStore):
    """Published blocks in the database."""

    def find_studies(self, most: int) -> tuple[StudyGroup, ...]:
        """Return every study with a block, newest first."""
        newest = select(batches.c.id).order_by(batches.c.created_at.desc(), batches.c.id.desc()).limit(most)
        groups = (self.publish(row.id) for row in self._read_all(newest))
        return tuple(group for group in groups if group.blocks)

    def publish(self, study_id: str) -> StudyGroup:
        """Return the blocks of a study; add a new one if enough people are not in any yet. Raises NotHere."""
        row = self._read_one(select(batches).where(batches.c.id == study_id))
        if row is None:
            raise NotHere(id=study_id)
        with self._reader.connect() as connection:
            is_due = len(_read_new_people(connection, study_id)) >= FEWEST_PEOPLE
        if is_due:
            self._add_block(study_id)
        mine = select(aggregate_blocks).where(aggregate_blocks.c.study_id == study_id)
        rows = self._read_all(mine.order_by(aggregate_blocks.c.published_at, aggregate_blocks.c.id))
        blocks = tuple(Block(one.id, one.published_at, **json.loads(one.figures)) for one in rows)
        return StudyGroup(row.id, row.name if blocks else "", blocks)

    def _add_block(self, study_id: str) -> None:
        with self._engine.begin() as connection:
            if connection.dialect.name == "postgresql":
                locked = text("SELECT pg_advisory_xact_lock(:key, hashtext(current_schema()))")
                connection.execute(locked, {"key": _LOCK})
            people = _read_new_people(connection, study_id)
            if len(people) < FEWEST_PEOPLE:
                return
            row = {"id": f"agg_{secrets.token_hex(8)}", "study_id": study_id, "published_at": format_now()}
            figures = json.dumps(_average(people.values()))
            connection.execute(insert(aggregate_blocks).values(row | {"figures": figures}))
            members = [one.recording_id for rows in people.values() for one in rows]
            connection.execute(
                insert(aggregate_members),
                [{"recording_id": one, "block_id": row["id"]} for one in dict.fromkeys(members)],
            )
            record(connection, "aggregate.published", other={"study": study_id, "block": row["id"]})


def _read_new_people(connection: Connection, study_id: str) -> Mapping[str, Sequence[Any]]:
    """Return the reports of each person of a study who is not in a block yet, by subject code."""
    columns = (recordings.c.subject, recordings.c.id.label("recording_id"))
    figures = (answers.c.above_60_percent, answers.c.recorded_s)
    query = (
        select(*columns, *figures)
        .join(analyses, analyses.c.recording_id == recordings.c.id)
        .join(batch_items, batch_items.c.analysis_id == analyses.c.id)
        .join(answers, answers.c.analysis_id == analyses.c.id)
        .where(batch_items.c.batch_id == study_id, recordings.c.subject != "")
        .where(recordings.c.state == STORED, analyses.c.state == JobState.SUCCEEDED)
        .where(answers.c.above_60_percent.is_not(None), answers.c.recorded_s.is_not(None))
        .where(answers.c.verdict != "poor", answers.c.recorded_s >= FEW_H * 3600)
        .order_by(recordings.c.subject, recordings.c.id)
    )
    known = select(recordings.c.subject).join(
        aggregate_members, aggregate_members.c.recording_id == recordings.c.id
    )
    counted = {subject.casefold() for subject in connection.execute(known.distinct()).scalars()}
    people: dict[str, list[Any]] = {}
    for row in connection.execute(query):
        if find_code(row.subject) and row.subject.casefold() not in counted:
            people.setdefault(row.subject.casefold(), []).append(row)
    return people


def _average(people: Iterable[Sequence[Any]]) -> dict[str, float]:
    """Return the means over people; each person has the same weight, however many recordings they have."""
    of_each = list(people)
    above = fmean(fmean(row.above_60_percent for row in rows) for rows in of_each)
    hours = fmean(fmean(row.recorded_s / 3600.0 for row in rows) for rows in of_each)
    number = sum(len(rows) for rows in of_each)
    return {
        "people": len(of_each) // FEWEST_PEOPLE * FEWEST_PEOPLE,
        "recordings": number // FEWEST_PEOPLE * FEWEST_PEOPLE,
        "time_above_60_percent": float(round(above / STEP_PERCENT) * STEP_PERCENT),
        "recorded_h": round(hours / STEP_H) * STEP_H,
    }
