"""A second factor: an authenticator's codes (RFC 6238) and recovery codes. Needs the extra ``trust``."""

import base64
import io
import secrets

import pyotp
import segno

STEP_S = 30
EITHER_SIDE = 1
"""Steps that a clock may be off."""
RECOVERY_CODES = 10
_GROUP, _GROUPS = 4, 6  # 120 bits: a digest without salt is enough


def make_secret() -> str:
    """Make the secret of an authenticator (base32, 160 bits)."""
    return pyotp.random_base32()


def find_step(secret: str, code: str, now_s: float, last_step: int) -> int | None:
    """Find the step of a code; None for a wrong code, and for one of a step that was used or is over."""
    given, now = code.replace(" ", ""), int(now_s) // STEP_S
    known = pyotp.TOTP(secret, interval=STEP_S)
    for step in range(now - EITHER_SIDE, now + EITHER_SIDE + 1):
        if pyotp.utils.strings_equal(known.generate_otp(step), given):
            return step if step > last_step else None
    return None


def draw_secret(secret: str, login: str) -> str:
    """Draw the secret as an authenticator's camera reads it: an SVG as ``data:`` address."""
    address = pyotp.TOTP(secret).provisioning_uri(name=login, issuer_name="Acromion")
    drawn = io.BytesIO()
    segno.make(address, error="m", micro=False).save(drawn, kind="svg", scale=5, light="#fff", xmldecl=False)
    return "data:image/svg+xml;base64," + base64.b64encode(drawn.getvalue()).decode()


def make_recovery_codes() -> tuple[str, ...]:
    """Make recovery codes, each of which works once."""
    return tuple(
        read_recovery_code(base64.b32encode(secrets.token_bytes(15)).decode()[: _GROUP * _GROUPS])
        for _ in range(RECOVERY_CODES)
    )


def read_recovery_code(typed: str) -> str:
    """Write a code that was typed as it was shown."""
    signs = "".join(sign for sign in typed.lower() if sign.isalnum())
    return "-".join(signs[start : start + _GROUP] for start in range(0, len(signs), _GROUP))
