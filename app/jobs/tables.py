"""The tables of the database, in words that SQLite and PostgreSQL both understand."""

from pathlib import Path
from typing import Any

from sqlalchemy import (
    BigInteger,
    Column,
    Connection,
    Engine,
    Float,
    ForeignKey,
    Index,
    Integer,
    MetaData,
    String,
    Table,
    Text,
    create_engine,
    event,
)

metadata = MetaData()

recordings = Table(
    "recordings",
    metadata,
    Column("id", String(32), primary_key=True),
    Column("sha256", String(64), nullable=False, index=True),
    Column("size_bytes", BigInteger, nullable=False),
    Column("file_name", Text, nullable=False),
    Column("state", String(16), nullable=False),
    Column("created_at", String(32), nullable=False),
    Column("subject", Text, nullable=False, server_default=""),
    Column("side", String(8)),
    Column("external_id", Text, nullable=False, server_default=""),
    Column("note", Text, nullable=False, server_default=""),
    Column("duplicate_of", String(32)),
    Column("version", Integer, nullable=False, server_default="1"),
    Column("start", String(40)),
    Column("inspection", Text),
    Column("diary", Text, nullable=False, server_default="[]"),
    Column("trashed_s", Float),
    Index("recordings_by_age", "state", "created_at", "id"),
    Index("recordings_by_subject", "subject", "created_at", "id"),
    Index("recordings_by_external_id", "external_id", "created_at", "id"),
    Index("recordings_by_start", "start"),
)

analyses = Table(
    "analyses",
    metadata,
    Column("id", String(32), primary_key=True),
    Column("recording_id", ForeignKey("recordings.id"), nullable=False, index=True),
    Column("request", Text, nullable=False),
    Column("way_in", String(8), nullable=False),
    Column("state", String(16), nullable=False),
    Column("stage", String(16)),
    Column("progress", Float, nullable=False),
    Column("attempts", Integer, nullable=False),
    Column("token", String(32)),
    Column("beats", BigInteger, nullable=False),
    Column("claimer_place", Text),
    Column("claimer_pid", BigInteger),
    Column("claimer_started", Text),
    Column("created_at", String(32), nullable=False),
    Column("started_at", String(32)),
    Column("ended_at", String(32)),
    Column("problem_code", String(32)),
    Column("problem_facts", Text),
    Column("key", String(64)),
    Column("priority", Integer, nullable=False, server_default="1"),
    Column("turn", Integer, nullable=False, server_default="0"),
    Column("batch_id", String(32)),
    Column("replaced_by", String(32)),
    Index("analyses_in_turn", "state", "priority", "turn", "created_at", "id"),
    Index("analyses_by_age", "created_at", "id"),
    Index("analyses_by_state", "state", "created_at", "id"),
    Index("analyses_by_key", "key"),
    Index("analyses_by_flow", "batch_id", "state", "turn"),
)

uploads = Table(
    "uploads",
    metadata,
    Column("id", String(32), primary_key=True),
    Column("length_bytes", BigInteger, nullable=False),
    Column("offset_bytes", BigInteger, nullable=False),
    Column("metadata", Text, nullable=False),
    Column("description", Text, nullable=False),
    Column("idle_s", Float, nullable=False),
    Column("recording_id", String(32)),
    Column("created_at", String(32), nullable=False),
)

result_files = Table(
    "result_files",
    metadata,
    Column("analysis_id", ForeignKey("analyses.id"), primary_key=True),
    Column("name", String(64), primary_key=True),
    Column("sha256", String(64), nullable=False),
    Column("size_bytes", BigInteger, nullable=False),
)

READ_ONLY = {"acromion_read_only": True}


def open_engine(url: str) -> Engine:
    """Connect, and make the tables that are not there."""
    engine = create_engine(url)
    if engine.dialect.name == "sqlite":
        Path(str(engine.url.database)).parent.mkdir(parents=True, exist_ok=True)
        event.listen(engine, "connect", _prepare_sqlite)
        event.listen(engine, "begin", _begin_sqlite)
    metadata.create_all(engine)
    return engine


def _prepare_sqlite(connection: Any, _record: Any) -> None:
    """Make a commit durable through a power cut, and let nobody fail because another is writing.

    The time-out goes first: turning on WAL takes a lock that a peer starting up at once may hold.
    """
    connection.isolation_level = None  # transactions are begun by us, below
    cursor = connection.cursor()
    settings = ("journal_mode=WAL", "synchronous=FULL", "foreign_keys=ON", "secure_delete=ON")
    for pragma in ("busy_timeout=30000", *settings):
        cursor.execute(f"PRAGMA {pragma}")
    cursor.close()


def _begin_sqlite(connection: Connection) -> None:
    """Take the write lock at once, so that no transaction has to be given up half-way."""
    reads = connection.get_execution_options().get("acromion_read_only")
    connection.exec_driver_sql("BEGIN" if reads else "BEGIN IMMEDIATE")
