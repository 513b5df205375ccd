"""The server secret: encrypts data that the server must read again (second factors, webhooks).

 data_dir/server.key     32 random bytes in base64, created at the first encryption

Copy the file to every further server of the same database. If it is lost, second factors must be enrolled
again and webhooks need new secrets; nothing else is lost.
"""

import base64
import os
import secrets
from dataclasses import dataclass
from pathlib import Path

from cryptography.fernet import Fernet, InvalidToken
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.kdf.hkdf import HKDF

from acromion.app.errors import SecretUnreadable
from acromion.app.store.folder import sync_folder, translate_disk_full
from acromion.app.store.permissions import create_file, make_folder

LENGTH_BYTES = 45
SECRET_FILE = "server.key"  # noqa: S105 - the name of a file


@dataclass(frozen=True, slots=True)
class ServerSecret:
    """The secret in a data folder; the file is read at each use."""

    data_dir: Path

    @property
    def file(self) -> Path:
        """Path of the secret."""
        return self.data_dir / SECRET_FILE

    def encrypt(self, text: str, about: str) -> str:
        """Encrypt a text; ``about`` describes its purpose and is needed to decrypt it."""
        return Fernet(self._derive(about, self._create())).encrypt(text.encode()).decode()

    def decrypt(self, token: str, about: str) -> str:
        """Decrypt a text from :meth:`encrypt` with the same ``about``.

        Raises SecretUnreadable if the file is missing or did not encrypt the text.
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
        """Return the secret; the first call creates it durably."""
        if not self.file.exists() or self.file.stat().st_size < LENGTH_BYTES:  # a power failure has cut it
            self.file.unlink(missing_ok=True)
            make_folder(self.data_dir)
            part = self.file.with_name(f"{SECRET_FILE}.{secrets.token_hex(8)}.part")
            try:
                with translate_disk_full(), create_file(part) as file:
                    file.write(base64.b64encode(secrets.token_bytes(32)) + b"\n")
                    file.flush()
                    os.fsync(file.fileno())
                os.link(part, self.file)
            except FileExistsError:  # another process was faster
                pass
            finally:
                part.unlink(missing_ok=True)
            sync_folder(self.data_dir)
        return self.file.read_bytes()
