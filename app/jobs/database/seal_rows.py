"""Seals the words of rows that an earlier release wrote, a few rows at a time while the server runs.

The copy of the rows that is made before a migration (:mod:`app.jobs.database.migrate`) is sealed likewise: an
erasure reaches it, too. One that an earlier release left in clear, or with digests that are not keyed, is
removed once all rows are sealed.
"""

import zipfile
from pathlib import Path
from typing import Any

from sqlalchemy import (
    Column,
    ColumnElement,
    Connection,
    Engine,
    LargeBinary,
    Table,
    Text,
    and_,
    or_,
    select,
    type_coerce,
    update,
)

from app.jobs.database.dump import read_rows
from app.jobs.database.sealed_text import KeyedDigest, SealedText
from app.jobs.database.tables import metadata
from app.storage.labels import LABELS, MARK, PLAIN, Label, LabelSealer, is_keyed

OWNERS = {"recordings": "id", "analyses": "recording_id", "batches": "id", "uploads": "recording_id"}
"""The column that names what the words of a table belong to; those of any other, to the organisation."""


COPIES_FOLDER, COPIES = "backups", "rows-before-*.zip"


def seal_row(sealer: LabelSealer, table: str, row: dict[str, Any]) -> dict[str, Any]:
    """Give a row, of the tables of any release, with words sealed and digests keyed, unless they are."""
    belongs_to = str(row.get(OWNERS.get(table, "")) or LABELS)
    sealed = dict(row)
    for name in _find_columns(table, KeyedDigest):
        if row.get(name):
            sealed[name] = sealer.key_digest(str(row[name]))
    for name in _find_columns(table, SealedText, LargeBinary):
        value = row.get(name)
        if isinstance(value, bytes | memoryview):
            is_sealed = bytes(value).startswith(MARK.encode())
            sealed[name] = value if is_sealed else sealer.seal_bytes(bytes(value))
        elif _is_open_text(value):
            sealed[name] = sealer.seal(Label(belongs_to, str(value)))
    return sealed


def drop_open_copies(backups: Path) -> tuple[str, ...]:
    """Remove the copies of rows in which words stand open, and those cut short; gives their names."""
    found = [path for path in sorted(backups.glob(COPIES)) if _is_cut(path) or _holds_open_words(path)]
    for path in found:
        path.unlink(missing_ok=True)
    return tuple(path.name for path in found)


def _is_cut(copy: Path) -> bool:
    """Tell whether a crash has cut a copy short: nothing can be had from it, and words may stand open."""
    return not zipfile.is_zipfile(copy)


def _holds_open_words(copy: Path) -> bool:
    with zipfile.ZipFile(copy) as archive:
        rows = ((table, row) for table in metadata.tables for row in read_rows(archive, table))
        return any(_is_open_row(table, row) for table, row in rows)


def _is_open_row(table: str, row: dict[str, Any]) -> bool:
    words = (row.get(name) for name in _find_columns(table, SealedText, LargeBinary))
    digests = (row[name] for name in _find_columns(table, KeyedDigest) if row.get(name))
    return any(_is_open_text(one) for one in words if not isinstance(one, bytes)) or any(
        not is_keyed(one) for one in digests
    )


def _find_columns(table: str, *types: type) -> tuple[str, ...]:
    """Find the columns of some types."""
    return tuple(one.name for one in metadata.tables[table].columns if isinstance(one.type, types))


def seal_rows(engine: Engine, most: int) -> int:
    """Seal the words of at most so many rows of each table; gives how many were sealed."""
    with engine.begin() as connection:
        return sum(_seal_table(connection, table, most) for table in metadata.sorted_tables)


def _seal_table(connection: Connection, table: Table, most: int) -> int:
    columns = [column for column in table.columns if isinstance(column.type, SealedText)]
    if not columns:
        return 0
    keys = tuple(table.primary_key.columns)
    owner = OWNERS.get(table.name)
    asked = (*keys, *([table.c[owner]] if owner and owner not in table.primary_key.columns else []))
    words = [type_coerce(column, Text).label(f"{column.name}_") for column in columns]
    query = select(*asked, *words).where(or_(*(_is_open(column) for column in columns))).limit(most)
    rows = connection.execute(query.with_for_update(skip_locked=True)).all()
    for row in rows:
        found = row._asdict()
        belongs_to = str((owner and found[owner]) or LABELS)
        texts = {column.name: found[f"{column.name}_"] for column in columns}
        sealed = {name: Label(belongs_to, text) for name, text in texts.items() if _is_open_text(text)}
        mine = (key == found[key.name] for key in keys)
        connection.execute(update(table).where(*mine).values(sealed))
    return len(rows)


def _is_open(column: Column[str]) -> ColumnElement[bool]:
    text = type_coerce(column, Text)
    return and_(text.is_not(None), text.not_in(PLAIN), ~text.startswith(MARK))


def _is_open_text(text: str | None) -> bool:
    return text is not None and text not in PLAIN and not text.startswith(MARK)
