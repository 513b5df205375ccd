"""The tables of the database, in words that SQLite and PostgreSQL both understand."""

from sqlalchemy import (
    BigInteger,
    Column,
    Float,
    ForeignKey,
    Index,
    Integer,
    MetaData,
    String,
    Table,
    Text,
)

REVISION = "0001"  # of these tables; a change of them comes with a migration in app/jobs/migrations

metadata = MetaData()

# Written by Alembic, whose name it bears; not one of our tables.
schema_revision = Table("alembic_version", MetaData(), Column("version_num", String(32), primary_key=True))

recordings = Table(
    "recordings",
    metadata,
    Column("id", String(32), primary_key=True),
    Column("sha256", String(64), nullable=False, index=True),
    Column("size_bytes", BigInteger, nullable=False),
    Column("file_name", Text, nullable=False),
    Column("state", String(16), nullable=False),
    Column("created_at", String(32), nullable=False),
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
    Index("analyses_by_state", "state", "created_at"),
    Index("analyses_by_age", "created_at"),
)

result_files = Table(
    "result_files",
    metadata,
    Column("analysis_id", ForeignKey("analyses.id"), primary_key=True),
    Column("name", String(64), primary_key=True),
    Column("sha256", String(64), nullable=False),
    Column("size_bytes", BigInteger, nullable=False),
)

facts = Table(
    "facts",
    metadata,
    Column("name", String(32), primary_key=True),
    Column("value", Text, nullable=False),
)
