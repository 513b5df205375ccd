"""The secret of a server: encrypts what the server itself has to read again (second factors, webhooks).

    data_dir/server.key     32 random bytes in base64, created at the first encryption

Copy the file to every further server of the same database. Its loss costs the enrolment of second factors and
the secrets of webhooks, and nothing else.
"""

import base64
import os
import secrets
from dataclasses import dataclass
from pathlib import Path

from cryptography.fernet import Fernet, InvalidToken
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.kdf.hkdf import HKDF

from app.errors import SecretUnreadable
from app.store.folder import sync_folder, translate_disk_full
from app.store.permissions import create_file, make_folder

LENGTH_BYTES = 45
SECRET_FILE = "server.key"  # noqa: S105 - the name of a file


@dataclass(frozen=True, slots=True)
class ServerSecret:
    """The secret in a data folder; it is read anew each time."""

    data_dir: Path

    @property
    def file(self) -> Path:
        """The file of the secret."""
        return self.data_dir / SECRET_FILE

    def encrypt(self, text: str, about: str) -> str:
        """Encrypt a text; ``about`` says what it is, and is bound to it."""
        return Fernet(self._derive(about, self._create())).encrypt(text.encode()).decode()

    def decrypt(self, token: str, about: str) -> str:
        """Decrypt what :meth:`encrypt` gave for the same ``about``.

        Raises SecretUnreadable: the file is gone, or is not the one that encrypted it.
        """
        try:
            return Fernet(self._derive(about, self.file.read_bytes())).decrypt(token).decode()
        except (OSError, InvalidToken):
            raise SecretUnreadable(file=str(self.file)) from None

    def can_decrypt(self, token: str, about: str) -> bool:
        """Return whether this secret has encrypted a text."""
        try:
            self.decrypt(token, about)
        except SecretUnreadable:
            return False
        return True

    def derive(self, about: str) -> bytes:
        """Derive a key for digests."""
        return self._derive(about, self._create())

    def _derive(self, about: str, secret: bytes) -> bytes:
        key = HKDF(SHA256(), 32, None, f"acromion {about}".encode()).derive(secret.strip())
        return base64.urlsafe_b64encode(key)

    def _create(self) -> bytes:
        """Read the secret; the first call creates it, durable when this returns."""
        if not self.file.exists() or self.file.stat().st_size < LENGTH_BYTES:  # a power cut has torn it
            self.file.unlink(missing_ok=True)
            make_folder(self.data_dir)
            part = self.file.with_name(f"{SECRET_FILE}.{secrets.token_hex(8)}.part")
            try:
                with translate_disk_full(), create_file(part) as file:
                    file.write(base64.b64encode(secrets.token_bytes(32)) + b"\n")
                    file.flush()
                    os.fsync(file.fileno())
                os.link(part, self.file)
            except FileExistsError:  # a peer was quicker
                pass
            finally:
                part.unlink(missing_ok=True)
            sync_folder(self.data_dir)
        return self.file.read_bytes()
