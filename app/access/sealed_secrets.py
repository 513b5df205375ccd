"""Secrets of authenticators and names of people, sealed before they reach the database of the accounts.

Their key is one of those of the organisation "own" (:mod:`app.storage.keys`): a copy
of the accounts without the keys shows none, and the backup of the keys opens them elsewhere. The person is
bound to what is sealed, so that no row opens as another's.
"""

import base64
from dataclasses import dataclass
from typing import Literal

from app.errors import KeyGone
from app.storage.keys import KeyStore
from app.storage.store import BrokenSeal

ACCOUNTS = "accounts"
"""The name of the key."""
MARK = "~1~"
What = Literal["second factor", "name"]


@dataclass(frozen=True, slots=True)
class SecretSealer:
    """Seals and opens what is kept of a person: ``what`` it is, is bound to it."""

    keys: KeyStore

    @property
    def has_key(self) -> bool:
        """Whether the key is here."""
        return self.keys.find(ACCOUNTS) is not None

    def seal(self, person_id: str, secret: str, what: What = "second factor") -> str:
        """Give a secret as it is kept."""
        sealed = self.keys.create(ACCOUNTS).seal(secret.encode(), f"{what} of {person_id}")
        return MARK + base64.b64encode(sealed).decode()

    def open(self, person_id: str, kept: str, what: What = "second factor") -> str:
        """Give the secret; one of an earlier release, in clear, is given as it is.

        Raises
        ------
        KeyGone
            The key is not here, or it sealed something else.
        """
        if not is_sealed(kept):
            return kept
        try:
            sealed = base64.b64decode(kept.removeprefix(MARK))
            return self.keys.get(ACCOUNTS).open(sealed, f"{what} of {person_id}").decode()
        except (BrokenSeal, ValueError):
            raise KeyGone(id=ACCOUNTS) from None


def is_sealed(kept: str) -> bool:
    """Tell whether a kept secret is sealed."""
    return kept.startswith(MARK)
