"""Finds who asks by what a request brings: the secret of the start, a session or a token."""

import hmac
import os
import secrets
import threading
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from app.accounts.accounts import AccountStore
from app.accounts.subjects import AT_THE_MACHINE, MACHINE, Subject
from app.store.permissions import FILE_MODE, create_file

FILE_NAME = "secret"
SECRET_BYTES = 32


@dataclass(slots=True)
class StartSecret:
    """The secret of a server that nobody logs in to, and the addresses that were not opened yet.

    It is in ``DATA/secret``, readable by its owner only: another user of the same computer does not have it.
    Scripts send it as ``Authorization: Bearer``. A browser opens an address that works once (``--open`` opens
    it, the terminal shows it) and gets a cookie.
    """

    bearer: str
    _unopened: set[str] = field(default_factory=set)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    @property
    def cookie(self) -> str:
        """The value of the browser's cookie: it opens the pages, but is not the secret."""
        return hmac.digest(self.bearer.encode(), b"cookie", "sha256").hex()

    def matches(self, bearer: str, cookie: str) -> bool:
        """Return whether a request brings the secret or the cookie."""
        by_secret = hmac.compare_digest(bearer.encode(), self.bearer.encode())
        by_cookie = hmac.compare_digest(cookie.encode(), self.cookie.encode())
        return by_secret or by_cookie

    def make_address(self) -> str:
        """Make the last part of an address that works once."""
        ticket = secrets.token_urlsafe(24)
        with self._lock:
            self._unopened.add(ticket)
        return ticket

    def take_address(self, ticket: str) -> bool:
        """Use up an address; False where there is none, or it was opened before."""
        with self._lock:
            if ticket not in self._unopened:
                return False
            self._unopened.remove(ticket)
            return True


def read_or_create_secret(data_dir: Path) -> StartSecret:
    """Read the secret of a data folder; the first start makes it. Who deletes the file has a new one made."""
    path = data_dir / FILE_NAME
    with suppress(FileExistsError), create_file(path) as file:
        file.write(secrets.token_urlsafe(SECRET_BYTES).encode())
        file.flush()
        os.fsync(file.fileno())
    path.chmod(FILE_MODE)
    return StartSecret(path.read_text("ascii").strip())


@dataclass(frozen=True, slots=True)
class Credentials:
    """What a request brings: ``Authorization: Bearer`` and the session's cookie, each "" where absent.

    ``is_attended``: false for what a page asks by itself, which keeps no session alive.
    """

    bearer: str
    cookie: str
    is_attended: bool = True


@dataclass(frozen=True, slots=True)
class Gate:
    """Who may come in. ``secret`` is None where the person who started the server chose to have none."""

    secret: StartSecret | None
    accounts: AccountStore

    @property
    def needs_accounts(self) -> bool:
        """Whether people log in, instead of holding the secret."""
        return self.accounts.exist()

    def find_subject(self, credentials: Credentials) -> Subject | None:
        """Return the subject of the credentials; None if they are unknown."""
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
        """Return whether a subject may still go on with what it began."""
        if subject.id == MACHINE:
            return not self.needs_accounts
        return self.accounts.is_alive(subject)

    def is_confirmed(self, subject: Subject) -> bool:
        """Return whether an irreversible act is allowed now; scripts are never asked for a password."""
        return subject.kind != "person" or self.accounts.is_confirmed(subject)
