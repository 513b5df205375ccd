"""The audit log: one line per act.

A line is in the same transaction as its act. :func:`record` stores it on the connection, the engine inserts
it when the transaction commits, and a rollback drops it with the act. A line contains ids and codes, but no
figure, name or subject code. Each line is also logged as one JSON line, so that the system log can carry it
to another machine.
"""

import json
import logging
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Literal, get_args

from sqlalchemy import Connection, Engine, event, insert, select

from acromion.app.library.database.tables import analyses, audit_log
from acromion.app.library.rows import select_running_s
from acromion.app.logs import AUDIT_LOGGER

Act = Literal[
    "trail.read",
    "trail.exported",
    "trail.shortened",
    "server.started",
    "server.stopped",
    "store.backed_up",
    "store.restored",
    "store.recovered",
    "store.verified",
    "upload.began",
    "upload.described",
    "upload.stored",
    "upload.dropped",
    "recording.stored",
    "recording.read",
    "recording.changed",
    "recording.tagged",
    "recording.trashed",
    "recording.restored",
    "recording.purging",
    "recording.purged",
    "recording.held",
    "recording.let_go",
    "analysis.asked",
    "analysis.succeeded",
    "analysis.failed",
    "analysis.cancelled",
    "analysis.replaced",
    "analysis.purged",
    "report.read",
    "report.concluded",
    "report.released",
    "report.taken_back",
    "conclusion.dismissed",
    "list.read",
    "file.exported",
    "aggregate.read",
    "aggregate.published",
    "study.joined",
    "batch.asked",
    "batch.retried",
    "webhook.added",
    "webhook.dropped",
    "view.saved",
    "view.dropped",
    "columns.named",
    "columns.changed",
    "columns.dropped",
    "live.started",
    "live.ended",
    "retention.changed",
    "refused",
    "refused.more",
    "person.added",
    "person.changed",
    "person.ended",
    "people.read",
    "login.succeeded",
    "login.failed",
    "login.throttled",
    "login.ended",
    "link.made",
    "password.changed",
    "second_factor.changed",
    "token.added",
    "token.ended",
]
ACTS: frozenset[str] = frozenset(get_args(Act))
SYSTEM, AT_MACHINE, NOBODY = "system", "machine", "nobody"
"""Actors other than persons and tokens: workers and housekeeping, the command line, unknown callers."""

_NOTED = "acromion.audit_log"
_CODE = re.compile(r"[\w./:{}=+*~-]{0,120}", re.ASCII)

_actor: ContextVar[str] = ContextVar("actor", default=SYSTEM)
_touched: ContextVar[dict[str, str] | None] = ContextVar("touched", default=None)

logger = logging.getLogger(AUDIT_LOGGER)


def set_actor(who: str) -> None:
    """Set the actor of this task and of the threads it starts."""
    _actor.set(who)


@contextmanager
def acting(who: str) -> Iterator[None]:
    """Set the actor for the block."""
    token = _actor.set(who)
    try:
        yield
    finally:
        _actor.reset(token)


def get_actor() -> str:
    """Return the current actor."""
    return _actor.get()


def begin_collecting_reads() -> dict[str, str]:
    """Start collecting the analyses whose files this task reads: recording id by analysis id."""
    found: dict[str, str] = {}
    _touched.set(found)
    return found


def touch(recording_id: str, analysis_id: str) -> None:
    """Collect an analysis whose files are read."""
    found = _touched.get()
    if found is not None:
        found[analysis_id] = recording_id


def record(
    connection: Connection,
    act: Act,
    recording_id: str = "",
    analysis_id: str = "",
    *,
    other: Mapping[str, str | int] | None = None,
    who: str | None = None,
) -> None:
    """Record an act; its line is written when the transaction of the connection commits.

    Raises ValueError if the act is unknown, or ``other`` contains anything except ids and codes.
    """
    codes = dict(sorted((other or {}).items()))
    if act not in ACTS or not all(_CODE.fullmatch(str(code)) for code in codes.values()):
        raise ValueError(act)
    line = {
        "at": datetime.now(UTC).isoformat(timespec="microseconds"),
        "who": get_actor() if who is None else who,
        "act": act,
        "recording_id": recording_id,
        "analysis_id": analysis_id,
        "other": json.dumps(codes) if codes else "",
    }
    transaction = connection.get_transaction()
    noted_in, lines = connection.info.get(_NOTED, (None, []))
    if noted_in is not transaction:  # drop lines of a rolled-back transaction
        lines = []
    lines.append(line)
    connection.info[_NOTED] = (transaction, lines)


def record_alone(
    engine: Engine, act: Act, other: Mapping[str, str | int] | None = None, who: str | None = None
) -> None:
    """Write the line of an act that changes no row."""
    with engine.begin() as connection:
        record(connection, act, other=other, who=who)


def record_readings(
    engine: Engine, act: Act, read: Sequence[tuple[str, str]], other: Mapping[str, str | int]
) -> None:
    """Write a line for each recording or analysis that is read (recording and analysis id, "" if none)."""
    with engine.begin() as connection:
        for recording_id, analysis_id in read:
            of_it = recording_id or _find_recording(connection, analysis_id)
            record(connection, act, of_it, analysis_id if of_it else "", other=other)


def record_refusal(engine: Engine, asked: str, other: Mapping[str, str | int]) -> None:
    """Write the line of a refused request for an id; "" if it names none."""
    with engine.begin() as connection:
        if asked.startswith("an_"):
            record(connection, "refused", _find_recording(connection, asked), asked, other=other)
        elif asked.startswith("rec_"):
            record(connection, "refused", asked, other=other)
        else:
            record(connection, "refused", other={**other, "asked": asked} if asked else other)


def _find_recording(connection: Connection, analysis_id: str) -> str:
    query = select(analyses.c.recording_id).where(analyses.c.id == analysis_id)
    return str(connection.execute(query).scalar() or "") if analysis_id else ""


def attach_audit_log(engine: Engine) -> None:
    """Make an engine write the recorded lines with each commit."""
    event.listen(engine, "commit", _write_noted)


def _write_noted(connection: Connection) -> None:
    noted_in, lines = connection.info.pop(_NOTED, (None, []))
    if noted_in is None or noted_in is not connection.get_transaction():
        return
    connection.execute(insert(audit_log).values(since_s=select_running_s()), lines)
    for line in lines:
        logger.info(json.dumps({"audit": line["act"]} | line | {"other": json.loads(line["other"] or "{}")}))


# Queries: who accessed a recording, what did a person do.

MOST_IDS = 500


@dataclass(frozen=True, slots=True)
class AuditFilter:
    """A filter for lines; empty fields match any.

    ``begin`` and ``end`` are timestamps, ISO 8601 in UTC; ``end`` itself is excluded. ``recording_ids``: None
    matches any.
    """

    recording_ids: frozenset[str] | None = None
    who: str = ""
    act: str = ""
    begin: str = ""
    end: str = ""


@dataclass(frozen=True, slots=True)
class AuditLine:
    """A line as it is shown and exported."""

    seq: int
    at: str
    who: str
    act: str
    recording_id: str
    analysis_id: str
    other: str


AUDIT_COLUMNS = tuple(AuditLine.__dataclass_fields__)


def find_lines(reader: Engine, asked: AuditFilter, *, before: int = 0, most: int = 0) -> Iterator[AuditLine]:
    """Return the matching lines, newest first; ``before`` continues after a page of them."""
    query = select(*(audit_log.c[name] for name in AUDIT_COLUMNS)).order_by(audit_log.c.seq.desc())
    for name, value in {"who": asked.who, "act": asked.act}.items():
        query = query.where(audit_log.c[name] == value) if value else query
    query = query.where(audit_log.c.at >= asked.begin) if asked.begin else query
    query = query.where(audit_log.c.at < asked.end) if asked.end else query
    query = query.where(audit_log.c.seq < before) if before else query
    if asked.recording_ids is not None:
        query = query.where(audit_log.c.recording_id.in_(sorted(asked.recording_ids)[:MOST_IDS]))
    with reader.connect() as connection:
        found = query.limit(most) if most else query
        for row in connection.execution_options(yield_per=1000).execute(found):
            yield AuditLine(**row._asdict())


def parse_moment(text_: str) -> str:
    """Convert a timestamp of a query to UTC in the format of the lines; without a zone it is UTC.

    Raises ValueError.
    """
    if not text_:
        return ""
    moment = datetime.fromisoformat(text_)
    known = moment if moment.tzinfo else moment.replace(tzinfo=UTC)
    try:
        return known.astimezone(UTC).isoformat(timespec="microseconds")
    except OverflowError as error:  # before the year 1, or after 9999
        raise ValueError(text_) from error
