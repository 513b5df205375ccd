"""Find who makes a request by its start secret, session or token."""

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
    """The secret of a server without accounts, and the unused single-use links.

    It is in ``DATA/secret``, readable only by its owner, so that other users of the computer do not have it.
    Scripts send it as ``Authorization: Bearer``. A browser opens a single-use link (``--open`` opens it, the
    terminal prints it) and receives a cookie.
    """

    bearer: str
    _unopened: set[str] = field(default_factory=set)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    @property
    def cookie(self) -> str:
        """Value of the browser's cookie: it opens the pages, but is not the secret."""
        return hmac.digest(self.bearer.encode(), b"cookie", "sha256").hex()

    def matches(self, bearer: str, cookie: str) -> bool:
        """Return whether a request contains the secret or the cookie."""
        by_secret = hmac.compare_digest(bearer.encode(), self.bearer.encode())
        by_cookie = hmac.compare_digest(cookie.encode(), self.cookie.encode())
        return by_secret or by_cookie

    def make_address(self) -> str:
        """Create the last part of a single-use link."""
        ticket = secrets.token_urlsafe(24)
        with self._lock:
            self._unopened.add(ticket)
        return ticket

    def take_address(self, ticket: str) -> bool:
        """Use up a link; return False if it does not exist or was used before."""
        with self._lock:
            if ticket not in self._unopened:
                return False
            self._unopened.remove(ticket)
            return True


def read_or_create_secret(data_dir: Path) -> StartSecret:
    """Read the secret of a data folder; create it at the first start or after the file was deleted."""
    path = data_dir / FILE_NAME
    with suppress(FileExistsError), create_file(path) as file:
        file.write(secrets.token_urlsafe(SECRET_BYTES).encode())
        file.flush()
        os.fsync(file.fileno())
    path.chmod(FILE_MODE)
    return StartSecret(path.read_text("ascii").strip())


@dataclass(frozen=True, slots=True)
class Credentials:
    """Credentials of a request: ``Authorization: Bearer`` and the session cookie, each "" if missing.

    ``is_attended``: false for an automatic request of a page, which does not keep a session alive.
    """

    bearer: str
    cookie: str
    is_attended: bool = True


@dataclass(frozen=True, slots=True)
class Gate:
    """Decides who may enter. ``secret`` is None if the administrator chose to have none."""

    secret: StartSecret | None
    accounts: AccountStore

    @property
    def needs_accounts(self) -> bool:
        """Whether people must sign in, because accounts exist."""
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
        """Return whether a subject may continue its work."""
        if subject.id == MACHINE:
            return not self.needs_accounts
        return self.accounts.is_alive(subject)

    def is_confirmed(self, subject: Subject) -> bool:
        """Return whether an irreversible act is allowed now; scripts never need to confirm a password."""
        return subject.kind != "person" or self.accounts.is_confirmed(subject)
