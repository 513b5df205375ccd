"""Published group figures of a study for an employer, by the rule of the group profile: five people or more.

What is published is a block: the means over at least five people of a study who are in no block yet, rounded,
computed once and never again. A person counts in one block of the whole organisation. So the blocks are
disjoint: no difference between two of them, of two studies or of two moments gives fewer than five people.
There is no filter. People are told apart by their subject codes; a recording without one counts nowhere.
"""

import json
import secrets
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import Any

from sqlalchemy import Connection, insert, select, text

from app.errors import NotHere
from app.jobs.audit_log import record
from app.jobs.database.tables import (
    aggregate_blocks,
    aggregate_members,
    analyses,
    answers,
    batch_items,
    batches,
    recordings,
)
from app.jobs.job import JobState
from app.jobs.queries import STORED, RowStore, format_now
from app.request import find_code
from fusion.conventions import FEWEST_PEOPLE

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
    """A study and its published blocks, the oldest first."""

    id: str
    name: str
    blocks: tuple[Block, ...]


class AggregateStore(RowStore):
    """Rows of published blocks."""

    def find_studies(self, most: int) -> tuple[StudyGroup, ...]:
        """Give every study, the newest first; the name of one shows only with a block."""
        newest = select(batches.c.id).order_by(batches.c.created_at.desc(), batches.c.id.desc()).limit(most)
        groups = (self.publish(row.id) for row in self._read_all(newest))
        return tuple(group for group in groups if group.blocks)

    def publish(self, study_id: str) -> StudyGroup:
        """Give the blocks of a study, with a new one where enough people are in none. Raises NotHere."""
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
    """Give the reports of each person of a study who counts in no block yet, by subject code."""
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
        .where(answers.c.verdict != "poor")
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
    """Give the means over people, each with the same weight whatever the number of recordings."""
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
