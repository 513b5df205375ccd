"""Find who makes a request by its start secret, session or token."""

import hmac
import os
import re
import secrets
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from acromion.app.accounts.accounts import AccountStore
from acromion.app.accounts.subjects import AT_THE_MACHINE, MACHINE, Subject
from acromion.app.errors import StartSecretUnusable
from acromion.app.store.permissions import FILE_MODE, create_file

FILE_NAME = "secret"
SECRET_BYTES = 32
WELL_FORMED = re.compile(r"[A-Za-z0-9_-]{32,}")
ADMISSION_TERM_S = 12 * 3600
"""How long a browser may use the server after it opened the address of a start."""


@dataclass(slots=True)
class StartSecret:
    """The secret of a server without accounts, the unopened addresses, and the browsers that opened one.

    The secret is in ``DATA/secret``, readable by its owner only. Scripts send it as a
    bearer token. A browser opens an address that works once and gets a random cookie. It is valid until the
    server stops, at most :data:`ADMISSION_TERM_S`. ``now_s``: a clock that never jumps.
    """

    bearer: str
    now_s: Callable[[], float] = time.monotonic
    _unopened: set[str] = field(default_factory=set)
    _end_by_cookie: dict[str, float] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def admit_browser(self) -> str:
        """Return a new cookie for a browser."""
        cookie = secrets.token_urlsafe(SECRET_BYTES)
        with self._lock:
            now_s = self.now_s()
            self._end_by_cookie = {one: end for one, end in self._end_by_cookie.items() if end > now_s}
            self._end_by_cookie[cookie] = now_s + ADMISSION_TERM_S
        return cookie

    def sign_out(self, cookie: str) -> None:
        """End the validity of a browser's cookie."""
        with self._lock:
            self._end_by_cookie.pop(cookie, None)

    def matches(self, bearer: str, cookie: str) -> bool:
        """Return whether a request contains the secret or a valid cookie."""
        by_secret = hmac.compare_digest(bearer.encode(), self.bearer.encode())
        return by_secret or self.now_s() < self._end_by_cookie.get(cookie, float("-inf"))

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
    """Return the secret of a data folder; create it if the file does not exist.

    Raises StartSecretUnusable if the file is a link, unreadable, empty or not a secret of this server.
    """
    path = data_dir / FILE_NAME
    if path.is_symlink():  # the mode of its target is not ours to change
        raise StartSecretUnusable(file=str(path))
    with suppress(FileExistsError), create_file(path) as file:
        file.write(secrets.token_urlsafe(SECRET_BYTES).encode())
        file.flush()
        os.fsync(file.fileno())
    try:
        path.chmod(FILE_MODE)
        bearer = path.read_text("ascii").strip()
    except (OSError, UnicodeDecodeError) as error:
        raise StartSecretUnusable(file=str(path)) from error
    if not WELL_FORMED.fullmatch(bearer):  # an empty secret would admit everyone
        raise StartSecretUnusable(file=str(path))
    return StartSecret(bearer)


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
