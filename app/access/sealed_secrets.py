"""Secrets of authenticators, encrypted before they reach the database.

The person is bound to what is encrypted, so that no row opens as another's.
"""

from dataclasses import dataclass

from app.storage.server_secret import ServerSecret


@dataclass(frozen=True, slots=True)
class SecretSealer:
    """Encrypts and decrypts the secret of a person's authenticator."""

    server: ServerSecret

    def seal(self, person_id: str, secret: str) -> str:
        """Give a secret as it is kept."""
        return self.server.encrypt(secret, f"second factor of {person_id}")

    def open(self, person_id: str, kept: str) -> str:
        """Give the secret.

        Raises
        ------
        SecretUnreadable
        """
        return self.server.decrypt(kept, f"second factor of {person_id}")
