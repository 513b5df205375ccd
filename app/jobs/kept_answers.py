"""Answers that were given under an ``Idempotency-Key``, for a client that did not hear them."""

import json
from dataclasses import dataclass

from sqlalchemy import Engine, delete, insert, select, update
from sqlalchemy.exc import IntegrityError

from app.jobs.tables import kept_answers


@dataclass(frozen=True, slots=True)
class KeptAnswer:
    """An answer as it was sent; ``status`` None: it is still being made."""

    fingerprint: str
    status: int | None
    headers: tuple[tuple[str, str], ...]
    body: bytes


class AnswerStore:
    """Rows of kept answers."""

    def __init__(self, engine: Engine, reader: Engine) -> None:
        self._engine, self._reader = engine, reader

    def reserve(self, key: str) -> KeptAnswer | None:
        """Take a key; gives what stands there already, or None where the key was free."""
        row = {"key": key, "fingerprint": "", "age_s": 0.0}
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
        """Give back the keys of requests that a crash has ended."""
        with self._engine.begin() as connection:
            connection.execute(delete(kept_answers).where(kept_answers.c.status.is_(None)))

    def age(self, elapsed_s: float, term_s: float) -> None:
        """Let time pass, and forget what is old."""
        with self._engine.begin() as connection:
            connection.execute(update(kept_answers).values(age_s=kept_answers.c.age_s + elapsed_s))
            connection.execute(delete(kept_answers).where(kept_answers.c.age_s >= term_s))

    def _get(self, key: str) -> KeptAnswer | None:
        with self._reader.connect() as connection:
            row = connection.execute(select(kept_answers).where(kept_answers.c.key == key)).one_or_none()
        if row is None:
            return None
        headers = tuple((name, value) for name, value in json.loads(row.headers or "[]"))
        return KeptAnswer(row.fingerprint, row.status, headers, row.body or b"")
