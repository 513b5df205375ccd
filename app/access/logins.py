"""Logging in by a password and a second factor, and proving again who one is.

A session begins only once every step is done. A wrong name, a wrong password and an ended account are refused
alike, and each costs one hash.
"""

import logging
import re
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import Literal

from app.access.accounts import AccountStore, Person
from app.access.credentials import UNOPENED, Credentials, CredentialStore, LinkUse, name_second_factor
from app.access.hashing import NameHasher, hash_secret
from app.access.subjects import Subject
from app.access.throttle import Budget, Throttle, limit_account, limit_address, limit_browser, limit_code
from app.access.tickets import Ticket, TicketStore
from app.errors import LoginRefused, SecondFactorLost
from app.jobs.audit_log import NOBODY, find_actor
from app.settings import Settings
from app.storage.open import load_extra

EXTRA = "trust"
STEP_TERM_S = 10 * 60.0
"""So long a login may stand between two steps."""
INVITED_S = 7 * 24 * 3600.0
FORGOTTEN_S = 3600.0
STEP_DIGITS = 6
LONGEST_ADDRESS = 45
_ADDRESS = re.compile(r"[^0-9A-Za-z.:]")

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Caller:
    """From where somebody tries: an address, and the name of the browser ("" for a new one)."""

    address: str
    browser: str


@dataclass(frozen=True, slots=True)
class Step:
    """What follows a right password: ``in`` (for ``person_id``), or with ``ticket`` a code, or its set-up."""

    next: Literal["in", "code", "enrol"]
    person_id: str
    ticket: str = ""


@dataclass(frozen=True, slots=True)
class Entered:
    """A login that is done: the values of both cookies, and recovery codes to be shown once.

    ``is_to_be_told``: the password was set by a link since, which the person is to be told.
    """

    session: str
    browser: str
    recovery_codes: Sequence[str] = ()
    is_to_be_told: bool = False


class Logins:
    """Passwords, codes and links of an installation; needs the extra ``trust``."""

    def __init__(self, accounts: AccountStore, settings: Settings) -> None:
        self.accounts, self.credentials = accounts, CredentialStore(accounts)
        self.tickets = TicketStore(accounts.database, accounts.clock)
        self.throttle = Throttle(accounts.database, accounts.clock)
        self._names = NameHasher(accounts.secrets)
        self._must_enrol = settings.second_factor == "required"

    # Logging in.

    def give_password(self, login: str, password: str, caller: Caller) -> Step:
        """Take the first step. Raises LoginRefused, TooManyTries or NotInstalled."""
        found = self.credentials.find(login)
        budgets = self._limit(found, caller, self._limit_login(login.strip().lower()))
        self._take(budgets, found)
        self._check_password(found, password)
        if found is None:
            raise LoginRefused
        if found.second_factor:
            self.throttle.give_back(budgets)
            return Step("code", found.person_id, self.tickets.make("code", STEP_TERM_S, found.person_id))
        self.throttle.clear(budgets)
        if self._must_enrol:
            return Step("enrol", found.person_id, self.begin_enrolment(found.person_id))
        return Step("in", found.person_id)

    def give_code(self, ticket: str, code: str, caller: Caller) -> Entered:
        """Take the second step: a code of the authenticator, or a recovery code.

        Raises LoginRefused, SecondFactorLost, TooManyTries, TicketSpent or NotInstalled.
        """
        person_id = self.tickets.look("code", ticket).person_id
        found = self.credentials.find_of(person_id)
        budgets = self._limit(found, caller, limit_code(person_id))
        self._take(budgets, found)
        self._check_second_factor(found, code, budgets)
        if found is None or not self._is_code(found, code):
            logger.warning("login refused: the second factor")
            self.accounts.note_refusal(person_id)
            raise LoginRefused
        self.tickets.take("code", ticket)
        self.throttle.clear((*budgets, self._limit_login(self.accounts.get_person(person_id).login)))
        return self.enter(person_id, caller)

    def enter(self, person_id: str, caller: Caller, codes: Sequence[str] = ()) -> Entered:
        """Begin a session, in a browser that is known from now on."""
        browser = self.credentials.note_browser(caller.browser, person_id)
        use = self.credentials.find_link_use(person_id)
        is_news = use is not None and not use.is_told
        return Entered(self.accounts.begin_session(person_id), browser, codes, is_news)

    def confirm(self, subject: Subject, proof: str, caller: Caller) -> str:
        """Take the password, or a code of the authenticator, again from somebody who is logged in.

        Gives the new cookie of the session. Raises LoginRefused, SecondFactorLost, TooManyTries or
        NotInstalled.
        """
        found = self.credentials.find_of(subject.id)
        budgets = self._limit(found, caller, limit_code(subject.id))
        self._take(budgets, found)
        self._check_second_factor(found, proof, budgets)
        if found is None or not self._is_proof(found, proof):
            logger.warning("confirmation refused")
            raise LoginRefused
        self.throttle.clear(budgets)
        return self.accounts.confirm_session(subject.session)

    # The second factor.

    def begin_enrolment(self, person_id: str) -> str:
        """Make a secret for an authenticator; it counts once a code of it was given. Gives the ticket."""
        secret = self.accounts.secrets.encrypt(self._codes.make_secret(), name_second_factor(person_id))
        return self.tickets.make("enrol", STEP_TERM_S, person_id, secret=secret)

    def show_enrolment(self, ticket: str) -> tuple[str, str]:
        """Give the secret of an enrolment, as text and as a drawing. Raises TicketSpent or NotInstalled."""
        found = self.tickets.look("enrol", ticket)
        secret, person = self._open_secret(found), self.accounts.get_person(found.person_id)
        return secret, self._codes.draw_secret(secret, person.login)

    def enrol(self, ticket: str, code: str) -> tuple[str, Sequence[str]]:
        """Turn an authenticator on by its first code; gives the person and the recovery codes.

        Raises LoginRefused, TicketSpent or NotInstalled.
        """
        found = self.tickets.look("enrol", ticket)
        secret = self._open_secret(found)
        step = self._codes.find_step(secret, code, self.accounts.clock(), 0)
        if step is None:
            raise LoginRefused
        self.tickets.take("enrol", ticket)
        codes: Sequence[str] = self._codes.make_recovery_codes()
        self.credentials.set_second_factor(found.person_id, secret, step, codes)
        return found.person_id, codes

    def _open_secret(self, ticket: Ticket) -> str:
        return self.accounts.secrets.decrypt(str(ticket.told["secret"]), name_second_factor(ticket.person_id))

    def drop_second_factor(self, person_id: str) -> None:
        """Turn the authenticator off; where it is required the next login sets one up."""
        self.credentials.set_second_factor(person_id, "", 0, ())

    # Passwords.

    def make_link(self, person_id: str, term_s: float) -> str:
        """Make the last part of an address that works once, by which a person chooses a password."""
        return self.tickets.make("password", term_s, person_id, made_by=find_actor())

    def set_password_by_link(self, ticket: str, password: str, address: str) -> Person:
        """Set a password by a link, used from ``address``; every session of the person ends.

        No session begins: the person logs in by it then, with the second factor. Raises TicketSpent,
        WeakPassword or NotInstalled.
        """
        person = self.accounts.get_person(self.tickets.look("password", ticket).person_id)
        self.check_password(person, password)
        told = self.tickets.take("password", ticket).told
        use = LinkUse(str(told.get("made_by", NOBODY)), _ADDRESS.sub("-", address)[:LONGEST_ADDRESS])
        self.credentials.set_password_by_link(person, self._passwords.hash_password(password), use)
        self.accounts.end_sessions(person.id)
        return person

    def change_password(self, subject: Subject, proof: str, password: str, caller: Caller) -> str:
        """Set another password, by the one before; every other session of the person ends.

        Gives the new cookie of the session. Raises LoginRefused, TooManyTries, WeakPassword or
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
        """Set a password that was checked; every session of the person but one ends."""
        self.credentials.set_password(person.id, self._passwords.hash_password(password))
        self.accounts.end_sessions(person.id, but)

    @property
    def _passwords(self) -> ModuleType:
        return load_extra("app.access.passwords", EXTRA)

    @property
    def _codes(self) -> ModuleType:
        return load_extra("app.access.second_factor", EXTRA)

    def _limit(self, found: Credentials | None, caller: Caller, of_person: Budget) -> Sequence[Budget]:
        """Choose what a try is counted by: the browser alone where the person logged in there before."""
        known_as = found.person_id if found is not None else ""
        if caller.browser and self.credentials.knows_browser(caller.browser, known_as):
            return (limit_browser(caller.browser),)
        return (of_person, limit_address(caller.address))

    def _take(self, budgets: Sequence[Budget], found: Credentials | None) -> None:
        self.throttle.take(budgets, found.person_id if found is not None else "")

    def _limit_login(self, login: str) -> Budget:
        return limit_account(self._names.hash(login))

    def _check_password(self, found: Credentials | None, password: str) -> None:
        kept = found.password_hash if found is not None else None
        if not self._passwords.verify_password(kept, password):
            logger.warning("login refused: name or password")
            self.accounts.note_refusal(found.person_id if found is not None else "")
            raise LoginRefused
        if found is not None and kept is not None and self._passwords.needs_rehash(kept):
            hashed = self._passwords.hash_password(password)
            self.credentials.set_password(found.person_id, hashed, is_new=False)

    def _is_proof(self, found: Credentials, proof: str) -> bool:
        if found.second_factor and _is_step(proof):
            return self._is_code(found, proof)
        is_right: Callable[[str | None, str], bool] = self._passwords.verify_password
        return is_right(found.password_hash, proof)

    def _check_second_factor(self, found: Credentials | None, code: str, budgets: Collection[Budget]) -> None:
        """Refuse a code that cannot be compared, for the key is lost: a guess it is not, nor a wrong one.

        Raises SecondFactorLost.
        """
        if found is not None and found.second_factor == UNOPENED and _is_step(code):
            self.throttle.give_back(budgets)
            raise SecondFactorLost

    def _is_code(self, found: Credentials, code: str) -> bool:
        """Tell whether a code is right, and use it up."""
        typed = code.replace(" ", "")
        if _is_step(code):
            now_s = self.accounts.clock()
            step = self._codes.find_step(found.second_factor, typed, now_s, found.last_step)
            return step is not None and self.credentials.use_step(found.person_id, step)
        return self.credentials.use_recovery_code(found.person_id, self._codes.read_recovery_code(code))


def _is_step(code: str) -> bool:
    """Tell whether a code is an authenticator's, and no recovery code."""
    typed = code.replace(" ", "")
    return len(typed) == STEP_DIGITS and typed.isdecimal()
