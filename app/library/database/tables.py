"""The tables of the database, in types that SQLite and PostgreSQL share."""

from sqlalchemy import (
    BigInteger,
    Column,
    Float,
    ForeignKey,
    Index,
    Integer,
    LargeBinary,
    MetaData,
    String,
    Table,
    Text,
)

REVISION = "b5"  # of these tables; changing them needs a migration in app/library/migrations

metadata = MetaData()

# Written by Alembic; not one of our tables.
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
    Column("subject", Text, nullable=False, server_default=""),
    Column("side", String(8)),
    Column("external_id", Text, nullable=False, server_default=""),
    Column("note", Text, nullable=False, server_default=""),
    Column("folder", Text, nullable=False, server_default=""),
    Column("job_title", Text, nullable=False, server_default=""),
    Column("isco_code", String(4), nullable=False, server_default=""),
    Column("duplicate_of", String(32)),
    Column("version", Integer, nullable=False, server_default="1"),
    Column("start", String(40)),
    Column("inspection", Text),
    Column("diary", Text, nullable=False, server_default="[]"),
    Column("tags", Text, nullable=False, server_default="[]"),
    Column("trashed_s", Float),
    Column("since_s", Float, nullable=False, server_default="0"),
    Column("stored_by", String(40), nullable=False, server_default=""),
    Column("hold", String(32)),
    Column("hold_by", String(40)),
    Column("revision", Integer, nullable=False, server_default="1"),
    Column("side_revision", Integer, nullable=False, server_default="0"),
    Index("recordings_by_age", "state", "created_at", "id"),
    Index("recordings_by_subject", "subject", "state"),
    Index("recordings_by_start", "state", "start", "id"),
    Index("recordings_by_revision", "id", "revision"),
)

analyses = Table(
    "analyses",
    metadata,
    Column("id", String(32), primary_key=True),
    Column("recording_id", ForeignKey("recordings.id"), nullable=False),
    Column("request", Text, nullable=False),
    Column("way_in", String(8), nullable=False),
    Column("state", String(16), nullable=False),
    Column("stage", String(16)),
    Column("progress", Float, nullable=False),
    Column("attempts", Integer, nullable=False),
    Column("token", String(32)),
    Column("lease_until_s", Float),  # by the clock of the database
    Column("is_lease_missed", Integer, nullable=False, server_default="0"),
    Column("created_at", String(32), nullable=False),
    Column("started_at", String(32)),
    Column("ended_at", String(32)),
    Column("problem_code", String(32)),
    Column("problem_facts", Text),
    Column("awaits", String(64)),
    Column("key", String(64)),
    Column("priority", Integer, nullable=False, server_default="1"),
    Column("turn", Integer, nullable=False, server_default="0"),
    Column("batch_id", String(32)),
    Column("replaced_by", String(32)),
    Column("put_backs", Integer, nullable=False, server_default="0"),
    Column("interruptions", Integer, nullable=False, server_default="0"),
    Column("asked_by", String(40)),
    Column("ended_s", Float),
    Column("shift", String(100), nullable=False, server_default=""),
    Index("analyses_in_turn", "state", "priority", "turn", "created_at", "id"),
    Index("analyses_by_recording", "recording_id", "created_at", "id"),
    Index("analyses_by_age", "created_at", "id"),
    Index("analyses_by_state", "state", "created_at", "id"),
    Index("analyses_by_key", "key"),
    Index("analyses_by_awaited", "awaits"),
    Index("analyses_by_flow", "batch_id", "state", "turn"),
)

batches = Table(
    "batches",
    metadata,
    Column("id", String(32), primary_key=True),
    Column("name", Text, nullable=False),
    Column("item_count", Integer, nullable=False),  # as requested; the current ones are counted
    Column("created_at", String(32), nullable=False),
    Column("duplicate_count", Integer, nullable=False, server_default="0"),
    Column("key", String(64), unique=True),
)

# The analyses of each batch, in order; an analysis may belong to several batches.
batch_items = Table(
    "batch_items",
    metadata,
    Column("batch_id", ForeignKey("batches.id"), primary_key=True),
    Column("place", Integer, primary_key=True),
    Column("analysis_id", ForeignKey("analyses.id", ondelete="CASCADE"), nullable=False, index=True),
)

# Hashes of permanently deleted uploads, kept for a day: a repeated request must not store them again.
purged_uploads = Table(
    "purged_uploads",
    metadata,
    Column("key", String(64), primary_key=True),
    Column("since_s", Float, nullable=False),
)

webhooks = Table(
    "webhooks",
    metadata,
    Column("id", String(32), primary_key=True),
    Column("url", Text, nullable=False),
    Column("events", Text, nullable=False),
    Column("secret", Text, nullable=False),
    Column("created_at", String(32), nullable=False),
)

deliveries = Table(
    "deliveries",
    metadata,
    Column("id", String(32), primary_key=True),
    Column("webhook_id", ForeignKey("webhooks.id"), nullable=False, index=True),
    Column("event", String(32), nullable=False),
    Column("body", Text, nullable=False),
    Column("tries", Integer, nullable=False),
    Column("wait_s", Float, nullable=False),
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
    Column("is_repeated", Integer, nullable=False, server_default="0"),
    Column("created_at", String(32), nullable=False),
)

# Table columns named by a person, by the identity of the header.
column_mappings = Table(
    "column_mappings",
    metadata,
    Column("header", String(64), primary_key=True),
    Column("name", Text, nullable=False),
    Column("profile", Text, nullable=False),
    Column("created_at", String(32), nullable=False),
    Column("is_confirmed", Integer, nullable=False, server_default="0"),
)

result_files = Table(
    "result_files",
    metadata,
    Column("analysis_id", ForeignKey("analyses.id"), primary_key=True),
    Column("name", String(64), primary_key=True),
    Column("sha256", String(64), nullable=False),
    Column("size_bytes", BigInteger, nullable=False),
)

answers = Table(
    "answers",
    metadata,
    Column("analysis_id", ForeignKey("analyses.id", ondelete="CASCADE"), primary_key=True),
    Column("verdict", String(16), nullable=False, index=True),
    Column("start", String(40)),
    Column("recorded_s", Float),
    Column("above_60_percent", Float),
    Column("method", String(16)),
    Column("method_version", Integer),
    Column("day", Text),
    Column("calibration_state", String(16)),
    Column("above_60_low_percent", Float),
    Column("above_60_high_percent", Float),
    Column("analysed_s", Float),
)

# A named filter and order of the list.
saved_views = Table(
    "saved_views",
    metadata,
    Column("id", String(32), primary_key=True),
    Column("name", Text, nullable=False),
    Column("query", Text, nullable=False),
    Column("created_at", String(32), nullable=False),
)

# Every act (app/library/audit_log.py). No foreign keys, so that its lines stay. ``since_s``: the running time
# of the server at that moment, which retention uses.
audit_log = Table(
    "audit_log",
    metadata,
    Column("seq", BigInteger().with_variant(Integer, "sqlite"), primary_key=True),
    Column("at", String(32), nullable=False),
    Column("who", String(80), nullable=False),
    Column("act", String(32), nullable=False),
    Column("recording_id", String(32), nullable=False),
    Column("analysis_id", String(32), nullable=False),
    Column("other", Text, nullable=False),
    Column("since_s", Float, nullable=False),
    Index("audit_log_by_recording", "recording_id", "seq"),
    Index("audit_log_by_who", "who", "seq"),
    Index("audit_log_by_age", "since_s"),
    sqlite_autoincrement=True,
)

# Total running time of the server of this database; one row.
running_time = Table(
    "running_time",
    metadata,
    Column("id", Integer, primary_key=True, autoincrement=False),
    Column("running_s", Float, nullable=False),
)

# A release of a report, or its withdrawal; the newest row of an analysis counts.
releases = Table(
    "releases",
    metadata,
    Column("id", String(32), primary_key=True),
    Column("analysis_id", ForeignKey("analyses.id", ondelete="CASCADE"), nullable=False, index=True),
    Column("who", String(40), nullable=False),
    Column("at", String(32), nullable=False),
    Column("method_version", String(16), nullable=False),
    Column("report_id", String(64), nullable=False),
    Column("is_taken_back", Integer, nullable=False, server_default="0"),
)

# Days of the server's running time for which each kind is kept; a kind without a row is kept permanently.
retention = Table(
    "retention",
    metadata,
    Column("kind", String(16), primary_key=True),
    Column("days", Integer, nullable=False),
)

# Published group figures of a study (app/library/governance.py).
aggregate_blocks = Table(
    "aggregate_blocks",
    metadata,
    Column("id", String(32), primary_key=True),
    Column("study_id", String(32), nullable=False, index=True),
    Column("published_at", String(32), nullable=False),
    Column("figures", Text, nullable=False),
)

# The recordings of the people in each block: a person counts in one block.
aggregate_members = Table(
    "aggregate_members",
    metadata,
    Column("recording_id", ForeignKey("recordings.id", ondelete="CASCADE"), primary_key=True),
    Column("block_id", ForeignKey("aggregate_blocks.id"), nullable=False, index=True),
)

# What a person typed on the page of a recording and has not sent (app/library/drafts.py).
drafts = Table(
    "drafts",
    metadata,
    Column("person", String(40), primary_key=True),
    Column("form", String(64), primary_key=True),
    Column("recording_id", ForeignKey("recordings.id", ondelete="CASCADE"), nullable=False, index=True),
    Column("text", Text, nullable=False),
    Column("at", String(32), nullable=False),
)

# Accounts and their credentials (app/accounts).
people = Table(
    "people",
    metadata,
    Column("id", String(32), primary_key=True),
    Column("login", Text, nullable=False, unique=True),
    Column("name", Text, nullable=False),
    Column("roles", Text, nullable=False),
    Column("password_hash", Text),
    Column("totp_secret", LargeBinary),
    Column("totp_step", Integer, nullable=False, server_default="0"),
    Column("issuer", Text),
    Column("issuer_subject", Text),
    Column("created_at", String(32), nullable=False),
    Column("ended_at", String(32)),
    Index("people_by_issuer", "issuer", "issuer_subject", unique=True),
)

recovery_codes = Table(
    "recovery_codes",
    metadata,
    Column("person_id", ForeignKey("people.id"), primary_key=True),
    Column("hash", String(64), primary_key=True),
)

# A session is identified by the SHA-256 of its cookie. Ages use the clock of the server, in s.
sessions = Table(
    "sessions",
    metadata,
    Column("hash", String(64), primary_key=True),
    Column("person_id", ForeignKey("people.id"), nullable=False, index=True),
    Column("began_s", Float, nullable=False),
    Column("used_s", Float, nullable=False),
    Column("confirmed_s", Float, nullable=False),
)

tokens = Table(
    "tokens",
    metadata,
    Column("id", String(32), primary_key=True),
    Column("hash", String(64), nullable=False, unique=True),
    Column("person_id", ForeignKey("people.id"), nullable=False, index=True),
    Column("name", Text, nullable=False),
    Column("permissions", Text, nullable=False),
    Column("created_at", String(32), nullable=False),
    Column("expires_s", Float, nullable=False),
    Column("used_at", String(32)),
    Column("ended_at", String(32)),
)

# Failed sign-ins by target: an account (a keyed digest of the typed name), an address, or a known browser.
tries = Table(
    "tries",
    metadata,
    Column("key", String(80), primary_key=True),
    Column("failures", Integer, nullable=False),
    Column("blocked_until_s", Float, nullable=False),
)

# A browser with which a person has signed in before; several people may share one.
known_browsers = Table(
    "known_browsers",
    metadata,
    Column("hash", String(64), primary_key=True),
    Column("person_id", ForeignKey("people.id"), primary_key=True),
    Column("used_s", Float, nullable=False),
)

# Single-use tickets with a term: an invitation, a forgotten password, the second step of a sign-in.
tickets = Table(
    "tickets",
    metadata,
    Column("hash", String(64), primary_key=True),
    Column("purpose", String(16), nullable=False),
    Column("person_id", ForeignKey("people.id"), index=True),
    Column("told", Text, nullable=False),
    Column("expires_s", Float, nullable=False),
)

# The link with which a person's password was last set, and whether the person was informed.
link_uses = Table(
    "link_uses",
    metadata,
    Column("person_id", ForeignKey("people.id"), primary_key=True),
    Column("made_by", String(80), nullable=False),
    Column("used_at", String(32), nullable=False),
    Column("address", String(60), nullable=False),
    Column("told_at", String(32)),
)

facts = Table(
    "facts", metadata, Column("name", String(32), primary_key=True), Column("value", Text, nullable=False)
)
