"""The account store: people, their sessions and tokens."""

import hashlib
import json
import os
import secrets
import threading
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from sqlalchemy import (
    ColumnElement,
    Connection,
    Engine,
    Row,
    Select,
    delete,
    func,
    insert,
    inspect,
    select,
    update,
)
from sqlalchemy.exc import IntegrityError

from acromion.app.accounts.subjects import PERMISSIONS, ROLES, Permission, Role, Subject, collect_permissions
from acromion.app.errors import AccountsLost, BadParameter, NotHere, NotPermitted
from acromion.app.library.audit_log import NOBODY, Act, record
from acromion.app.library.database.connect import (
    READ_ONLY,
    connect,
    find_database_file,
    lock_tables,
    open_database,
)
from acromion.app.library.database.tables import known_browsers, people, sessions, tickets, tokens
from acromion.app.library.rows import format_now
from acromion.app.settings import Settings
from acromion.app.store.folder import sync_folder
from acromion.app.store.permissions import create_file, make_folder
from acromion.app.store.server_secret import ServerSecret


def hash_secret(secret: str) -> str:
    """Return the digest of a long random secret, as stored; such a secret needs no salt."""
    return hashlib.sha256(secret.encode()).hexdigest()


_LOCK = 0x61636374  # arbitrary number of the advisory lock for writing accounts


class AccountDatabase:
    """Reads and writes accounts; uses the server's ``engine`` or opens the database at first use."""

    def __init__(self, settings: Settings, engine: Engine | None = None) -> None:
        self._url, self._engine, self._is_lent = settings.database_url, engine, engine is not None
        self._turn = threading.Lock()

    @contextmanager
    def write(self) -> Iterator[Connection]:
        """Open a transaction with the lock for writing accounts: nobody else changes the rows it reads."""
        with self._open().begin() as connection:  # SQLite locks the database here
            lock_tables(connection, _LOCK)
            yield connection

    def has_people(self) -> bool:
        """Return whether an account exists, without creating a file or a table."""
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
        """Close the database, unless it belongs to a server."""
        with self._turn:
            if self._engine is not None and not self._is_lent:
                self._engine.dispose()
                self._engine = None

    def _open(self) -> Engine:
        with self._turn:
            if self._engine is None:
                self._engine = open_database(self._url)
            return self._engine


IDLE_S = 30 * 60.0
LONGEST_S = 12 * 3600.0
CLOCK_SKEW_S = 300.0
"""By how much the clocks of several servers may differ."""
CONFIRMED_S = 10 * 60.0
"""Time after a sign-in or a confirmation during which an irreversible action needs no password."""
MARKER = "has_accounts"
"""The file that marks a server with accounts, even if its database is lost."""
CHECK_PERIOD_S = 1.0
"""Minimum time between two checks for accounts."""
RECORD_PERIOD_S = 30.0
"""Minimum time between two recorded uses of a session or token."""
SESSION_BYTES = 32
TOKEN_PREFIX = "acr_"  # noqa: S105 - the prefix that secret scanners recognise
LOGIN_SIGNS = frozenset("abcdefghijklmnopqrstuvwxyz0123456789.-_+@")
LONGEST_LOGIN, LONGEST_NAME = 100, 200


@dataclass(frozen=True, slots=True)
class Person:
    """An account. ``ended_at``: when it was disabled; ``issuer``: the identity provider that manages it."""

    id: str
    login: str
    name: str
    roles: frozenset[Role]
    created_at: str
    ended_at: str | None
    issuer: str | None
    has_password: bool
    has_second_factor: bool


@dataclass(frozen=True, slots=True)
class Token:
    """A token as its owner sees it; the token itself was shown only once."""

    id: str
    name: str
    permissions: frozenset[Permission]
    created_at: str
    expires_s: float
    used_at: str | None


@dataclass(frozen=True, slots=True)
class Session:
    """A session as its owner sees it."""

    id: str
    began_s: float
    used_s: float


class AccountStore:
    """Accounts in the database."""

    def __init__(
        self, settings: Settings, clock: Callable[[], float] = time.time, engine: Engine | None = None
    ) -> None:
        self.database, self.clock = AccountDatabase(settings, engine), clock
        self._marker = settings.data_dir / MARKER
        self.secrets = ServerSecret(settings.data_dir)
        self._looked_s, self._exist = -CHECK_PERIOD_S, False
        self._ages = SessionAges()

    def exist(self) -> bool:
        """Return whether an account exists or ever existed; checked once a second until there is one."""
        now_s = time.monotonic()
        if not self._exist and now_s - self._looked_s >= CHECK_PERIOD_S:
            self._looked_s = now_s
            if self.database.has_people():
                self.mark()
            self._exist = self._marker.exists()
        return self._exist

    def mark(self) -> None:
        """Record durably in the data folder that accounts exist."""
        if not self._marker.exists():
            make_folder(self._marker.parent)
            with suppress(FileExistsError), create_file(self._marker) as file:
                os.fsync(file.fileno())
            sync_folder(self._marker.parent)

    def check_kept(self) -> None:
        """Reject a database that has lost every account, because a server without accounts lets others in.

        Raises AccountsLost.
        """
        if self._marker.exists() and not self.database.has_people():
            raise AccountsLost(file=str(self._marker))

    # People.

    def record_people_read(self) -> None:
        """Record that the list of people was read outside a request."""
        with self.database.write() as connection:
            record_act(connection, "people.read", "")

    def add_person(self, login: str, name: str, roles: Collection[Role]) -> Person:
        """Add a person, who cannot sign in before a password is set.

        Raises
        ------
        BadParameter
            The sign-in name is taken or has characters that no e-mail address has; or the name is invalid.
        """
        check_name(name)
        return self._insert_person(check_login(login), name, roles, {})

    def add_person_of(self, issuer: str, subject: str, about: Person) -> Person:
        """Add a person who signs in through a provider, identified only by issuer and subject."""
        of_issuer = {"issuer": issuer, "issuer_subject": subject}
        return self._insert_person(about.login, about.name, about.roles, of_issuer)

    def get_person(self, person_id: str) -> Person:
        """Return one person. Raises NotHere."""
        person = self._find_person(people.c.id == person_id)
        if person is None:
            raise NotHere(id=person_id)
        return person

    def find_name(self, who: str) -> str:
        """Return the name of a person, or of a token with its owner's; "" if the account is gone."""
        person, token = self.find_person_name(who), ""
        if person and who.startswith("tok_"):
            token = str(self.database.read_value(select(tokens.c.name).where(tokens.c.id == who)))
        return f"{person} ({token})" if token else person

    def find_person_name(self, who: str) -> str:
        """Return the name of a person or of a token's owner; "" if the account is gone."""
        if not self.exist():
            return ""
        person_id: Any = who
        if who.startswith("tok_"):
            person_id = select(tokens.c.person_id).where(tokens.c.id == who).scalar_subquery()
        row = self.database.read_one(select(people).where(people.c.id == person_id))
        return row.name if row is not None else ""

    def find_person(self, login: str) -> Person | None:
        """Find a person by sign-in name."""
        return self._find_person(people.c.login == normalise_login(login))

    def find_person_of(self, issuer: str, subject: str) -> Person | None:
        """Find a person by issuer and subject."""
        return self._find_person(people.c.issuer == issuer, people.c.issuer_subject == subject)

    def find_people(self) -> Sequence[Person]:
        """Return all people, active accounts first."""
        query = select(people).order_by(people.c.ended_at.is_not(None), people.c.login)
        return [_read_person(row) for row in self.database.read_all(query)]

    def set_roles(self, person_id: str, roles: Collection[Role]) -> None:
        """Set the roles of a person, valid from the next request."""
        given = json.dumps(sorted(roles))
        with self.database.write() as connection:
            others = update(people).where(people.c.id == person_id, people.c.roles != given)
            if connection.execute(others.values(roles=given)).rowcount:
                record_act(connection, "person.changed", person_id, roles="+".join(sorted(roles)))

    def set_name(self, person_id: str, name: str) -> None:
        """Set the name of a person."""
        if self.get_person(person_id).name == name:
            return
        with self.database.write() as connection:
            connection.execute(update(people).where(people.c.id == person_id).values(name=name))
            record_act(connection, "person.changed", person_id, what="name")

    def end_person(self, person_id: str) -> None:
        """Disable an account, and end all its sessions, tokens and open links at once."""
        with self.database.write() as connection:
            connection.execute(update(people).where(people.c.id == person_id).values(ended_at=format_now()))
            for table in (sessions, known_browsers, tickets):
                connection.execute(delete(table).where(table.c.person_id == person_id))
            ended = update(tokens).where(tokens.c.person_id == person_id, tokens.c.ended_at.is_(None))
            connection.execute(ended.values(ended_at=format_now()))
            record_act(connection, "person.ended", person_id)

    def resume_person(self, person_id: str) -> None:
        """Enable an account again; its sessions and tokens stay ended."""
        with self.database.write() as connection:
            connection.execute(update(people).where(people.c.id == person_id).values(ended_at=None))
            record_act(connection, "person.changed", person_id, what="resumed")

    # Sessions.

    def begin_session(self, person_id: str) -> str:
        """Begin a session and return the value of its cookie; only the digest is stored."""
        cookie, now_s = secrets.token_urlsafe(SESSION_BYTES), self.clock()
        row = {"hash": hash_secret(cookie), "person_id": person_id, "began_s": now_s, "used_s": now_s}
        with self.database.write() as connection:
            connection.execute(delete(sessions).where(sessions.c.began_s <= now_s - LONGEST_S))
            connection.execute(insert(sessions).values(row | {"confirmed_s": now_s}))
            record_act(connection, "login.succeeded", person_id, who=person_id)
        return cookie

    def end_session(self, cookie: str) -> None:
        """End a session."""
        self._end_sessions(sessions.c.hash == hash_secret(cookie))

    def end_session_of(self, person_id: str, session: str) -> None:
        """End a session of a person by its id; ignore an id of another person or of an ended session."""
        self._end_sessions(sessions.c.person_id == person_id, sessions.c.hash == session)

    def end_sessions(self, person_id: str, but: str = "") -> None:
        """End every session of a person except the one with this id."""
        self._end_sessions(sessions.c.person_id == person_id, sessions.c.hash != but)

    def find_sessions(self, person_id: str) -> Sequence[Session]:
        """Return the active sessions of a person, newest first."""
        about = select(sessions).where(sessions.c.person_id == person_id, *_is_active(self.clock()))
        rows = self.database.read_all(about.order_by(sessions.c.began_s.desc()))
        return [Session(row.hash, row.began_s, row.used_s) for row in rows]

    def confirm_session(self, session: str) -> str:
        """Record that the person has just confirmed the password; return the new cookie.

        The previous cookie stops working. The session does not last longer.
        """
        cookie = secrets.token_urlsafe(SESSION_BYTES)
        with self.database.write() as connection:
            confirmed = update(sessions).where(sessions.c.hash == session)
            connection.execute(confirmed.values(hash=hash_secret(cookie), confirmed_s=self.clock()))
        return cookie

    def is_confirmed(self, subject: Subject) -> bool:
        """Return whether the person of a session confirmed the password recently."""
        query = select(sessions.c.confirmed_s).where(sessions.c.hash == subject.session)
        confirmed_s = self.database.read_value(query)
        return confirmed_s is not None and -CLOCK_SKEW_S < self.clock() - confirmed_s < CONFIRMED_S

    def find_by_session(self, cookie: str, *, is_use: bool = True) -> Subject | None:
        """Find the subject of an active session; record its use if ``is_use``."""
        digest, now_s = hash_secret(cookie), self.clock()
        row = self.database.read_one(_select_sessions(now_s).where(sessions.c.hash == digest))
        if row is None or self._ages.is_over(digest, now_s - row.began_s):
            return None
        if is_use and abs(now_s - row.used_s) >= RECORD_PERIOD_S:
            with self.database.write() as connection:
                connection.execute(update(sessions).where(sessions.c.hash == digest).values(used_s=now_s))
        permissions = collect_permissions(_read_roles(row.roles))
        return Subject("person", row.id, row.name, permissions, digest)

    # Tokens.

    def add_token(
        self, person_id: str, name: str, permissions: Collection[Permission], expires_s: float
    ) -> str:
        """Add a token with at most the owner's permissions; return it, to be shown once."""
        bearer = TOKEN_PREFIX + secrets.token_urlsafe(SESSION_BYTES)
        row = {
            "id": f"tok_{secrets.token_hex(8)}",
            "hash": hash_secret(bearer),
            "person_id": person_id,
            "name": name,
            "permissions": json.dumps(sorted(permissions)),
            "created_at": format_now(),
            "expires_s": expires_s,
        }
        with self.database.write() as connection:
            connection.execute(insert(tokens).values(row))
            may = "+".join(sorted(permissions))
            record_act(connection, "token.added", person_id, token=str(row["id"]), permissions=may)
        return bearer

    def find_tokens(self, person_id: str) -> Sequence[Token]:
        """Return the valid tokens of a person, newest first."""
        holds = (tokens.c.ended_at.is_(None), tokens.c.expires_s > self.clock())
        mine = select(tokens).where(tokens.c.person_id == person_id, *holds)
        rows = self.database.read_all(mine.order_by(tokens.c.created_at.desc(), tokens.c.id))
        return [_read_token(row) for row in rows]

    def get_token(self, bearer: str) -> Token:
        """Return one token. Raises NotHere."""
        row = self.database.read_one(select(tokens).where(tokens.c.hash == hash_secret(bearer)))
        if row is None:
            raise NotHere
        return _read_token(row)

    def end_token(self, person_id: str, token_id: str) -> None:
        """Revoke a token of a person. Raises NotHere."""
        with self.database.write() as connection:
            mine = (tokens.c.id == token_id, tokens.c.person_id == person_id, tokens.c.ended_at.is_(None))
            ended = connection.execute(update(tokens).where(*mine).values(ended_at=format_now()))
            if ended.rowcount:
                record_act(connection, "token.ended", person_id, token=token_id)
        if not ended.rowcount:
            raise NotHere(id=token_id)

    def find_by_token(self, bearer: str) -> Subject | None:
        """Return the token's subject if it is neither revoked nor expired and its owner may sign in."""
        digest = hash_secret(bearer)
        row = self.database.read_one(_select_tokens(self.clock()).where(tokens.c.hash == digest))
        if row is None:
            return None
        now_s = self.clock()
        if row.used_at is None or now_s - datetime.fromisoformat(row.used_at).timestamp() >= RECORD_PERIOD_S:
            used = datetime.fromtimestamp(now_s, UTC).isoformat(timespec="seconds")
            with self.database.write() as connection:
                connection.execute(update(tokens).where(tokens.c.hash == digest).values(used_at=used))
        held = collect_permissions(_read_roles(row.roles))
        granted: frozenset[Permission] = frozenset({"own", *json.loads(row.permissions)})
        return Subject("token", row.token_id, row.token_name, held & granted, row.token_id)

    def is_alive(self, subject: Subject) -> bool:
        """Return whether the subject's session or token is still valid, without recording a use."""
        if subject.kind == "token":
            query: Select[Any] = _select_tokens(self.clock()).where(tokens.c.id == subject.session)
        else:
            now_s = self.clock()
            query = _select_sessions(now_s).where(sessions.c.hash == subject.session)
            row = self.database.read_one(query)
            return row is not None and not self._ages.is_over(subject.session, now_s - row.began_s)
        return self.database.read_one(query) is not None

    def _insert_person(self, login: str, name: str, roles: Collection[Role], more: dict[str, str]) -> Person:
        row = {"id": f"per_{secrets.token_hex(8)}", "login": login} | more
        row |= {"name": name, "roles": json.dumps(sorted(roles))}
        row["created_at"] = format_now()
        try:
            with self.database.write() as connection:
                connection.execute(insert(people).values(row))
                record_act(connection, "person.added", row["id"], roles="+".join(sorted(roles)))
        except IntegrityError:
            raise BadParameter(name="login", value=login, allowed="a free one") from None
        self.mark()
        self._exist = True
        return self.get_person(row["id"])

    def _find_person(self, *is_it: ColumnElement[bool]) -> Person | None:
        row = self.database.read_one(select(people).where(*is_it))
        return _read_person(row) if row is not None else None

    def _end_sessions(self, *which: ColumnElement[bool]) -> None:
        with self.database.write() as connection:
            for (person_id,) in connection.execute(select(sessions.c.person_id).where(*which)).all():
                record_act(connection, "login.ended", person_id)
            connection.execute(delete(sessions).where(*which))

    def record_refused_sign_in(self, person_id: str) -> None:
        """Record a refused sign-in; ``person_id``: the person of the given name, "" if unknown."""
        with self.database.write() as connection:
            record_act(connection, "login.failed", person_id, who=NOBODY)


def record_act(
    connection: Connection, act: Act, person_id: str, *, who: str | None = None, **codes: str
) -> None:
    """Record an act within its transaction; ``person_id`` is "" if it concerns no person."""
    record(connection, act, other={"person": person_id} | codes if person_id else codes, who=who)


def normalise_login(login: str) -> str:
    """Return a sign-in name as it is stored."""
    return login.strip().lower()


def check_name(name: str) -> None:
    """Check the name of a person or a token.

    Raises
    ------
    BadParameter
        It is empty, too long or not printable.
    """
    if not name.strip() or len(name) > LONGEST_NAME or not name.isprintable():
        shown = name[:60].encode("ascii", "backslashreplace").decode()
        raise BadParameter(name="name", value=shown, allowed=f"1 … {LONGEST_NAME}")


def check_login(login: str) -> str:
    """Check a new sign-in name and return it as it is stored. Raises BadParameter."""
    name = normalise_login(login)
    if not name or len(name) > LONGEST_LOGIN or not set(name) <= LOGIN_SIGNS:
        raise BadParameter(name="login", value=login[:LONGEST_LOGIN], allowed="a-z 0-9 . - _ + @")
    return name


class SessionAges:
    """The ages of sessions by a clock that never jumps, since this process first saw each.

    A wall clock that is set back makes a session young again; the age kept here does not shrink.
    """

    def __init__(self, now_s: Callable[[], float] = time.monotonic) -> None:
        self._now_s = now_s
        self._began_s: dict[str, float] = {}
        self._turn = threading.Lock()

    def is_over(self, session: str, age_s: float) -> bool:
        """Return whether a session of this age by the wall clock has lasted :data:`LONGEST_S`."""
        with self._turn:
            now_s = self._now_s()
            if session not in self._began_s:
                self._began_s = {one: s for one, s in self._began_s.items() if now_s - s < 2 * LONGEST_S}
            began_s = min(self._began_s.get(session, now_s - age_s), now_s - age_s)
            self._began_s[session] = began_s
            return now_s - began_s >= LONGEST_S


def _is_active(now_s: float) -> tuple[Any, ...]:
    """Select active sessions; a session that was used in the future has an unknown age and has ended."""
    is_known = sessions.c.used_s <= now_s + CLOCK_SKEW_S
    return (sessions.c.used_s > now_s - IDLE_S, sessions.c.began_s > now_s - LONGEST_S, is_known)


def _select_sessions(now_s: float) -> Select[Any]:
    """Select the active sessions with their people."""
    asked = (sessions.c.used_s, sessions.c.began_s)
    joined = select(people, *asked).join(sessions, sessions.c.person_id == people.c.id)
    return joined.where(*_is_active(now_s), people.c.ended_at.is_(None))


def _select_tokens(now_s: float) -> Select[Any]:
    named = (tokens.c.id.label("token_id"), tokens.c.name.label("token_name"), tokens.c.permissions)
    joined = select(people.c.roles, *named, tokens.c.used_at).join(people, tokens.c.person_id == people.c.id)
    return joined.where(tokens.c.ended_at.is_(None), tokens.c.expires_s > now_s, people.c.ended_at.is_(None))


def _read_roles(text: str) -> frozenset[Role]:
    return frozenset(role for role in ROLES if role in json.loads(text))


def _read_person(row: Row[Any]) -> Person:
    about = (row.id, row.login, row.name, _read_roles(row.roles))
    ways = (row.issuer, row.password_hash is not None, row.totp_secret is not None)
    return Person(*about, row.created_at, row.ended_at, *ways)


def _read_token(row: Row[Any]) -> Token:
    permissions: frozenset[Permission] = frozenset(json.loads(row.permissions))
    return Token(row.id, row.name, permissions, row.created_at, row.expires_s, row.used_at)


# Personal tokens.


DAYS, MOST_DAYS = 90, 365
DAY_S = 24 * 3600.0


def make_token(
    accounts: AccountStore, person: Subject, name: str, permissions: Collection[Permission], days: int
) -> tuple[Token, str]:
    """Create a personal token; return it and the secret that is shown once.

    Raises
    ------
    BadParameter, NotPermitted
        The person lacks one of the ``permissions``.
    """
    if not 1 <= days <= MOST_DAYS:
        raise BadParameter(name="days", value=days, allowed=f"1 … {MOST_DAYS}")
    check_name(name)
    if not permissions:
        raise BadParameter(name="permissions", value="", allowed=", ".join(PERMISSIONS))
    for permission in permissions:
        if not person.may(permission):
            raise NotPermitted(permission=permission)
    bearer = accounts.add_token(person.id, name.strip(), permissions, accounts.clock() + days * DAY_S)
    return accounts.get_token(bearer), bearer


def format_end(token: Token) -> str:
    """Format the end of a token (ISO 8601, UTC)."""
    return datetime.fromtimestamp(token.expires_s, UTC).isoformat(timespec="seconds")
