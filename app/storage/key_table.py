"""Wrapped keys in PostgreSQL, beside the rows, so that every machine reaches them.

The table is none of ours by name (:mod:`app.jobs.database.tables`): neither a backup nor the copy before a
migration holds it. Leave it out of ``pg_dump`` too: ``--exclude-table-data=recording_keys``.
"""

import threading
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

from sqlalchemy import (
    Column,
    Engine,
    LargeBinary,
    MetaData,
    NullPool,
    String,
    Table,
    create_engine,
    delete,
    select,
    text,
)
from sqlalchemy.dialects.postgresql import insert

CONNECT_TIMEOUT_S = 10
TABLE_LOCK = 0x6163726F6B  # an arbitrary number, that of an advisory lock

recording_keys = Table(
    "recording_keys",
    MetaData(),
    Column("name", String(64), primary_key=True),
    Column("wrapped", LargeBinary, nullable=False),
)


@dataclass(slots=True)
class TableKeys:
    """Wrapped keys as rows; the table is created at the first use."""

    url: str = field(repr=False)
    _engine: Engine | None = field(default=None, repr=False)
    _lock: threading.Lock = field(default_factory=threading.Lock, repr=False)

    def add(self, name: str, wrapped: bytes) -> bool:
        """Insert one, unless the name has one."""
        row = insert(recording_keys).values(name=name, wrapped=wrapped).on_conflict_do_nothing()
        with self._connect().begin() as connection:
            return connection.execute(row).rowcount == 1

    def read(self, name: str) -> bytes | None:
        """Read one."""
        query = select(recording_keys.c.wrapped).where(recording_keys.c.name == name)
        with self._connect().connect() as connection:
            found = connection.execute(query).scalar()
        return None if found is None else bytes(found)

    def read_all(self) -> Mapping[str, bytes]:
        """Read all."""
        with self._connect().connect() as connection:
            rows = connection.execute(select(recording_keys).order_by(recording_keys.c.name))
            return {row.name: bytes(row.wrapped) for row in rows}

    def remove(self, names: Collection[str]) -> None:
        """Delete some, and have the table written anew: a deleted row stays on the disk before that."""
        if not names:
            return
        engine = self._connect()
        with engine.begin() as connection:
            connection.execute(delete(recording_keys).where(recording_keys.c.name.in_(names)))
        with engine.connect().execution_options(isolation_level="AUTOCOMMIT") as connection:
            connection.execute(text("VACUUM FULL recording_keys"))

    def _connect(self) -> Engine:
        with self._lock:
            if self._engine is None:
                timeout = {"connect_timeout": CONNECT_TIMEOUT_S}
                engine = create_engine(
                    self.url, poolclass=NullPool, connect_args=timeout, hide_parameters=True
                )
                with engine.begin() as connection:
                    lock = text("SELECT pg_advisory_xact_lock(:key)")
                    connection.execute(lock, {"key": TABLE_LOCK})  # two machines may create it at once
                    recording_keys.create(connection, checkfirst=True)
                self._engine = engine
            return self._engine
