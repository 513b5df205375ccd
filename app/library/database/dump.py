"""Every row of every table as text: one JSON line each, whatever the database and its revision.

Bytes are written as ``{"base64": "..."}``; no column holds an object otherwise.
"""

import base64
import json
import zipfile
from collections.abc import Iterator
from typing import Any

from sqlalchemy import Connection, MetaData, Table

from app.library.database.tables import metadata

ROWS_AT_ONCE = 1000
LEFT_OUT = ("sessions", "tickets", "tries", "known_browsers")
"""What goes on at the moment, and is in no copy: everybody signs in again."""


def reflect_tables(connection: Connection) -> tuple[Table, ...]:
    """Return our tables as they are in this database, referenced tables first.

    Tables that are not ours are neither read nor touched.
    """
    found = MetaData()
    found.reflect(connection, only=lambda name, _: name in metadata.tables)
    return tuple(table for table in found.sorted_tables if table.name in metadata.tables)


def _write_bytes(value: object) -> dict[str, str]:
    if not isinstance(value, bytes | memoryview):
        raise TypeError(type(value).__name__)
    return {"base64": base64.b64encode(value).decode()}


def _read_bytes(value: dict[str, Any]) -> object:
    return base64.b64decode(value["base64"]) if value.keys() == {"base64"} else value


def write_all_rows(connection: Connection, archive: zipfile.ZipFile) -> None:
    """Write every table that is copied as a member of its own, ``rows/<table>.jsonl``."""
    tables = [table for table in reflect_tables(connection) if table.name not in LEFT_OUT]
    streamed = connection.execution_options(yield_per=ROWS_AT_ONCE)
    for table in tables:
        with archive.open(f"rows/{table.name}.jsonl", "w", force_zip64=True) as member:
            for row in streamed.execute(table.select().order_by(*table.primary_key.columns)):
                line = json.dumps(row._asdict(), ensure_ascii=False, default=_write_bytes)
                member.write(line.encode() + b"\n")


def read_rows(archive: zipfile.ZipFile, table: str) -> Iterator[dict[str, Any]]:
    """Return the rows of a table in a backup; none when the backup has no such table."""
    name = f"rows/{table}.jsonl"
    if name in archive.namelist():
        with archive.open(name) as member:
            for line in member:
                yield json.loads(line, object_hook=_read_bytes)


def reset_row(table: str, row: dict[str, Any]) -> dict[str, Any]:
    """Reset what holds only at a row's origin: a running analysis waits again, no side file is written."""
    if table == "recordings" and "side_revision" in row:
        return row | {"side_revision": 0}
    if table == "audit_log":  # numbered again, in order
        return {name: value for name, value in row.items() if name != "seq"}
    if table == "analyses" and row["state"] == "running":
        attempts = int(row["attempts"]) - 1
        return row | {"state": "queued", "token": None, "stage": None, "progress": 0.0, "attempts": attempts}
    return row
