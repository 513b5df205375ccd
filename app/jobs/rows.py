"""Every row of every table as text: one JSON line each, whatever the database and its revision."""

import json
import zipfile
from collections.abc import Iterator
from pathlib import Path

from sqlalchemy import Connection, MetaData, Table

from app.jobs.tables import schema_revision
from app.storage import sync_file, sync_folder

ROWS_AT_ONCE = 1000


def reflect_tables(connection: Connection) -> tuple[Table, ...]:
    """Give our tables as they are in this database, those that others refer to first."""
    found = MetaData()
    found.reflect(connection, only=lambda name, _: not name.startswith("procrastinate"))
    return tuple(table for table in found.sorted_tables if table.name != schema_revision.name)


def write_rows(connection: Connection, table: Table) -> Iterator[bytes]:
    """Give every row of a table as a line of JSON."""
    order = tuple(table.primary_key.columns)
    for row in connection.execution_options(yield_per=ROWS_AT_ONCE).execute(table.select().order_by(*order)):
        yield json.dumps(row._asdict(), ensure_ascii=False).encode() + b"\n"


def write_rows_file(connection: Connection, path: Path) -> None:
    """Write all rows into a ZIP, one member for each table, and make it durable."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(path, "x", zipfile.ZIP_DEFLATED) as archive:
        for table in reflect_tables(connection):
            with archive.open(f"rows/{table.name}.jsonl", "w", force_zip64=True) as member:
                for line in write_rows(connection, table):
                    member.write(line)
    sync_file(path)
    sync_folder(path.parent)
