"""The secret of a server that nobody logs in to: another user of the same computer does not have it.

    DATA/secret     readable by its owner only; scripts send it as ``Authorization: Bearer``

A browser opens an address that works once (``--open`` opens it, the terminal shows it) and gets a cookie.
"""

import hmac
import os
import secrets
import threading
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from app.storage.permissions import FILE_MODE, create_file

FILE_NAME = "secret"
SECRET_BYTES = 32


@dataclass(slots=True)
class StartSecret:
    """The secret itself, and the addresses that were not opened yet."""

    bearer: str
    _unopened: set[str] = field(default_factory=set)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    @property
    def cookie(self) -> str:
        """The value of the browser's cookie: it opens the pages, but is not the secret."""
        return hmac.digest(self.bearer.encode(), b"cookie", "sha256").hex()

    def matches(self, bearer: str, cookie: str) -> bool:
        """Tell whether a request brings the secret or the cookie."""
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
