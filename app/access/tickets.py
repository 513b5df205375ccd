"""What works once and for a while: an invitation, a new password, the second step of a login."""

import json
import secrets
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from sqlalchemy import delete, insert, select, update

from app.access.accounts import note_act
from app.access.database import AccountDatabase
from app.access.hashing import hash_secret
from app.errors import TicketSpent
from app.jobs.database.tables import tickets

Purpose = Literal["password", "code", "enrol", "provider"]
"""``password``: set one; ``code``, ``enrol``: give or set up the second factor; ``provider``: return."""

TICKET_BYTES = 32


@dataclass(frozen=True, slots=True)
class Ticket:
    """Whom it is for ("" before anybody is known), and what it was told to keep."""

    person_id: str
    told: Mapping[str, Any]


class TicketStore:
    """Rows of tickets; of each only the digest is kept."""

    def __init__(self, database: AccountDatabase, clock: Callable[[], float] = time.time) -> None:
        self._database, self._clock = database, clock

    def make(self, purpose: Purpose, term_s: float, person_id: str = "", **told: Any) -> str:
        """Make a ticket; gives it. A person's earlier one for a new password no longer works."""
        ticket = secrets.token_urlsafe(TICKET_BYTES)
        row: dict[str, object] = {
            "hash": hash_secret(ticket),
            "purpose": purpose,
            "person_id": person_id or None,
        }
        row |= {"told": json.dumps(told), "expires_s": self._clock() + term_s}
        with self._database.write() as connection:
            connection.execute(delete(tickets).where(tickets.c.expires_s <= self._clock()))
            if purpose == "password":
                earlier = (tickets.c.person_id == person_id, tickets.c.purpose == purpose)
                connection.execute(delete(tickets).where(*earlier))
                note_act(connection, "link.made", person_id)
            connection.execute(insert(tickets).values(row))
        return ticket

    def look(self, purpose: Purpose, ticket: str) -> Ticket:
        """Give what a ticket says, and leave it. Raises TicketSpent."""
        return _read(self._database.read_one(select(tickets).where(*self._find(purpose, ticket))))

    def take(self, purpose: Purpose, ticket: str) -> Ticket:
        """Use a ticket up; of two who try at once one gets it. Raises TicketSpent."""
        with self._database.write() as connection:
            found = self._find(purpose, ticket)
            row = connection.execute(select(tickets).where(*found)).one_or_none()
            connection.execute(delete(tickets).where(*found))
        return _read(row)

    def tell(self, purpose: Purpose, ticket: str, **told: Any) -> None:
        """Change what a ticket says."""
        with self._database.write() as connection:
            found = self._find(purpose, ticket)
            connection.execute(update(tickets).where(*found).values(told=json.dumps(told)))

    def _find(self, purpose: Purpose, ticket: str) -> tuple[Any, ...]:
        is_it = (tickets.c.hash == hash_secret(ticket), tickets.c.purpose == purpose)
        return (*is_it, tickets.c.expires_s > self._clock())


def _read(row: Any | None) -> Ticket:
    if row is None:
        raise TicketSpent
    return Ticket(row.person_id or "", json.loads(row.told))
