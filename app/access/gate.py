"""Finds who asks by what a request brings: the secret of the start, a session or a token."""

from dataclasses import dataclass
from typing import Protocol

from app.access.secret import StartSecret
from app.access.subjects import AT_THE_MACHINE, MACHINE, Subject


@dataclass(frozen=True, slots=True)
class Credentials:
    """What a request brings: ``Authorization: Bearer`` and the session's cookie, each "" where absent.

    ``is_attended``: false for what a page asks by itself, which keeps no session alive.
    """

    bearer: str
    cookie: str
    is_attended: bool = True


class Accounts(Protocol):
    """People, tokens and sessions of an installation."""

    def exist(self) -> bool:
        """Tell whether there is any account: from the first one on everybody logs in."""

    def find_by_session(self, cookie: str, *, is_use: bool = True) -> Subject | None:
        """Give who holds a session that goes on; note that it was used, if somebody did."""

    def find_by_token(self, bearer: str) -> Subject | None:
        """Give the token, if it is neither revoked nor expired and its person may still log in."""

    def is_alive(self, subject: Subject) -> bool:
        """Tell whether the subject's session or token still holds; counts as no use of it."""

    def is_confirmed(self, subject: Subject) -> bool:
        """Tell whether the person of a session gave the password a short time ago."""


@dataclass(frozen=True, slots=True)
class Gate:
    """Who may come in. ``secret`` is None where the person who started the server chose to have none."""

    secret: StartSecret | None
    accounts: Accounts

    @property
    def needs_accounts(self) -> bool:
        """Whether people log in, instead of holding the secret."""
        return self.accounts.exist()

    def find_subject(self, credentials: Credentials) -> Subject | None:
        """Give who asks; None for somebody unknown."""
        if self.needs_accounts:
            if credentials.bearer:
                return self.accounts.find_by_token(credentials.bearer)
            if not credentials.cookie:
                return None
            return self.accounts.find_by_session(credentials.cookie, is_use=credentials.is_attended)
        if self.secret is None or self.secret.matches(credentials.bearer, credentials.cookie):
            return AT_THE_MACHINE
        return None

    def is_alive(self, subject: Subject) -> bool:
        """Tell whether a subject may still go on with what it began."""
        if subject.id == MACHINE:
            return not self.needs_accounts
        return self.accounts.is_alive(subject)

    def is_confirmed(self, subject: Subject) -> bool:
        """Tell whether what cannot be undone may be done now; of scripts nobody can ask a password again."""
        return subject.kind != "person" or self.accounts.is_confirmed(subject)
