"""The accounts of an installation in the backup of the organisation "own".

    accounts/<table>.jsonl    organisations, people, recovery codes, tokens: one row a line

Sessions, links and their last use, wrong tries and known browsers are not in it: after a restore everybody
logs in anew.
"""

import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Connection, Table, func, insert, select

from app.access.database import AccountDatabase
from app.access.tables import REVISION, organisations, people, recovery_codes, tokens
from app.errors import WrongSchema
from app.jobs.database.dump import read_lines, write_rows
from app.settings import Settings

FOLDER = "accounts"
TABLES = (organisations, people, recovery_codes, tokens)
"""Referenced tables first."""


@dataclass(frozen=True, slots=True)
class CopiedPeople:
    """How many people a backup holds; ``present``: how many were there already, so that none was added."""

    number: int
    present: int = 0


def write_accounts(settings: Settings, archive: zipfile.ZipFile) -> CopiedPeople | None:
    """Write the accounts into a backup; None where there are none."""
    database = AccountDatabase(settings)
    try:
        if not database.is_there:
            return None
        with database.read() as connection:
            for table in TABLES:
                with archive.open(f"{FOLDER}/{table.name}.jsonl", "w", force_zip64=True) as member:
                    member.writelines(write_rows(connection, table))
            return CopiedPeople(_count_people(connection))
    finally:
        database.close()


@dataclass(frozen=True, slots=True)
class AccountRows:
    """The accounts of a backup on their way into an installation; nothing happens where it holds none."""

    database: AccountDatabase
    archive: zipfile.ZipFile
    manifest: Mapping[str, Any]

    def prepare(self) -> None:
        """Make the database, before the tables are locked.

        Raises
        ------
        WrongSchema
        """
        if holds_accounts(self.manifest):
            self.database.prepare()

    def restore(self) -> CopiedPeople | None:
        """Add them where nobody has an account yet; whoever calls holds the lock of the tables."""
        if not holds_accounts(self.manifest):
            return None
        number = sum(1 for _ in _read_rows(self.archive, people))
        with self.database.write(is_act=False, has_lock=True) as connection:
            present = _count_people(connection)
            if not present:
                for table in TABLES:
                    _add_rows(connection, self.archive, table)
        return CopiedPeople(number, present)


def holds_accounts(manifest: Mapping[str, Any]) -> bool:
    """Tell whether a backup holds accounts.

    Raises
    ------
    WrongSchema
        They are of another version.
    """
    found = manifest.get(FOLDER)
    if found is not None and found != REVISION:
        raise WrongSchema(found=f"accounts {found}", needed=f"accounts {REVISION}")
    return found is not None


def _add_rows(connection: Connection, archive: zipfile.ZipFile, table: Table) -> None:
    """Add rows; an organisation that is there stays as it is."""
    known = set(connection.execute(select(organisations.c.id)).scalars()) if table is organisations else ()
    rows = [row for row in _read_rows(archive, table) if row.get("id") not in known]
    if rows:
        connection.execute(insert(table), rows)


def _read_rows(archive: zipfile.ZipFile, table: Table) -> Iterator[dict[str, Any]]:
    return read_lines(archive, f"{FOLDER}/{table.name}.jsonl")


def _count_people(connection: Connection) -> int:
    return int(connection.execute(select(func.count()).select_from(people)).scalar_one())
