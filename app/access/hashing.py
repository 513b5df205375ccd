"""What is kept of a long and random secret: its digest, without a salt. Of what people type: a keyed one."""

import hashlib
import hmac
from dataclasses import dataclass

from app.storage.server_secret import ServerSecret


def hash_secret(secret: str) -> str:
    """Give the digest of a secret, as rows hold it."""
    return hashlib.sha256(secret.encode()).hexdigest()


@dataclass(frozen=True, slots=True)
class NameHasher:
    """Digests of names as people type them, who sometimes type a password: no guess can be tried on the rows.

    The key comes from the secret of the server, so that all servers count together.
    """

    server: ServerSecret

    def hash(self, typed: str) -> str:
        """Give the keyed digest of what was typed."""
        return hmac.digest(self.server.derive("logins"), typed.encode(), "sha256").hex()
