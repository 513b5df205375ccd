"""Wrapped keys in PostgreSQL, beside the rows, so that every machine reaches them.

The table is none of ours by name (:mod:`app.jobs.database.tables`): neither a backup nor the copy before a
migration holds it. Leave it out of ``pg_dump`` too: ``--exclude-table-data=recording_keys``. The ledger of
erasures (:mod:`app.storage.erasures`) lies beside it.
"""

import threading
from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass, field

from sqlalchemy import (
    BigInteger,
    Column,
    Connection,
    Engine,
    LargeBinary,
    MetaData,
    NullPool,
    String,
    Table,
    create_engine,
    delete,
    inspect,
    select,
    text,
)
from sqlalchemy.dialects.postgresql import insert

from app.storage.erasures import Erasure, make_entries

CONNECT_TIMEOUT_S = 10
TABLE_LOCK = 0x6163726F6B  # an arbitrary number, that of an advisory lock

recording_keys = Table(
    "recording_keys",
    MetaData(),
    Column("name", String(64), primary_key=True),
    Column("wrapped", LargeBinary, nullable=False),
)


erasures = Table(
    "erasures",
    MetaData(),
    Column("number", BigInteger, primary_key=True),
    Column("id", String(64), nullable=False, unique=True),
    Column("at", String(32), nullable=False),
    Column("chain", String(64), nullable=False),
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
        with self.connect().begin() as connection:
            return connection.execute(row).rowcount == 1

    def read(self, name: str) -> bytes | None:
        """Read one."""
        query = select(recording_keys.c.wrapped).where(recording_keys.c.name == name)
        with self.connect().connect() as connection:
            found = connection.execute(query).scalar()
        return None if found is None else bytes(found)

    def read_all(self) -> Mapping[str, bytes]:
        """Read all; to look makes no table."""
        if not self.is_there():
            return {}
        with self.connect().connect() as connection:
            rows = connection.execute(select(recording_keys).order_by(recording_keys.c.name))
            return {row.name: bytes(row.wrapped) for row in rows}

    def is_empty(self) -> bool:
        """Look for any row."""
        others = select(recording_keys.c.name).where(recording_keys.c.name.like("rec\\_%")).limit(1)
        with self.connect().connect() as connection:
            return connection.execute(others).first() is None

    def remove(self, names: Collection[str]) -> None:
        """Delete some, and have the table written anew: a deleted row stays on the disk before that."""
        if not names:
            return
        engine = self.connect()
        with engine.begin() as connection:
            connection.execute(delete(recording_keys).where(recording_keys.c.name.in_(names)))
        with engine.connect().execution_options(isolation_level="AUTOCOMMIT") as connection:
            connection.execute(text("VACUUM FULL recording_keys"))

    def is_there(self) -> bool:
        """Tell whether there are the tables; to look makes none."""
        if self._engine is not None:
            return True
        with self._reach().connect() as connection:
            return inspect(connection).has_table(recording_keys.name)

    def connect(self) -> Engine:
        """Give an engine; both tables are there."""
        with self._lock:
            if self._engine is None:
                engine = self._reach()
                with engine.begin() as connection:
                    lock = text("SELECT pg_advisory_xact_lock(:key)")
                    connection.execute(lock, {"key": TABLE_LOCK})  # two machines may create it at once
                    recording_keys.create(connection, checkfirst=True)
                    erasures.create(connection, checkfirst=True)
                self._engine = engine
            return self._engine

    def _reach(self) -> Engine:
        timeout = {"connect_timeout": CONNECT_TIMEOUT_S}
        return create_engine(self.url, poolclass=NullPool, connect_args=timeout, hide_parameters=True)


@dataclass(frozen=True, slots=True)
class TableLedger:
    """The ledger of erasures as rows."""

    keys: TableKeys

    def read(self) -> tuple[Erasure, ...]:
        """Read every row; to look makes no table."""
        if not self.keys.is_there():
            return ()
        with self.keys.connect().connect() as connection:
            return _read_entries(connection)

    def append(self, recording_ids: Collection[str]) -> None:
        """Insert rows, one writer at a time."""
        with self.keys.connect().begin() as connection:
            connection.execute(text("LOCK TABLE erasures IN EXCLUSIVE MODE"))
            entries = _read_entries(connection)
            for number, entry in enumerate(make_entries(entries, recording_ids), len(entries) + 1):
                connection.execute(insert(erasures).values(number=number, **asdict(entry)))


def _read_entries(connection: Connection) -> tuple[Erasure, ...]:
    rows = connection.execute(select(erasures).order_by(erasures.c.number))
    return tuple(Erasure(row.id, row.at, row.chain) for row in rows)
