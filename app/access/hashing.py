"""What is kept of a long and random secret: its digest, without a salt. Of what people type: a keyed one."""

import hashlib
import hmac
import logging
import secrets
from dataclasses import dataclass, field

from app.errors import KeyFileMissing, KeyGone, KeyMismatch
from app.storage.keys import KeyStore
from app.storage.labels import write_keyed

LOGINS = "logins"
"""The name of the key of digests of what was typed. Nothing else needs it: a lost one is made anew."""

logger = logging.getLogger(__name__)


def hash_secret(secret: str) -> str:
    """Give the digest of a secret, as rows hold it."""
    return hashlib.sha256(secret.encode()).hexdigest()


@dataclass(frozen=True, slots=True)
class NameHasher:
    """Digests of names as people type them, who sometimes type a password: no guess can be tried on the rows.

    The key is one of the organisation "own", so that all servers count together. Where it does not open, a
    server counts by a key in its memory: alone, but it counts.
    """

    keys: KeyStore
    _own: bytes = field(default_factory=lambda: secrets.token_bytes(32), repr=False)

    def hash(self, typed: str) -> str:
        """Give the keyed digest of what was typed."""
        return write_keyed(hmac.digest(self._find_key(), typed.encode(), "sha256"))

    def _find_key(self) -> bytes:
        try:
            return self.keys.create(LOGINS).derive(b"", b"digest")
        except (KeyGone, KeyFileMissing, KeyMismatch):
            logger.warning("the key %s does not open: wrong logins are counted by this server alone", LOGINS)
            return self._own
