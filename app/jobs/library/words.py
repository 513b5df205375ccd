"""What recordings are called, held in memory: rows hold it sealed, and SQL cannot search it."""

import json
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sqlalchemy import CTE, Connection, Engine, cast, func, literal, select
from sqlalchemy.dialects.postgresql import JSONB

from app.jobs.database.sealed_text import find_sealer
from app.jobs.database.tables import recordings
from app.jobs.queries import read_tags

ROWS_AT_ONCE = 500


@dataclass(frozen=True, slots=True)
class Words:
    """The words of a recording that people search and sort by."""

    file_name: str
    subject: str
    external_id: str
    tags: tuple[str, ...]


class WordIndex:
    """The words of every recording; what has changed is read again at each question."""

    def __init__(self, reader: Engine) -> None:
        self._reader = reader
        self._turn = threading.Lock()
        self._held: dict[str, tuple[int, Words]] = {}

    def find(self, matches: Callable[[Words], bool]) -> tuple[str, ...]:
        """Give the recordings whose words match."""
        return tuple(name for name, (_, words) in self._read().items() if matches(words))

    def sort(self, key: Callable[[Words], Any], *, is_reversed: bool) -> tuple[str, ...]:
        """Give every recording in the order of a key of its words."""
        held = self._read()
        return tuple(sorted(held, key=lambda name: key(held[name][1]), reverse=is_reversed))

    def _read(self) -> Mapping[str, tuple[int, Words]]:
        """Give the words by recording, each with the revision of its row; a dict that is never changed."""
        with self._turn, self._reader.connect() as connection:
            found = connection.execute(select(recordings.c.id, recordings.c.revision)).all()
            revisions = {row.id: row.revision for row in found}
            stale = [name for name, revision in revisions.items() if self._find_revision(name) != revision]
            if stale or len(revisions) != len(self._held):
                kept = {name: held for name, held in self._held.items() if name in revisions}
                self._held = kept | self._read_rows(connection, stale)
            return self._held

    def _find_revision(self, recording_id: str) -> int:
        held = self._held.get(recording_id)
        return held[0] if held else 0

    def _read_rows(self, connection: Connection, names: Sequence[str]) -> dict[str, tuple[int, Words]]:
        if len(names) > ROWS_AT_ONCE:
            find_sealer(self._reader).hold_all()
        columns = (recordings.c[name] for name in ("id", "revision", *_COLUMNS))
        query, read = select(*columns), {}
        for first in range(0, len(names), ROWS_AT_ONCE):
            some = query.where(recordings.c.id.in_(names[first : first + ROWS_AT_ONCE]))
            for row in connection.execute(some):
                words = Words(row.file_name, row.subject, row.external_id, read_tags(row.tags))
                read[row.id] = (row.revision, words)
        return read


_COLUMNS = ("file_name", "subject", "external_id", "tags")


def use_index(engine: Engine, index: WordIndex) -> None:
    """Let the stores of an engine share one index."""
    engine.dialect.acromion_words = index  # type: ignore[attr-defined]


def find_index(engine: Engine) -> WordIndex:
    """Give the index of an engine."""
    index: WordIndex = engine.dialect.acromion_words  # type: ignore[attr-defined]
    return index


def build_places(engine: Engine, recording_ids: Sequence[str]) -> CTE:
    """Build a table of some recordings and their places, ``id`` and ``place``, of any number of them."""
    ids = json.dumps(recording_ids)
    if engine.dialect.name == "postgresql":
        every = func.jsonb_array_elements_text(cast(literal(ids), JSONB))
        rows = every.table_valued("id", with_ordinality="place").render_derived()
        return select(rows.c.id, rows.c.place).cte()
    listed = func.json_each(literal(ids)).table_valued("key", "value")
    return select(listed.c.value.label("id"), listed.c.key.label("place")).cte()


def sort_key(words: Words, names: Iterable[str]) -> tuple[str, ...]:
    """Give the key to sort words by, whatever their case."""
    return tuple(str(getattr(words, name)).lower() for name in names)
