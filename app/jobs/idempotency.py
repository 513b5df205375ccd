"""Responses kept under their ``Idempotency-Key``, for a client that did not receive them."""

import json
import re
from collections.abc import Collection
from dataclasses import dataclass, replace

from sqlalchemy import Connection, Engine, and_, delete, exists, insert, or_, select, update
from sqlalchemy.exc import IntegrityError

from app.jobs.database.tables import analyses, batch_items, batches, kept_answers, recordings
from app.jobs.queries import RowStore

UNFINISHED_TERM_S = 3600.0
"""After this time a request without a response counts as lost: its server has crashed."""

GONE = 410
"""Status of an emptied response: what it described has been purged. No route responds with 410 itself."""

_FIRST_REFUSAL = 400
_ROWS_AT_ONCE = 200
_OWN_ID = re.compile(
    r'(?:"(?:id|recording_id)":"|/(?:recordings|analyses|validations|batches)/)((?:rec|an|ba)_[0-9a-f]{16})'
)
_TABLES = {"an": analyses, "rec": recordings, "ba": batches}  # in the order in which a purge takes them


@dataclass(frozen=True, slots=True)
class KeptResponse:
    """A response as it was sent; ``status`` None: it is still being made.

    ``fingerprint``: the digest of its request.
    """

    fingerprint: str
    status: int | None
    headers: tuple[tuple[str, str], ...]
    body: bytes


class ResponseStore(RowStore):
    """Rows of kept responses. ``server`` marks the keys that this server holds, apart from its peers'."""

    def __init__(self, engine: Engine, reader: Engine, server: str) -> None:
        super().__init__(engine, reader)
        self._server = server

    def reserve(self, key: str) -> KeptResponse | None:
        """Reserve a key; gives the response that is kept under it already, None where the key was free."""
        row = {"key": key, "fingerprint": "", "age_s": 0.0, "server": self._server}
        try:
            with self._engine.begin() as connection:
                connection.execute(insert(kept_answers).values(row))
        except IntegrityError:
            return self._get(key)
        return None

    def keep(self, key: str, response: KeptResponse) -> None:
        """Keep the response; an emptied one where what it describes was purged meanwhile."""
        with self._engine.begin() as connection:
            is_gone = _is_gone(connection, response)
            kept = replace(response, status=GONE, headers=(), body=b"") if is_gone else response
            values = {
                "fingerprint": kept.fingerprint,
                "status": kept.status,
                "headers": json.dumps(kept.headers),
                "body": kept.body,
            }
            connection.execute(update(kept_answers).where(kept_answers.c.key == key).values(values))

    def is_of(self, kept: KeptResponse, fingerprint: str) -> bool:
        """Tell whether a kept response answers the request of this fingerprint."""
        return kept.fingerprint == fingerprint

    def free(self, key: str) -> None:
        """Free a key whose request had no final response."""
        with self._engine.begin() as connection:
            connection.execute(delete(kept_answers).where(kept_answers.c.key == key))

    def free_unfinished(self) -> None:
        """Free the keys of requests that a crash of this server has ended."""
        mine = (kept_answers.c.status.is_(None), kept_answers.c.server.in_((self._server, "")))
        with self._engine.begin() as connection:
            connection.execute(delete(kept_answers).where(*mine))

    def age(self, elapsed_s: float, term_s: float) -> None:
        """Add elapsed time to every age; delete old responses, and keys whose server did not return."""
        is_lost = and_(kept_answers.c.status.is_(None), kept_answers.c.age_s >= UNFINISHED_TERM_S)
        with self._engine.begin() as connection:
            connection.execute(update(kept_answers).values(age_s=kept_answers.c.age_s + elapsed_s))
            connection.execute(delete(kept_answers).where(or_(kept_answers.c.age_s >= term_s, is_lost)))

    def _get(self, key: str) -> KeptResponse | None:
        row = self._read_one(select(kept_answers).where(kept_answers.c.key == key))
        if row is None:
            return None
        headers = tuple((name, value) for name, value in json.loads(row.headers or "[]"))
        body = row.body or b""
        return KeptResponse(row.fingerprint, row.status, headers, body)


def empty_responses(connection: Connection, ids: Collection[str]) -> None:
    """Empty every kept response that describes what is being purged, and delete all refusals.

    An emptied response keeps its key and its fingerprint, so that the request, sent again, does not create
    again what was purged. A refusal may repeat a subject code that was sent; it has created nothing, and
    the request is processed anew.
    """
    refused = (kept_answers.c.status >= _FIRST_REFUSAL, kept_answers.c.status != GONE)
    connection.execute(delete(kept_answers).where(*refused))
    columns = (kept_answers.c.key, kept_answers.c.headers, kept_answers.c.body)
    successes = select(*columns).where(kept_answers.c.status < _FIRST_REFUSAL)
    rows = connection.execute(successes.execution_options(yield_per=_ROWS_AT_ONCE))
    keys = [row.key for row in rows if not find_ids(row.headers, row.body).isdisjoint(ids)]
    emptied = {"status": GONE, "headers": "[]", "body": b""}
    for key in keys:
        connection.execute(update(kept_answers).where(kept_answers.c.key == key).values(emptied))


def find_ids(headers: str | None, body: bytes | None) -> frozenset[str]:
    """Find the recordings, analyses and batches that a response describes (not those it only compares)."""
    text = f"{headers or ''}\n{(body or b'').decode('utf-8', 'replace')}"
    return frozenset(_OWN_ID.findall(text))


def _is_gone(connection: Connection, response: KeptResponse) -> bool:
    """Tell whether something that the response describes has no row any more.

    The rows are locked until the response is kept: a purge comes before it or after it, never in between.
    """
    if response.status is None or response.status >= _FIRST_REFUSAL:
        return False
    ids = find_ids(json.dumps(response.headers), response.body)
    for prefix, table in _TABLES.items():
        asked = {one for one in ids if one.startswith(f"{prefix}_")}
        held = select(table.c.id).where(table.c.id.in_(asked)).with_for_update(read=True, key_share=True)
        if asked and len(connection.execute(held).all()) != len(asked):
            return True
    return False


def drop_traces(connection: Connection, ids: Collection[str]) -> None:
    """Delete what other tables hold of purged recordings and analyses: kept responses and empty batches.

    ``ids`` are those of the purged. Runs in the transaction that deletes their rows, after that: a batch is
    empty only then, and a response that is kept at the same time has either been committed or finds the
    rows gone.
    """
    no_item = ~exists().where(batch_items.c.batch_id == batches.c.id)
    empty = tuple(connection.execute(select(batches.c.id).where(no_item)).scalars())
    if empty:
        connection.execute(delete(batches).where(batches.c.id.in_(empty), no_item))
    empty_responses(connection, {*ids, *empty})
