"""The database of the accounts of an installation, apart from those of its organisations.

DATA/accounts.sqlite3     made with the first account; on PostgreSQL the schema ``accounts``
"""

import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, Engine, Select, insert, inspect, select

from app.access.tables import REVISION, facts, metadata
from app.jobs.database.connect import READ_ONLY, connect, lock_tables, make_schema
from app.settings import Settings


class AccountDatabase:
    """Opens the database when first asked for; there is none before the first account is made."""

    def __init__(self, settings: Settings) -> None:
        self._url, self._file = _find_place(settings)
        self._engine: Engine | None = None
        self._turn = threading.Lock()
        self.has_notes = True  # another process may have left some

    @property
    def is_there(self) -> bool:
        """Whether there may be rows; to look makes no file."""
        return self._file is None or self._file.exists()

    @staticmethod
    def is_in(connection: Connection) -> bool:
        """Tell whether a PostgreSQL database has the schema of accounts."""
        return "accounts" in inspect(connection).get_schema_names()

    @contextmanager
    def write(self, *, is_act: bool = True, has_lock: bool = False) -> Iterator[Connection]:
        """Give a transaction that alone writes: what it reads, nobody changes before it ends.

        ``is_act``: a note for the trail may be among it. ``has_lock``: the caller holds the lock of the
        tables in another transaction, and opened this database before (:meth:`prepare`).
        """
        with self._open().begin() as connection:
            if not has_lock:
                lock_tables(connection)
            yield connection
        self.has_notes = self.has_notes or is_act

    @contextmanager
    def read(self) -> Iterator[Connection]:
        """Give a transaction that reads every row as of one moment."""
        engine = self._open().execution_options(**READ_ONLY)
        if engine.dialect.name == "postgresql":
            engine = engine.execution_options(isolation_level="REPEATABLE READ")
        with engine.connect() as connection:
            yield connection

    def prepare(self) -> None:
        """Make the database where there is none."""
        self._open()

    def read_all(self, query: Select[Any]) -> Sequence[Any]:
        """Give every row of a query."""
        with self._open().execution_options(**READ_ONLY).connect() as connection:
            return connection.execute(query).all()

    def read_one(self, query: Select[Any]) -> Any | None:
        """Give the only row of a query, or None."""
        with self._open().execution_options(**READ_ONLY).connect() as connection:
            return connection.execute(query).one_or_none()

    def read_value(self, query: Select[Any]) -> Any:
        """Give the first value of a query."""
        with self._open().execution_options(**READ_ONLY).connect() as connection:
            return connection.execute(query).scalar()

    def close(self) -> None:
        """Let go of the database."""
        with self._turn:
            if self._engine is not None:
                self._engine.dispose()
            self._engine = None

    def _open(self) -> Engine:
        """Open the database, and make its tables where there are none."""
        with self._turn:
            if self._engine is None:
                make_schema(self._url)
                engine = connect(self._url)
                with engine.begin() as connection:
                    lock_tables(connection)
                    metadata.create_all(connection)
                    if connection.execute(select(facts.c.value)).first() is None:
                        connection.execute(insert(facts).values(name="revision", value=REVISION))
                self._engine = engine
            return self._engine


def _find_place(settings: Settings) -> tuple[str, Path | None]:
    if settings.database_url.startswith("sqlite"):
        file = settings.data_dir / "accounts.sqlite3"
        return f"sqlite:///{file}", file
    url = settings.database_url
    return f"{url}{'&' if '?' in url else '?'}options=-csearch_path%3Daccounts", None
