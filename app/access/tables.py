"""The tables of the accounts, apart from the health data."""

from sqlalchemy import Column, Float, ForeignKey, Index, Integer, LargeBinary, MetaData, String, Table, Text

REVISION = "1"

metadata = MetaData()

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

# A session is known by the SHA-256 of its cookie. Ages are kept by the clock of the server, in seconds.
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

# Failed logins by what was tried: an account (a keyed digest of what was typed), an address, or a browser
# that logged in before.
tries = Table(
    "tries",
    metadata,
    Column("key", String(80), primary_key=True),
    Column("failures", Integer, nullable=False),
    Column("blocked_until_s", Float, nullable=False),
)

# A browser in which a person logged in before; several people may share one.
known_browsers = Table(
    "known_browsers",
    metadata,
    Column("hash", String(64), primary_key=True),
    Column("person_id", ForeignKey("people.id"), primary_key=True),
    Column("used_s", Float, nullable=False),
)

# What works once and for a while: an invitation, a forgotten password, the second step of a login.
tickets = Table(
    "tickets",
    metadata,
    Column("hash", String(64), primary_key=True),
    Column("purpose", String(16), nullable=False),
    Column("person_id", ForeignKey("people.id"), index=True),
    Column("told", Text, nullable=False),
    Column("expires_s", Float, nullable=False),
)

# By which link a person's password was last set, and whether the person was told.
link_uses = Table(
    "link_uses",
    metadata,
    Column("person_id", ForeignKey("people.id"), primary_key=True),
    Column("made_by", String(80), nullable=False),
    Column("used_at", String(32), nullable=False),
    Column("address", String(60), nullable=False),
    Column("told_at", String(32)),
)

# What was done about accounts, until its line stands in the trail.
acts = Table(
    "acts",
    metadata,
    Column("id", Integer, primary_key=True),
    Column("at", String(32), nullable=False),
    Column("who", String(80), nullable=False),
    Column("act", String(40), nullable=False),
    Column("other", Text, nullable=False),
)

facts = Table(
    "facts",
    metadata,
    Column("name", String(32), primary_key=True),
    Column("value", Text, nullable=False),
)
