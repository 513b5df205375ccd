"""What is kept of a secret that is long and random: its digest, which needs no salt."""

import hashlib


def hash_secret(secret: str) -> str:
    """Give the digest of a secret, as rows hold it."""
    return hashlib.sha256(secret.encode()).hexdigest()
