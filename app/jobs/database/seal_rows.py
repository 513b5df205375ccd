"""Seals the words of rows that an earlier release wrote, a few rows at a time while the server runs."""

from sqlalchemy import (
    Column,
    ColumnElement,
    Connection,
    Engine,
    Table,
    Text,
    and_,
    or_,
    select,
    type_coerce,
    update,
)

from app.jobs.database.sealed_text import SealedText
from app.jobs.database.tables import metadata
from app.storage.labels import LABELS, MARK, PLAIN, Label

OWNERS = {"recordings": "id", "analyses": "recording_id", "batches": "id", "uploads": "recording_id"}
"""The column that names what the words of a table belong to; those of any other, to the organisation."""


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
