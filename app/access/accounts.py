"""The accounts of an installation: organisations, people, their sessions and tokens.

DATA/accounts.sqlite3     made with the first account; on PostgreSQL the schema ``accounts``
"""

import hashlib
import json
import secrets
import threading
import time
from collections.abc import Callable, Collection
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from sqlalchemy import Engine, Row, Select, delete, func, insert, select, update

from app.access.subjects import ROLES, Permission, Role, Subject, collect_permissions
from app.access.tables import REVISION, facts, metadata, organisations, people, sessions, tokens
from app.errors import NotHere
from app.jobs.database.connect import READ_ONLY, connect, lock_tables, make_schema
from app.jobs.queries import format_now
from app.settings import Settings

IDLE_S = 30 * 60.0
LONGEST_S = 12 * 3600.0
LOOK_S = 1.0
"""How long the existence of accounts, and a session's use, are not looked up or written again."""
SESSION_BYTES = 32
TOKEN_PREFIX = "acr_"  # noqa: S105 - the prefix by which scanners know a token


@dataclass(frozen=True, slots=True)
class Person:
    """An account. ``ended_at``: since when it may not log in any more."""

    id: str
    organisation: str
    login: str
    name: str
    roles: frozenset[Role]
    created_at: str
    ended_at: str | None


class AccountStore:
    """Rows of accounts; there is no database before the first account is made."""

    def __init__(self, settings: Settings, clock: Callable[[], float] = time.time) -> None:
        self._url, self._file = _find_place(settings)
        self._clock = clock
        self._engine: Engine | None = None
        self._turn = threading.Lock()
        self._looked_s, self._exist = -LOOK_S, False

    def exist(self) -> bool:
        """Tell whether there is any account; looked up once a second until there is one."""
        now_s = time.monotonic()
        if not self._exist and now_s - self._looked_s >= LOOK_S:
            self._looked_s = now_s
            self._exist = self._is_there() and bool(
                self._read_value(select(func.count()).select_from(people))
            )
        return self._exist

    def add_organisation(self, organisation: str, name: str) -> None:
        """Add an organisation; one that is there stays as it is."""
        row = {"id": organisation, "name": name, "created_at": format_now()}
        with self._open().begin() as connection:
            known = select(organisations.c.id).where(organisations.c.id == organisation)
            if connection.execute(known).scalar() is None:
                connection.execute(insert(organisations).values(row))

    def add_person(self, organisation: str, login: str, name: str, roles: Collection[Role]) -> Person:
        """Add a person, who cannot log in before a way to is set."""
        row = {
            "id": f"per_{secrets.token_hex(8)}",
            "organisation": organisation,
            "login": login.strip().lower(),
            "name": name,
            "roles": json.dumps(sorted(roles)),
            "created_at": format_now(),
        }
        with self._open().begin() as connection:
            connection.execute(insert(people).values(row))
        return self.get_person(str(row["id"]))

    def get_person(self, person_id: str) -> Person:
        """Give one person.

        Raises
        ------
        NotHere
        """
        row = self._read_one(select(people).where(people.c.id == person_id))
        if row is None:
            raise NotHere(id=person_id)
        return _read_person(row)

    def find_name(self, who: str) -> str:
        """Give the name of a person, or of a token with its person's; "" where the account is gone."""
        person, token = self.find_person_name(who), ""
        if person and who.startswith("tok_"):
            token = str(self._read_value(select(tokens.c.name).where(tokens.c.id == who)))
        return f"{person} ({token})" if token else person

    def find_person_name(self, who: str) -> str:
        """Give the name of a person or of a token's person; "" where the account is gone."""
        if not self.exist():
            return ""
        person_id: Any = who
        if who.startswith("tok_"):
            person_id = select(tokens.c.person_id).where(tokens.c.id == who).scalar_subquery()
        return str(self._read_value(select(people.c.name).where(people.c.id == person_id)) or "")

    def begin_session(self, person_id: str) -> str:
        """Begin a session; gives the value of its cookie, of which only the digest is kept."""
        cookie, now_s = secrets.token_urlsafe(SESSION_BYTES), self._clock()
        row = {"hash": hash_secret(cookie), "person_id": person_id, "began_s": now_s, "used_s": now_s}
        with self._open().begin() as connection:
            connection.execute(insert(sessions).values(row | {"confirmed_s": now_s}))
        return cookie

    def end_session(self, cookie: str) -> None:
        """End a session."""
        with self._open().begin() as connection:
            connection.execute(delete(sessions).where(sessions.c.hash == hash_secret(cookie)))

    def end_person(self, person_id: str) -> None:
        """Let a person log in no more, and end every session and token at once."""
        with self._open().begin() as connection:
            connection.execute(update(people).where(people.c.id == person_id).values(ended_at=format_now()))
            connection.execute(delete(sessions).where(sessions.c.person_id == person_id))
            ended = update(tokens).where(tokens.c.person_id == person_id, tokens.c.ended_at.is_(None))
            connection.execute(ended.values(ended_at=format_now()))

    def find_by_session(self, cookie: str) -> Subject | None:
        """Give who holds a session that goes on, and count that it was used."""
        digest, now_s = hash_secret(cookie), self._clock()
        row = self._read_one(_select_sessions(now_s).where(sessions.c.hash == digest))
        if row is None:
            return None
        if now_s - row.used_s >= LOOK_S:
            with self._open().begin() as connection:
                used = update(sessions).where(sessions.c.hash == digest)
                connection.execute(used.values(used_s=now_s))
        return _read_subject(row, digest)

    def find_by_token(self, bearer: str) -> Subject | None:
        """Give the token, if it is neither revoked nor expired and its person may still log in."""
        row = self._read_one(_select_tokens(self._clock()).where(tokens.c.hash == hash_secret(bearer)))
        if row is None:
            return None
        held = collect_permissions(_read_roles(row.roles))
        granted: frozenset[Permission] = frozenset(json.loads(row.permissions))
        return Subject("token", row.token_id, row.token_name, row.organisation, held & granted, row.token_id)

    def is_alive(self, subject: Subject) -> bool:
        """Tell whether the subject's session or token still holds; counts as no use of it."""
        if subject.kind == "token":
            query: Select[Any] = _select_tokens(self._clock()).where(tokens.c.id == subject.session)
        else:
            query = _select_sessions(self._clock()).where(sessions.c.hash == subject.session)
        return self._read_one(query) is not None

    def add_token(
        self, person_id: str, name: str, permissions: Collection[Permission], expires_s: float
    ) -> str:
        """Add a token with at most its person's permissions; gives it, to be shown once."""
        bearer = TOKEN_PREFIX + secrets.token_urlsafe(SESSION_BYTES)
        row = {
            "id": f"tok_{secrets.token_hex(8)}",
            "hash": hash_secret(bearer),
            "person_id": person_id,
            "name": name,
            "permissions": json.dumps(sorted(permissions)),
            "created_at": datetime.now(UTC).isoformat(timespec="seconds"),
            "expires_s": expires_s,
        }
        with self._open().begin() as connection:
            connection.execute(insert(tokens).values(row))
        return bearer

    def _is_there(self) -> bool:
        return self._file is None or self._file.exists()

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

    def _read_all(self, query: Select[Any]) -> list[Any]:
        with self._open().execution_options(**READ_ONLY).connect() as connection:
            return list(connection.execute(query).all())

    def _read_one(self, query: Select[Any]) -> Any | None:
        with self._open().execution_options(**READ_ONLY).connect() as connection:
            return connection.execute(query).one_or_none()

    def _read_value(self, query: Select[Any]) -> Any:
        with self._open().execution_options(**READ_ONLY).connect() as connection:
            return connection.execute(query).scalar()


def hash_secret(secret: str) -> str:
    """Give the digest of a long random secret, as the rows hold it; it needs no salt."""
    return hashlib.sha256(secret.encode()).hexdigest()


def _find_place(settings: Settings) -> tuple[str, Path | None]:
    if settings.database_url.startswith("sqlite"):
        file = settings.data_dir / "accounts.sqlite3"
        return f"sqlite:///{file}", file
    url = settings.database_url
    return f"{url}{'&' if '?' in url else '?'}options=-csearch_path%3Daccounts", None


def _select_sessions(now_s: float) -> Select[Any]:
    """Select the sessions that go on, with their people."""
    joined = select(people, sessions.c.used_s).join(sessions, sessions.c.person_id == people.c.id)
    goes_on = (sessions.c.used_s > now_s - IDLE_S, sessions.c.began_s > now_s - LONGEST_S)
    return joined.where(*goes_on, people.c.ended_at.is_(None))


def _select_tokens(now_s: float) -> Select[Any]:
    named = (tokens.c.id.label("token_id"), tokens.c.name.label("token_name"), tokens.c.permissions)
    joined = select(people.c.roles, people.c.organisation, *named).join(
        people, tokens.c.person_id == people.c.id
    )
    return joined.where(tokens.c.ended_at.is_(None), tokens.c.expires_s > now_s, people.c.ended_at.is_(None))


def _read_roles(text: str) -> frozenset[Role]:
    return frozenset(role for role in ROLES if role in json.loads(text))


def _read_subject(row: Any, session: str) -> Subject:
    permissions = collect_permissions(_read_roles(row.roles))
    return Subject("person", row.id, row.name, row.organisation, permissions, session)


def _read_person(row: Row[Any]) -> Person:
    about = (row.id, row.organisation, row.login, row.name)
    return Person(*about, _read_roles(row.roles), row.created_at, row.ended_at)
