"""Answers that were given under an ``Idempotency-Key``, for a client that did not hear them."""

import json
import re
from collections.abc import Collection
from dataclasses import dataclass, replace

from sqlalchemy import Connection, Engine, and_, delete, exists, insert, or_, select, update
from sqlalchemy.exc import IntegrityError

from app.jobs.database.tables import analyses, batch_items, batches, kept_answers, recordings

UNFINISHED_TERM_S = 3600.0
"""After which nobody still works at a request, though its server never said so."""

GONE = 410
"""Status of an answer that was emptied: what it spoke of has been purged. No route answers so itself."""

_FIRST_REFUSAL = 400
_ROWS_AT_ONCE = 200
_OWN_ID = re.compile(
    r'(?:"(?:id|recording_id)":"|/(?:recordings|analyses|validations|batches)/)((?:rec|an|ba)_[0-9a-f]{16})'
)
_TABLES = {"an": analyses, "rec": recordings, "ba": batches}  # in the order in which a purge takes them


@dataclass(frozen=True, slots=True)
class KeptAnswer:
    """An answer as it was sent; ``status`` None: it is still being made."""

    fingerprint: str
    status: int | None
    headers: tuple[tuple[str, str], ...]
    body: bytes


class AnswerStore:
    """Rows of kept answers. ``server`` tells the keys that this server holds from those of its peers."""

    def __init__(self, engine: Engine, reader: Engine, server: str) -> None:
        self._engine, self._reader, self._server = engine, reader, server

    def reserve(self, key: str) -> KeptAnswer | None:
        """Take a key; gives what stands there already, or None where the key was free."""
        row = {"key": key, "fingerprint": "", "age_s": 0.0, "server": self._server}
        try:
            with self._engine.begin() as connection:
                connection.execute(insert(kept_answers).values(row))
        except IntegrityError:
            return self._get(key)
        return None

    def keep(self, key: str, answer: KeptAnswer) -> None:
        """Remember the answer; of what was purged before it could be kept, only that it is gone."""
        with self._engine.begin() as connection:
            kept = _empty(answer) if _is_gone(connection, answer) else answer
            values = {
                "fingerprint": kept.fingerprint,
                "status": kept.status,
                "headers": json.dumps(kept.headers),
                "body": kept.body,
            }
            connection.execute(update(kept_answers).where(kept_answers.c.key == key).values(values))

    def free(self, key: str) -> None:
        """Give a key back, for nothing final was answered."""
        with self._engine.begin() as connection:
            connection.execute(delete(kept_answers).where(kept_answers.c.key == key))

    def free_unfinished(self) -> None:
        """Give back the keys of requests that a crash of this server has ended."""
        mine = (kept_answers.c.status.is_(None), kept_answers.c.server.in_((self._server, "")))
        with self._engine.begin() as connection:
            connection.execute(delete(kept_answers).where(*mine))

    def age(self, elapsed_s: float, term_s: float) -> None:
        """Let time pass, and forget what is old, and the keys of servers that did not come back."""
        is_lost = and_(kept_answers.c.status.is_(None), kept_answers.c.age_s >= UNFINISHED_TERM_S)
        with self._engine.begin() as connection:
            connection.execute(update(kept_answers).values(age_s=kept_answers.c.age_s + elapsed_s))
            connection.execute(delete(kept_answers).where(or_(kept_answers.c.age_s >= term_s, is_lost)))

    def _get(self, key: str) -> KeptAnswer | None:
        with self._reader.connect() as connection:
            row = connection.execute(select(kept_answers).where(kept_answers.c.key == key)).one_or_none()
        if row is None:
            return None
        headers = tuple((name, value) for name, value in json.loads(row.headers or "[]"))
        return KeptAnswer(row.fingerprint, row.status, headers, row.body or b"")


def empty_answers(connection: Connection, ids: Collection[str]) -> None:
    """Empty every kept answer that speaks of what is being purged, and forget all refusals.

    An emptied answer keeps its key and its fingerprint, so that the request, asked again, does not make
    anew what was purged. A refusal may repeat a subject code that was sent; it has made nothing, and the
    request is judged anew.
    """
    refused = (kept_answers.c.status >= _FIRST_REFUSAL, kept_answers.c.status != GONE)
    connection.execute(delete(kept_answers).where(*refused))
    told = (kept_answers.c.key, kept_answers.c.headers, kept_answers.c.body)
    made = select(*told).where(kept_answers.c.status < _FIRST_REFUSAL)
    rows = connection.execute(made.execution_options(yield_per=_ROWS_AT_ONCE))
    keys = [row.key for row in rows if not find_ids(row.headers, row.body).isdisjoint(ids)]
    emptied = {"status": GONE, "headers": "[]", "body": b""}
    for key in keys:
        connection.execute(update(kept_answers).where(kept_answers.c.key == key).values(emptied))


def find_ids(headers: str | None, body: bytes | None) -> frozenset[str]:
    """Find the recordings, analyses and batches that an answer is about (not those it only compares with)."""
    text = f"{headers or ''}\n{(body or b'').decode('utf-8', 'replace')}"
    return frozenset(_OWN_ID.findall(text))


def _empty(answer: KeptAnswer) -> KeptAnswer:
    return replace(answer, status=GONE, headers=(), body=b"")


def _is_gone(connection: Connection, answer: KeptAnswer) -> bool:
    """Tell whether something that the answer is about has no row any more.

    The rows are held until the answer is kept: a purge comes before it or after it, never in between.
    """
    if answer.status is None or answer.status >= _FIRST_REFUSAL:
        return False
    ids = find_ids(json.dumps(answer.headers), answer.body)
    for prefix, table in _TABLES.items():
        asked = {one for one in ids if one.startswith(f"{prefix}_")}
        held = select(table.c.id).where(table.c.id.in_(asked)).with_for_update(read=True, key_share=True)
        if asked and len(connection.execute(held).all()) != len(asked):
            return True
    return False


# What a purge takes along in other tables: kept answers that speak of the recording, and empty batches.


def drop_traces(connection: Connection, ids: Collection[str]) -> None:
    """Leave no word of purged recordings and analyses; ``ids`` are theirs.

    For the transaction that deletes their rows, after them: a batch is empty only then, and an answer that
    is kept at the same time has either been committed or sees that the rows are gone.
    """
    no_item = ~exists().where(batch_items.c.batch_id == batches.c.id)
    empty = tuple(connection.execute(select(batches.c.id).where(no_item)).scalars())
    if empty:
        connection.execute(delete(batches).where(batches.c.id.in_(empty), no_item))
    empty_answers(connection, {*ids, *empty})
