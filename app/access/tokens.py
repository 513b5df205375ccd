"""What a token may be: no more than its person may, for no longer than a year."""

from collections.abc import Collection
from datetime import UTC, datetime

from app.access.accounts import AccountStore, Token, check_name
from app.access.subjects import PERMISSIONS, Permission, Subject
from app.errors import BadParameter, NotPermitted

DAYS, MOST_DAYS = 90, 365
DAY_S = 24 * 3600.0


def make_token(
    accounts: AccountStore, person: Subject, name: str, permissions: Collection[Permission], days: int
) -> tuple[Token, str]:
    """Make a token of a person; gives it, and what is to be shown once.

    Raises
    ------
    BadParameter, NotPermitted
        ``permissions`` holds one that the person has not.
    """
    if not 1 <= days <= MOST_DAYS:
        raise BadParameter(name="days", value=days, allowed=f"1 … {MOST_DAYS}")
    check_name(name)
    if not permissions:
        raise BadParameter(name="permissions", value="", allowed=", ".join(PERMISSIONS))
    for permission in permissions:
        if not person.may(permission):
            raise NotPermitted(permission=permission)
    bearer = accounts.add_token(person.id, name.strip(), permissions, accounts.clock() + days * DAY_S)
    return accounts.get_token(bearer), bearer


def format_end(token: Token) -> str:
    """Write when a token ends (ISO 8601, UTC)."""
    return datetime.fromtimestamp(token.expires_s, UTC).isoformat(timespec="seconds")
