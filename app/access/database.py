"""The rows of accounts, in the database of the recordings; there is no database before something is kept."""

import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, Engine, Select, func, inspect, select, text

from app.jobs.database.connect import READ_ONLY, connect, find_database_file, open_database
from app.jobs.database.tables import people
from app.settings import Settings

_LOCK = 0x61636374  # an arbitrary number: whoever holds this advisory lock writes accounts


class AccountDatabase:
    """Reads and writes accounts; ``engine`` is that of a server, else the database is opened at first use."""

    def __init__(self, settings: Settings, engine: Engine | None = None) -> None:
        self._url, self._engine, self._is_lent = settings.database_url, engine, engine is not None
        self._turn = threading.Lock()

    @contextmanager
    def write(self) -> Iterator[Connection]:
        """Open a transaction that alone writes accounts: nobody changes what it reads before it ends."""
        with self._open().begin() as connection:  # SQLite has locked the database by this
            if connection.dialect.name == "postgresql":
                connection.execute(text("SELECT pg_advisory_xact_lock(:key)"), {"key": _LOCK})
            yield connection

    def has_people(self) -> bool:
        """Return whether there is any account; to look makes neither file nor table."""
        query = select(func.count()).select_from(people)
        if self._engine is not None:
            return bool(self.read_value(query))
        file = find_database_file(self._url)
        if file is not None and not Path(file).exists():
            return False
        engine = connect(self._url)
        try:
            with engine.execution_options(**READ_ONLY).connect() as connection:
                is_there = inspect(connection).has_table(people.name)
                return is_there and bool(connection.execute(query).scalar())
        finally:
            engine.dispose()

    def read_all(self, query: Select[Any]) -> Sequence[Any]:
        """Return every row of a query."""
        with self._open().execution_options(**READ_ONLY).connect() as connection:
            return connection.execute(query).all()

    def read_one(self, query: Select[Any]) -> Any | None:
        """Return the only row of a query, or None."""
        with self._open().execution_options(**READ_ONLY).connect() as connection:
            return connection.execute(query).one_or_none()

    def read_value(self, query: Select[Any]) -> Any:
        """Return the first value of a query."""
        with self._open().execution_options(**READ_ONLY).connect() as connection:
            return connection.execute(query).scalar()

    def close(self) -> None:
        """Let go of the database, unless it is a server's."""
        with self._turn:
            if self._engine is not None and not self._is_lent:
                self._engine.dispose()
                self._engine = None

    def _open(self) -> Engine:
        with self._turn:
            if self._engine is None:
                self._engine = open_database(self._url)
            return self._engine
