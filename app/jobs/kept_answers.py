"""Answers that were given under an ``Idempotency-Key``, for a client that did not hear them."""

import json
from dataclasses import dataclass

from sqlalchemy import Engine, and_, delete, insert, or_, select, update
from sqlalchemy.exc import IntegrityError

from app.jobs.tables import kept_answers

UNFINISHED_TERM_S = 3600.0
"""After which nobody still works at a request, though its server never said so."""


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
        """Remember the answer."""
        values = {
            "fingerprint": answer.fingerprint,
            "status": answer.status,
            "headers": json.dumps(answer.headers),
            "body": answer.body,
        }
        with self._engine.begin() as connection:
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
