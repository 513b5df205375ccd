"""Who may sign in after a restore or a recovery."""

import json
from dataclasses import dataclass

from sqlalchemy import Engine, select

from app.jobs.database.tables import people, tokens


@dataclass(frozen=True, slots=True)
class Accounts:
    """Accounts as login and roles; tokens as name, login of the person, permissions and end (seconds)."""

    people: tuple[tuple[str, str], ...] = ()
    tokens: tuple[tuple[str, str, str, float], ...] = ()


NO_ACCOUNTS = Accounts()


def find_accounts(reader: Engine) -> Accounts:
    """Find everybody who may sign in, and every token that is not revoked."""
    named = select(tokens, people.c.login).join(people, tokens.c.person_id == people.c.id)
    open_ones = named.where(tokens.c.ended_at.is_(None), people.c.ended_at.is_(None))
    with reader.connect() as connection:
        found = connection.execute(select(people).where(people.c.ended_at.is_(None)).order_by(people.c.login))
        here = tuple((row.login, _join(row.roles)) for row in found)
        given = connection.execute(open_ones.order_by(people.c.login, tokens.c.name))
        return Accounts(
            here, tuple((row.name, row.login, _join(row.permissions), row.expires_s) for row in given)
        )


def _join(names: str) -> str:
    return ", ".join(json.loads(names))
