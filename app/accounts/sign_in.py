"""Sign-in with a password and a second factor, and confirmation of an active session.

A session begins only after every step. A wrong name, a wrong password and a disabled account get the same
refusal, and each costs one hash.
"""

import hmac
import json
import logging
import re
import secrets
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from ipaddress import ip_address, ip_network
from math import ceil
from types import ModuleType
from typing import Any, Literal

from sqlalchemy import ColumnElement, Connection, delete, func, insert, or_, select, update

from acromion.app.accounts.accounts import (
    AccountDatabase,
    AccountStore,
    Person,
    hash_secret,
    normalise_login,
    record_act,
)
from acromion.app.accounts.subjects import Subject
from acromion.app.errors import LoginRefused, SecondFactorLost, SecretUnreadable, TicketSpent, TooManyTries
from acromion.app.library.audit_log import NOBODY, get_actor
from acromion.app.library.database.tables import (
    known_browsers,
    link_uses,
    people,
    recovery_codes,
    tickets,
    tries,
)
from acromion.app.library.rows import format_now
from acromion.app.settings import Settings
from acromion.app.store.folder import load_extra

# Stored credentials.


UNOPENED = "?"
"""Replaces an authenticator's secret that cannot be decrypted: no code is right, but recovery codes work."""
BROWSER_BYTES = 32
MOST_STEPS_AHEAD = 2
"""Steps by which an earlier code may be ahead of a later one: phones may be one step fast or slow."""
BROWSER_TERM_S = 400 * 24 * 3600
"""Maximum lifetime of a cookie in browsers."""

logger = logging.getLogger(__name__)


def name_second_factor(person_id: str) -> str:
    """Return the context of an authenticator's encrypted secret, which ties it to the person."""
    return f"second factor of {person_id}"


@dataclass(frozen=True, slots=True)
class LinkUse:
    """A password was set by a link: ``made_by`` (an id, or ``machine``) made it, ``address`` used it.

    ``is_told``: the person has been informed.
    """

    made_by: str
    address: str
    used_at: str = ""
    is_told: bool = False


@dataclass(frozen=True, slots=True)
class Credentials:
    """The stored credentials of one person.

    ``second_factor``: an authenticator's secret, "" for none, :data:`UNOPENED` if its key is lost.
    """

    person_id: str
    password_hash: str | None
    second_factor: str


class CredentialStore:
    """Credentials in the database."""

    def __init__(self, accounts: AccountStore) -> None:
        self._database, self._clock, self._secrets = accounts.database, accounts.clock, accounts.secrets

    def find(self, login: str) -> Credentials | None:
        """Find a person's credentials by sign-in name; None if no active account has this name."""
        return self._find(people.c.login == normalise_login(login))

    def find_of(self, person_id: str) -> Credentials | None:
        """Find a person's credentials by id."""
        return self._find(people.c.id == person_id)

    def set_password(self, person_id: str, password_hash: str, *, is_new: bool = True) -> None:
        """Store the hash of a password; ``is_new``: the password has changed, not only its hash."""
        with self._database.write() as connection:
            mine = update(people).where(people.c.id == person_id)
            connection.execute(mine.values(password_hash=password_hash))
            if is_new:
                record_act(connection, "password.changed", person_id)

    def set_password_by_link(self, person: Person, password_hash: str, use: LinkUse) -> None:
        """Store the hash of a password that was set through a link, and record the link's use."""
        # an invited person need not be informed of the first password
        told_at = None if person.has_password else format_now()
        row = {"made_by": use.made_by, "address": use.address, "used_at": format_now(), "told_at": told_at}
        with self._database.write() as connection:
            mine = update(people).where(people.c.id == person.id)
            connection.execute(mine.values(password_hash=password_hash))
            connection.execute(delete(link_uses).where(link_uses.c.person_id == person.id))
            connection.execute(insert(link_uses).values(row | {"person_id": person.id}))
            by = {"by": "link", "made_by": use.made_by, "address": use.address}
            record_act(connection, "password.changed", person.id, **by)

    def find_link_use(self, person_id: str) -> LinkUse | None:
        """Find the link through which a person's password was last set; None if it was set otherwise."""
        row = self._database.read_one(select(link_uses).where(link_uses.c.person_id == person_id))
        return LinkUse(row.made_by, row.address, row.used_at, row.told_at is not None) if row else None

    def mark_link_use_shown(self, person_id: str) -> None:
        """Record that a person has been informed of the link."""
        with self._database.write() as connection:
            mine = update(link_uses).where(link_uses.c.person_id == person_id)
            connection.execute(mine.values(told_at=format_now()))

    def set_second_factor(self, person_id: str, secret: str, step: int, codes: Collection[str]) -> None:
        """Replace an authenticator and its recovery codes; an empty secret turns it off."""
        sealed = self._secrets.encrypt(secret, name_second_factor(person_id)).encode() if secret else None
        values = {"totp_secret": sealed, "totp_step": step}
        with self._database.write() as connection:
            connection.execute(update(people).where(people.c.id == person_id).values(values))
            connection.execute(delete(recovery_codes).where(recovery_codes.c.person_id == person_id))
            rows = [{"person_id": person_id, "hash": hash_secret(code)} for code in codes]
            if rows:
                connection.execute(insert(recovery_codes), rows)
            record_act(connection, "second_factor.changed", person_id, what="on" if secret else "off")

    def use_step(self, person_id: str, step: int) -> bool:
        """Use up the step of a code; return False if it, or a later one, was used.

        A last step in the future was used while the clock was ahead: it does not block the codes of today.
        """
        with self._database.write() as connection:
            is_unused = or_(people.c.totp_step < step, people.c.totp_step > step + MOST_STEPS_AHEAD)
            mine = update(people).where(people.c.id == person_id, is_unused)
            used = connection.execute(mine.values(totp_step=step))
        return used.rowcount == 1

    def use_recovery_code(self, person_id: str, code: str) -> bool:
        """Use up a recovery code; return False if it does not exist."""
        with self._database.write() as connection:
            mine = (recovery_codes.c.person_id == person_id, recovery_codes.c.hash == hash_secret(code))
            used = connection.execute(delete(recovery_codes).where(*mine))
        return used.rowcount == 1

    def count_recovery_codes(self, person_id: str) -> int:
        """Return the number of unused recovery codes."""
        mine = recovery_codes.c.person_id == person_id
        return int(self._database.read_value(select(func.count()).select_from(recovery_codes).where(mine)))

    def knows_browser(self, browser: str, person_id: str) -> bool:
        """Return whether a person has signed in with this browser before."""
        is_it = (known_browsers.c.hash == hash_secret(browser), known_browsers.c.person_id == person_id)
        recent = known_browsers.c.used_s > self._clock() - BROWSER_TERM_S
        return self._database.read_one(select(known_browsers).where(*is_it, recent)) is not None

    def remember_browser(self, browser: str, person_id: str) -> str:
        """Record a sign-in with a browser; return the browser's new name, as the old one may be known."""
        name, before, now_s = secrets.token_urlsafe(BROWSER_BYTES), hash_secret(browser), self._clock()
        with self._database.write() as connection:
            old = known_browsers.c.used_s <= now_s - BROWSER_TERM_S
            mine = (known_browsers.c.hash == before, known_browsers.c.person_id == person_id)
            connection.execute(delete(known_browsers).where(old))
            connection.execute(delete(known_browsers).where(*mine))
            others = update(known_browsers).where(known_browsers.c.hash == before)
            connection.execute(others.values(hash=hash_secret(name)))
            row = {"hash": hash_secret(name), "person_id": person_id, "used_s": now_s}
            connection.execute(insert(known_browsers).values(row))
        return name

    def _find(self, is_it: ColumnElement[bool]) -> Credentials | None:
        row = self._database.read_one(select(people).where(is_it, people.c.ended_at.is_(None)))
        if row is None:
            return None
        try:
            kept = row.totp_secret
            secret = self._secrets.decrypt(kept.decode(), name_second_factor(row.id)) if kept else ""
        except SecretUnreadable:
            secret = UNOPENED
            logger.error(
                "the second factor of %s cannot be read: restore server.key, or run "
                "acromion account reset LOGIN --second-factor",
                row.id,
            )
        return Credentials(row.id, row.password_hash, secret)


# Delays after failed sign-ins.


FORGET_S = 3600.0
"""Time after the last failed attempt until all attempts are forgotten."""
LOG_PERIOD_S = 15 * 60.0
"""Time during which further delayed attempts add no line to the audit log."""


@dataclass(frozen=True, slots=True)
class Budget:
    """A counter of attempts: the first ``free`` cost no time, then 1, 2, 4 … s up to ``longest_s``.

    ``most_each``: only this many attempts of one source count; the first budget of an attempt counts its
    source.
    """

    key: str
    free: int
    longest_s: float
    most_each: int | None = None

    def find_delay_s(self, failures: int) -> float:
        """Return the delay before the next attempt in s."""
        return min(self.longest_s, 2.0 ** (failures - self.free)) if failures >= self.free else 0.0


class Throttle:
    """Counts attempts in the database.

    An attempt is counted before it is checked, so that simultaneous attempts gain nothing. A right password
    takes back its attempt. A stranger's attempts delay the account and the stranger's address, but never a
    known browser. Delayed attempts add a line to the audit log, once per account, address or browser in 15
    minutes.
    """

    def __init__(self, database: AccountDatabase, clock: Callable[[], float] = time.time) -> None:
        self._database, self._clock = database, clock

    def take(self, budgets: Collection[Budget], person_id: str = "") -> None:
        """Count an attempt, or refuse it before anything is computed; ``person_id``: its person, if known.

        Raises TooManyTries.
        """
        now_s = self._clock()
        with self._database.write() as connection:
            connection.execute(delete(tries).where(tries.c.blocked_until_s < now_s - FORGET_S))
            counts = [_read_limited_tries(connection, budget, now_s) for budget in budgets]
            wait_s = max(until_s for _, until_s in counts) - now_s
            for budget, (failures, until_s) in zip(budgets, counts, strict=True):
                if wait_s <= 0:
                    if budget.most_each is not None and counts[0][0] >= budget.most_each:
                        continue
                    delay_s = budget.find_delay_s(failures + 1)
                    _write_tries(connection, budget.key, failures + 1, now_s + delay_s)
                elif until_s > now_s:
                    _write_tries(connection, budget.key, failures, until_s)
                    _record_throttled(connection, budget.key, person_id, now_s)
        if wait_s > 0:
            raise TooManyTries(wait_s=ceil(wait_s))

    def refund(self, budgets: Collection[Budget]) -> None:
        """Take back a successful attempt; earlier failed ones stay counted."""
        with self._database.write() as connection:
            for budget in budgets:
                failures, _ = _read_tries(connection, budget.key)
                _write_tries(connection, budget.key, max(failures - 1, 0), self._clock())

    def clear(self, budgets: Collection[Budget]) -> None:
        """Clear all attempts after a sign-in, but take back only one attempt of the address.

        Otherwise a person could clear an address by signing in to another account.
        """
        self.refund([budget for budget in budgets if budget.key.startswith("address:")])
        own = [budget.key for budget in budgets if not budget.key.startswith("address:")]
        with self._database.write() as connection:
            connection.execute(delete(tries).where(tries.c.key.in_(own)))


def limit_code(person_id: str) -> Budget:
    """Return the counter for a person's second factor; the right password does not clear it."""
    return Budget(f"code:{person_id}", 5, 300.0)


def limit_address(address: str) -> Budget:
    """Return the counter for one address, or for one IPv6 network, which a household shares."""
    return Budget(f"address:{find_network(address)}", 10, 900.0)


def find_network(address: str) -> str:
    """Return the key for counting attempts of an address: itself, or its network for IPv6."""
    try:
        known = ip_address(address)
    except ValueError:
        return address[:40]
    return str(known) if known.version == 4 else str(ip_network((known, 64), strict=False))


def _read_tries(connection: Connection, key: str) -> tuple[int, float]:
    row = connection.execute(select(tries).where(tries.c.key == key)).one_or_none()
    return (row.failures, row.blocked_until_s) if row is not None else (0, 0.0)


def _read_limited_tries(connection: Connection, budget: Budget, now_s: float) -> tuple[int, float]:
    """Return the failed attempts and the end of their delay; a clock that was ahead does not prolong it."""
    failures, until_s = _read_tries(connection, budget.key)
    return failures, min(until_s, now_s + budget.find_delay_s(failures))


def _write_tries(connection: Connection, key: str, failures: int, until_s: float) -> None:
    values = {"failures": failures, "blocked_until_s": until_s}
    changed = connection.execute(update(tries).where(tries.c.key == key).values(values))
    if not changed.rowcount:
        connection.execute(insert(tries).values(key=key, **values))


def _record_throttled(connection: Connection, key: str, person_id: str, now_s: float) -> None:
    """Record that attempts had to wait, unless that was recorded recently.

    An entry about an address names no person.
    """
    kind, told = key.partition(":")[0], f"told:{key}"
    if not now_s < _read_tries(connection, told)[1] <= now_s + LOG_PERIOD_S:
        _write_tries(connection, told, 0, now_s + LOG_PERIOD_S)
        record_act(connection, "login.throttled", "" if kind == "address" else person_id, by=kind)


# Single-use tickets.


Purpose = Literal["password", "code", "enrol", "provider"]
"""``password``: set one; ``code``, ``enrol``: enter or set up the second factor; ``provider``: return."""

TICKET_BYTES = 32


@dataclass(frozen=True, slots=True)
class Ticket:
    """Content of a ticket: its person ("" if not known yet) and the stored data."""

    person_id: str
    data: Mapping[str, Any]


class TicketStore:
    """Tickets in the database; only their digests are stored."""

    def __init__(self, database: AccountDatabase, clock: Callable[[], float] = time.time) -> None:
        self._database, self._clock = database, clock

    def make(self, purpose: Purpose, term_s: float, person_id: str = "", **data: Any) -> str:
        """Create and return a ticket. A new "password" ticket replaces the person's earlier one."""
        ticket = secrets.token_urlsafe(TICKET_BYTES)
        row = {
            "hash": hash_secret(ticket),
            "purpose": purpose,
            "person_id": person_id or None,
            "told": json.dumps(data),
            "expires_s": self._clock() + term_s,
        }
        with self._database.write() as connection:
            connection.execute(delete(tickets).where(tickets.c.expires_s <= self._clock()))
            if purpose == "password":
                earlier = (tickets.c.person_id == person_id, tickets.c.purpose == purpose)
                connection.execute(delete(tickets).where(*earlier))
                record_act(connection, "link.made", person_id)
            connection.execute(insert(tickets).values(row))
        return ticket

    def peek(self, purpose: Purpose, ticket: str) -> Ticket:
        """Return the content of a ticket without using it up. Raises TicketSpent."""
        return _read_ticket(self._database.read_one(select(tickets).where(*self._find(purpose, ticket))))

    def take(self, purpose: Purpose, ticket: str) -> Ticket:
        """Use up a ticket; of two simultaneous attempts one succeeds. Raises TicketSpent."""
        with self._database.write() as connection:
            found = self._find(purpose, ticket)
            row = connection.execute(select(tickets).where(*found)).one_or_none()
            connection.execute(delete(tickets).where(*found))
        return _read_ticket(row)

    def _find(self, purpose: Purpose, ticket: str) -> tuple[Any, ...]:
        is_it = (tickets.c.hash == hash_secret(ticket), tickets.c.purpose == purpose)
        return (*is_it, tickets.c.expires_s > self._clock())


def _read_ticket(row: Any | None) -> Ticket:
    if row is None:
        raise TicketSpent
    return Ticket(row.person_id or "", json.loads(row.told))


EXTRA = "trust"
STEP_TERM_S = 10 * 60.0
"""Maximum time between two steps of a sign-in."""
INVITED_S = 7 * 24 * 3600.0
FORGOTTEN_S = 3600.0
STEP_DIGITS = 6
LONGEST_ADDRESS = 45
_ADDRESS = re.compile(r"[^0-9A-Za-z.:]")


@dataclass(frozen=True, slots=True)
class Caller:
    """Origin of an attempt: an address, and the name of the browser ("" for a new one)."""

    address: str
    browser: str


@dataclass(frozen=True, slots=True)
class Step:
    """The next step after a password: ``in`` for ``person_id``, or ``code`` or ``enrol`` with ``ticket``."""

    next: Literal["in", "code", "enrol"]
    person_id: str
    ticket: str = ""


@dataclass(frozen=True, slots=True)
class SignedIn:
    """A completed sign-in: the values of both cookies.

    ``must_show_link_use``: the password was set through a link since; the page must inform the person.
    """

    session: str
    browser: str
    must_show_link_use: bool = False


class SignIn:
    """Sign-in with passwords, codes and links; needs the extra ``trust``."""

    def __init__(self, accounts: AccountStore, settings: Settings) -> None:
        self.accounts, self.credentials = accounts, CredentialStore(accounts)
        self.tickets = TicketStore(accounts.database, accounts.clock)
        self.throttle = Throttle(accounts.database, accounts.clock)
        self._must_enrol = settings.second_factor == "required"

    # Sign-in.

    def submit_password(self, login: str, password: str, caller: Caller) -> Step:
        """Check the password. Raises LoginRefused, TooManyTries or NotInstalled."""
        found = self.credentials.find(login)
        budgets = self._take(found, caller, *self._limit_login(normalise_login(login), caller.address))
        kept = found.password_hash if found is not None else None
        if not self._passwords.verify_password(kept, password) or found is None:
            logger.warning("sign-in refused: name or password")
            self.accounts.record_refused_sign_in(found.person_id if found is not None else "")
            raise LoginRefused
        if kept is not None and self._passwords.needs_rehash(kept):
            hashed = self._passwords.hash_password(password)
            self.credentials.set_password(found.person_id, hashed, is_new=False)
        if found.second_factor:
            self.throttle.refund(budgets)
            return Step("code", found.person_id, self.tickets.make("code", STEP_TERM_S, found.person_id))
        self.throttle.clear(budgets)
        if self._must_enrol:
            return Step("enrol", found.person_id, self.begin_enrolment(found.person_id))
        return Step("in", found.person_id)

    def submit_code(self, ticket: str, code: str, caller: Caller) -> SignedIn:
        """Check the second step: an authenticator code or a recovery code.

        Raises LoginRefused, SecondFactorLost, TooManyTries, TicketSpent or NotInstalled.
        """
        person_id = self.tickets.peek("code", ticket).person_id
        found = self.credentials.find_of(person_id)
        budgets = self._take(found, caller, limit_code(person_id))
        self._check_second_factor(found, code, budgets)
        if found is None or not self._is_code(found, code):
            logger.warning("sign-in refused: the second factor")
            self.accounts.record_refused_sign_in(person_id)
            raise LoginRefused
        self.tickets.take("code", ticket)
        login = self.accounts.get_person(person_id).login
        self.throttle.clear((*budgets, *self._limit_login(login, caller.address)))
        return self.enter(person_id, caller)

    def enter(self, person_id: str, caller: Caller) -> SignedIn:
        """Begin a session, and remember the browser."""
        browser = self.credentials.remember_browser(caller.browser, person_id)
        use = self.credentials.find_link_use(person_id)
        is_news = use is not None and not use.is_told
        return SignedIn(self.accounts.begin_session(person_id), browser, is_news)

    def confirm(self, subject: Subject, proof: str, caller: Caller) -> str:
        """Check the password, or an authenticator code, of a signed-in person again.

        Returns the new cookie of the session. Raises LoginRefused, SecondFactorLost, TooManyTries or
        NotInstalled.
        """
        found = self.credentials.find_of(subject.id)
        budgets = self._take(found, caller, limit_code(subject.id))
        self._check_second_factor(found, proof, budgets)
        if found is None:
            is_right = False
        elif found.second_factor and _is_step(proof):
            is_right = self._is_code(found, proof)
        else:
            is_right = self._passwords.verify_password(found.password_hash, proof)
        if not is_right:
            logger.warning("confirmation refused")
            raise LoginRefused
        self.throttle.clear(budgets)
        return self.accounts.confirm_session(subject.session)

    # The second factor.

    def begin_enrolment(self, person_id: str) -> str:
        """Create an authenticator secret and return its ticket; the first right code turns it on."""
        secret = self.accounts.secrets.encrypt(self._passwords.make_secret(), name_second_factor(person_id))
        return self.tickets.make("enrol", STEP_TERM_S, person_id, secret=secret)

    def show_enrolment(self, ticket: str) -> tuple[str, str]:
        """Return the secret of an enrolment as text and as a QR code. Raises TicketSpent or NotInstalled."""
        found = self.tickets.peek("enrol", ticket)
        secret, person = self._open_secret(found), self.accounts.get_person(found.person_id)
        return secret, self._passwords.draw_secret(secret, person.login)

    def enrol(self, ticket: str, code: str) -> tuple[str, Sequence[str]]:
        """Turn on an authenticator with its first code; return the person and the recovery codes.

        Raises LoginRefused, TicketSpent or NotInstalled.
        """
        found = self.tickets.peek("enrol", ticket)
        secret = self._open_secret(found)
        step = self._passwords.find_step(secret, code, self.accounts.clock())
        if step is None:
            raise LoginRefused
        self.tickets.take("enrol", ticket)
        codes: Sequence[str] = self._passwords.make_recovery_codes()
        self.credentials.set_second_factor(found.person_id, secret, step, codes)
        return found.person_id, codes

    def _open_secret(self, ticket: Ticket) -> str:
        return self.accounts.secrets.decrypt(str(ticket.data["secret"]), name_second_factor(ticket.person_id))

    def drop_second_factor(self, person_id: str) -> None:
        """Turn off the authenticator; if it is required, the next sign-in sets up a new one."""
        self.credentials.set_second_factor(person_id, "", 0, ())

    # Passwords.

    def make_link(self, person_id: str, term_s: float) -> str:
        """Create the last part of a single-use link with which a person chooses a password."""
        return self.tickets.make("password", term_s, person_id, made_by=get_actor())

    def set_password_by_link(self, ticket: str, password: str, address: str) -> Person:
        """Set a password through a link, used from ``address``, and end every session of the person.

        The person must then sign in with it and the second factor. Raises TicketSpent, WeakPassword or
        NotInstalled.
        """
        person = self.accounts.get_person(self.tickets.peek("password", ticket).person_id)
        self.check_password(person, password)
        data = self.tickets.take("password", ticket).data
        use = LinkUse(str(data.get("made_by", NOBODY)), _ADDRESS.sub("-", address)[:LONGEST_ADDRESS])
        self.credentials.set_password_by_link(person, self._passwords.hash_password(password), use)
        self.accounts.end_sessions(person.id)
        return person

    def change_password(self, subject: Subject, proof: str, password: str, caller: Caller) -> str:
        """Change the password after checking the old one, and end the person's other sessions.

        Returns the new cookie of the session. Raises LoginRefused, TooManyTries, WeakPassword or
        NotInstalled.
        """
        person = self.accounts.get_person(subject.id)
        self.check_password(person, password)
        cookie = self.confirm(subject, proof, caller)
        self.set_password(person, password, but=hash_secret(cookie))
        return cookie

    def check_password(self, person: Person, password: str) -> None:
        """Check a new password of a person. Raises WeakPassword or NotInstalled."""
        self._passwords.check_password(password, (person.login.partition("@")[0], *person.name.split()))

    def set_password(self, person: Person, password: str, but: str = "") -> None:
        """Store a checked password, and end every session of the person except one."""
        self.credentials.set_password(person.id, self._passwords.hash_password(password))
        self.accounts.end_sessions(person.id, but)

    @property
    def _passwords(self) -> ModuleType:
        return load_extra("acromion.app.accounts.passwords", EXTRA)

    def _take(self, found: Credentials | None, caller: Caller, *of_person: Budget) -> Sequence[Budget]:
        """Count an attempt, for a known browser only against that browser. Raises TooManyTries."""
        known_as = found.person_id if found is not None else ""
        budgets: Sequence[Budget] = (*of_person, limit_address(caller.address))
        if caller.browser and self.credentials.knows_browser(caller.browser, known_as):
            budgets = (Budget(f"browser:{hash_secret(caller.browser)}", 10, 900.0),)
        self.throttle.take(budgets, known_as)
        return budgets

    def forget_tries(self, person: Person) -> None:
        """Forget the failed attempts for a person's name and second factor."""
        _, of_name = self._limit_login(person.login, "")
        self.throttle.clear((of_name, limit_code(person.id)))

    def _limit_login(self, login: str, address: str) -> tuple[Budget, Budget]:
        """Return the counters for a sign-in name, whether or not it exists: of one address, and of all.

        Only the first three attempts of an address count for all, so that one address cannot lock a person
        out. The keys are keyed digests, because people sometimes type a password in place of the name. The
        digest key comes from the server secret, so that all servers count together.
        """
        key = self.accounts.secrets.derive("logins")
        names = (f"{login}\n{find_network(address)}", login)
        of_one, of_all = (hmac.digest(key, name.encode(), "sha256").hex() for name in names)
        return Budget(f"account:{of_one}", 5, 300.0), Budget(f"account:{of_all}", 5, 300.0, most_each=3)

    def _check_second_factor(self, found: Credentials | None, code: str, budgets: Collection[Budget]) -> None:
        """Refuse an authenticator code that cannot be checked because the key is lost, and do not count it.

        Raises SecondFactorLost.
        """
        if found is not None and found.second_factor == UNOPENED and _is_step(code):
            self.throttle.refund(budgets)
            raise SecondFactorLost

    def _is_code(self, found: Credentials, code: str) -> bool:
        """Return whether a code is right, and use it up."""
        typed = code.replace(" ", "")
        if _is_step(code):
            now_s = self.accounts.clock()
            step = self._passwords.find_step(found.second_factor, typed, now_s)
            return step is not None and self.credentials.use_step(found.person_id, step)
        return self.credentials.use_recovery_code(found.person_id, self._passwords.read_recovery_code(code))


def _is_step(code: str) -> bool:
    """Return whether a code is an authenticator's, not a recovery code."""
    typed = code.replace(" ", "")
    return len(typed) == STEP_DIGITS and typed.isdecimal()
