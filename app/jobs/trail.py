"""The trail: a line for every act on the data of an organisation, chained by SHA-256.

A line stands in the commit of its act: :func:`record` notes it on the connection, and the engine writes what
was noted when the transaction commits. The head of the chain is locked last, so that no deadlock comes of it;
a rollback drops the lines with the act. A line holds ids and codes: no figure, name or subject code.

The time of a line is that of its chaining, and never before that of the line before. Where the act was done
at another moment, its codes begin with that (``done_at``).
"""

import hashlib
import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from typing import Any, Literal, get_args

from sqlalchemy import ColumnElement, Connection, Engine, Select, case, event, func, insert, select, text

from app.jobs.database.tables import analyses, trail

Act = Literal[
    "trail.began",
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
    "organisation.added",
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
"""Who acts where no person or token does: workers and housekeeping, the command line, somebody unknown."""

_LOCK = 0x74726C  # an arbitrary number: whoever holds this advisory lock writes the chain's next line
_NOTED = "acromion.trail"
_CODE = re.compile(r"[\w./:{}=+*~-]{0,120}", re.ASCII)
_GENESIS = ""

_actor: ContextVar[str] = ContextVar("actor", default=SYSTEM)
_touched: ContextVar[dict[str, str] | None] = ContextVar("touched", default=None)


def set_actor(who: str) -> None:
    """Set who acts in this task, and in the threads it starts."""
    _actor.set(who)


@contextmanager
def acting(who: str) -> Iterator[None]:
    """Set who acts for a while."""
    token = _actor.set(who)
    try:
        yield
    finally:
        _actor.reset(token)


def find_actor() -> str:
    """Give who acts here."""
    return _actor.get()


def begin_touching() -> dict[str, str]:
    """Begin to collect the analyses whose files this task reads: recording by analysis."""
    found: dict[str, str] = {}
    _touched.set(found)
    return found


def touch(recording_id: str, analysis_id: str) -> None:
    """Collect an analysis whose files are read now."""
    found = _touched.get()
    if found is not None:
        found[analysis_id] = recording_id


@dataclass(frozen=True, slots=True)
class Line:
    """A line that is not chained yet; ``codes`` are further ids and codes."""

    who: str
    act: str
    recording_id: str
    analysis_id: str
    codes: Mapping[str, str | int]
    done_at: str


def record(
    connection: Connection,
    act: Act,
    recording_id: str = "",
    analysis_id: str = "",
    *,
    other: Mapping[str, str | int] | None = None,
    who: str | None = None,
    done_at: str = "",
) -> None:
    """Note an act; its line is written when the transaction of the connection commits.

    ``done_at``: when it was done, where that was before.

    Raises
    ------
    ValueError
        The act is not on the list, or ``other`` holds more than ids and codes.
    """
    codes = {} if other is None else dict(other)
    if act not in ACTS or not all(_CODE.fullmatch(str(code)) for code in codes.values()):
        raise ValueError(act)
    who = find_actor() if who is None else who
    _find_noted(connection).append(Line(who, act, recording_id, analysis_id, codes, done_at))


def record_alone(
    engine: Engine, act: Act, other: Mapping[str, str | int] | None = None, who: str | None = None
) -> None:
    """Write the line of an act that changes no row."""
    with engine.begin() as connection:
        record(connection, act, other=other, who=who)


def record_readings(
    engine: Engine, act: Act, read: Sequence[tuple[str, str]], other: Mapping[str, str | int]
) -> None:
    """Write a line for each recording or analysis that is read (recording and analysis id, "" where none)."""
    with engine.begin() as connection:
        for recording_id, analysis_id in read:
            of_it = recording_id or _find_recording(connection, analysis_id)
            known = analysis_id if of_it else ""
            record(connection, act, recording_id=of_it, analysis_id=known, other=other)


def record_refusal(engine: Engine, kind: str, asked: str, other: Mapping[str, str | int]) -> None:
    """Write the line of an id that was refused, with its kind (``rec``, ``an`` …); "" where there is none.

    An id of another organisation is written like one of nobody.
    """
    with engine.begin() as connection:
        if kind == "an":
            record(connection, "refused", _find_recording(connection, asked), asked, other=other)
        elif kind == "rec":
            record(connection, "refused", asked, other=other)
        else:
            record(connection, "refused", other={**other, "asked": asked} if asked else other)


def keep_trail(engine: Engine) -> None:
    """Let an engine write what was noted with each commit."""
    event.listen(engine, "commit", _write_noted)


def _find_recording(connection: Connection, analysis_id: str) -> str:
    query = select(analyses.c.recording_id).where(analyses.c.id == analysis_id)
    return str(connection.execute(query).scalar() or "") if analysis_id else ""


def _find_noted(connection: Connection) -> list[Line]:
    """Give the lines noted in this transaction; those of another, which was rolled back, are dropped."""
    transaction = connection.get_transaction()
    known = connection.info.get(_NOTED)
    if known is None or known[0] is not transaction:
        known = connection.info[_NOTED] = (transaction, [])
    lines: list[Line] = known[1]
    return lines


def _write_noted(connection: Connection) -> None:
    known = connection.info.pop(_NOTED, None)
    if known is not None and known[0] is connection.get_transaction() and known[1]:
        _append(connection, known[1])


def _append(connection: Connection, lines: Iterable[Line]) -> None:
    """Chain lines to the head, which is locked until the commit.

    Where the clock is behind the head (it was put back, or is another machine's) a line has the time of the
    head, and the clock's as the moment of its act.
    """
    if connection.dialect.name == "postgresql":
        locked = text("SELECT pg_advisory_xact_lock(:key, hashtext(current_schema()))")
        connection.execute(locked, {"key": _LOCK})
    head = connection.execute(_select_head()).one_or_none()
    seq, prev, at = (head.seq, head.hash, head.at) if head else (0, _GENESIS, "")
    now = datetime.now(UTC).isoformat(timespec="microseconds")
    rows = []
    for line in lines:
        seq += 1
        row = asdict(line) | {"seq": seq, "at": max(now, at), "prev": prev}
        done_at, codes = row.pop("done_at") or (now if now < at else ""), row.pop("codes")
        row["other"] = write_codes(codes, done_at)
        prev = row["hash"] = hash_line(row)
        rows.append(row)
    connection.execute(insert(trail), rows)


_DONE = '{"done_at": "'
"""How the codes of a line begin that was chained later than its act; the moment has 32 characters."""


def write_codes(codes: Mapping[str, str | int], done_at: str = "") -> str:
    """Write the codes of a line as JSON, sorted, the moment of its act before them."""
    told = ({"done_at": done_at} if done_at else {}) | dict(sorted(codes.items()))
    return json.dumps(told) if told else ""


def read_done_at(other: str) -> str:
    """Give the moment of an act from the codes of its line; "" where it is the line's time."""
    return other[len(_DONE) :].partition('"')[0] if other.startswith(_DONE) else ""


def _find_moment() -> ColumnElement[str]:
    """Give the moment of an act in a query."""
    told = func.substr(trail.c.other, len(_DONE) + 1, 32)
    return case((trail.c.other.startswith(_DONE, autoescape=True), told), else_=trail.c.at)


def _select_head() -> Select[Any]:
    return select(trail.c.at, trail.c.seq, trail.c.hash).order_by(trail.c.seq.desc()).limit(1)


HASHED = ("seq", "at", "who", "act", "recording_id", "analysis_id", "other", "prev")


def hash_line(row: Mapping[str, Any]) -> str:
    """Give the SHA-256 of a line: of its columns in order, as JSON, with the hash of the line before."""
    content = json.dumps([row[name] for name in HASHED], ensure_ascii=True, separators=(",", ":"))
    return hashlib.sha256(content.encode()).hexdigest()


# Proof: what was altered, removed or cut off.


@dataclass(frozen=True, slots=True)
class Head:
    """The last line of a chain at some moment, as it was written down elsewhere."""

    at: str
    seq: int
    hash: str


@dataclass(frozen=True, slots=True)
class TrailFault:
    """A fault of the chain: its kind, and the first and last line that it is about."""

    finding: Literal["altered", "replaced", "removed", "cut", "not_anchored"]
    first: int
    last: int


def read_head(reader: Engine) -> Head:
    """Give the head of the chain; line 0 where there is none."""
    with reader.connect() as connection:
        row = connection.execute(_select_head()).one_or_none()
    return Head(row.at, row.seq, row.hash) if row else Head("", 0, _GENESIS)


def is_of_no_recording(reader: Engine) -> bool:
    """Tell whether the trail is there from its first line on, and none is of a recording."""
    first = select(trail.c.seq).where(trail.c.seq == 1)
    any_of_one = select(trail.c.seq).where(trail.c.recording_id != "").limit(1)
    with reader.connect() as connection:
        has_first = connection.execute(first).first() is not None
        return has_first and connection.execute(any_of_one).first() is None


def check_chain(reader: Engine, anchors: Sequence[Head] = ()) -> tuple[int, tuple[TrailFault, ...]]:
    """Read the whole trail; gives the number of its lines, and every fault.

    A line that was altered does not have its hash; one that was written anew with its hash is not what the
    next names; one that was removed leaves a gap. The end that was cut off shows only by ``anchors``.
    """
    with reader.connect() as connection:
        start = _read_start(connection)
        walk = _Walk(*start, {anchor.seq: anchor.hash for anchor in anchors})
        rows = connection.execution_options(yield_per=1000).execute(select(trail).order_by(trail.c.seq))
        for row in rows:
            walk.step(row._asdict())
    faults = walk.faults
    last = max((anchor.seq for anchor in anchors), default=0)
    if not walk.number and not last:
        faults.append(TrailFault("removed", 1, 1))
    if last > walk.seq:
        faults.append(TrailFault("cut", walk.seq + 1, last))
    return walk.number, tuple(faults)


class _Walk:
    """A walk along the chain, from the line before its first."""

    def __init__(self, seq: int, prev: str, anchored: Mapping[int, str]) -> None:
        self.seq, self.number = seq, 0
        self.faults: list[TrailFault] = []
        self._prev, self._anchored = prev, anchored

    def step(self, row: Mapping[str, Any]) -> None:
        seq = int(row["seq"])
        if seq > self.seq + 1:
            self.faults.append(TrailFault("removed", self.seq + 1, seq - 1))
        elif row["prev"] != self._prev:
            self.faults.append(TrailFault("replaced", self.seq, seq))
        if hash_line(row) != row["hash"]:
            self.faults.append(TrailFault("altered", seq, seq))
        elif self._anchored.get(seq, row["hash"]) != row["hash"]:
            self.faults.append(TrailFault("not_anchored", seq, seq))
        self.seq, self._prev, self.number = seq, row["hash"], self.number + 1


def _read_start(connection: Connection) -> tuple[int, str]:
    """Give number and hash of the line before the first: retention says which it removed last."""
    query = select(trail.c.other).where(trail.c.act == "trail.shortened").order_by(trail.c.seq.desc())
    written = connection.execute(query.limit(1)).scalar()
    if written is None:
        return 0, _GENESIS
    try:
        found = json.loads(written)
        return int(found["until"]), str(found["hash"])
    except (ValueError, KeyError, TypeError):  # altered: its own line says so
        return 0, _GENESIS


# Questions: who touched a recording, what did somebody do.

MOST_IDS = 500


@dataclass(frozen=True, slots=True)
class TrailQuestion:
    """Which lines are asked for; what is left out lets any through.

    ``begin`` and ``end`` are moments of acts, ISO 8601 in UTC; one at ``end`` is left out. ``recording_ids``:
    None for any.
    """

    recording_ids: frozenset[str] | None = None
    who: str = ""
    act: str = ""
    begin: str = ""
    end: str = ""


@dataclass(frozen=True, slots=True)
class TrailLine:
    """A line of the trail as it is shown and exported."""

    seq: int
    at: str
    who: str
    act: str
    recording_id: str
    analysis_id: str
    other: str
    prev: str
    hash: str


def find_lines(
    reader: Engine, asked: TrailQuestion, *, before: int = 0, most: int = 0
) -> Iterator[TrailLine]:
    """Give the lines that a question is about, the newest first; ``before`` goes on after a page of them."""
    query = select(trail).order_by(trail.c.seq.desc())
    equal = {"who": asked.who, "act": asked.act}
    for name, value in equal.items():
        query = query.where(trail.c[name] == value) if value else query
    query = query.where(_find_moment() >= asked.begin) if asked.begin else query
    query = query.where(_find_moment() < asked.end) if asked.end else query
    query = query.where(trail.c.seq < before) if before else query
    if asked.recording_ids is not None:
        query = query.where(trail.c.recording_id.in_(sorted(asked.recording_ids)[:MOST_IDS]))
    with reader.connect() as connection:
        found = query.limit(most) if most else query
        for row in connection.execution_options(yield_per=1000).execute(found):
            yield TrailLine(**row._asdict())


def parse_moment(text_: str) -> str:
    """Read a moment of a question as the lines hold it, in UTC; without a zone it is UTC.

    Raises
    ------
    ValueError
    """
    if not text_:
        return ""
    moment = datetime.fromisoformat(text_)
    known = moment if moment.tzinfo else moment.replace(tzinfo=UTC)
    try:
        return known.astimezone(UTC).isoformat(timespec="microseconds")
    except OverflowError as error:  # before the year 1, or after 9999
        raise ValueError(text_) from error
