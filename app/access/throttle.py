"""Delays after wrong logins: by account, by address, and for a browser that logged in before by itself.

A try counts before it is looked at, so that many at once get no more than many in a row. Who knows a password
gets his try back. A stranger's tries delay the account and his address, never a browser that is known.
Tries that had to wait are a line of the audit log, once for each account, address or browser in 15 minutes.
"""

import time
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from ipaddress import ip_address, ip_network
from math import ceil

from sqlalchemy import Connection, delete, insert, select, update

from app.access.accounts import note_act
from app.access.database import AccountDatabase
from app.access.hashing import hash_secret
from app.errors import TooManyTries
from app.jobs.database.tables import tries

FORGET_S = 3600.0
"""So long after the last wrong try nothing is held against anybody."""
TOLD_S = 15 * 60.0
"""So long a further try that had to wait is no further line."""


@dataclass(frozen=True, slots=True)
class Budget:
    """Whose tries are counted: the first ``free`` cost no time, then 1, 2, 4 … s up to ``longest_s``."""

    key: str
    free: int
    longest_s: float

    def find_delay_s(self, failures: int) -> float:
        """Give how long the next try has to wait."""
        return min(self.longest_s, 2.0 ** (failures - self.free)) if failures >= self.free else 0.0


class Throttle:
    """Rows of tries."""

    def __init__(self, database: AccountDatabase, clock: Callable[[], float] = time.time) -> None:
        self._database, self._clock = database, clock

    def take(self, budgets: Collection[Budget], person_id: str = "") -> None:
        """Count a try, or refuse it before anything is computed; ``person_id``: whom it is about, if known.

        Raises TooManyTries.
        """
        now_s = self._clock()
        with self._database.write() as connection:
            connection.execute(delete(tries).where(tries.c.blocked_until_s < now_s - FORGET_S))
            counts = [_read(connection, budget) for budget in budgets]
            wait_s = max(until_s for _, until_s in counts) - now_s
            for budget, (failures, until_s) in zip(budgets, counts, strict=True):
                if wait_s <= 0:
                    delay_s = budget.find_delay_s(failures + 1)
                    _write(connection, budget, failures + 1, now_s + delay_s)
                elif until_s > now_s:
                    _tell(connection, budget, person_id, now_s)
        if wait_s > 0:
            raise TooManyTries(wait_s=ceil(wait_s))

    def give_back(self, budgets: Collection[Budget]) -> None:
        """Take back a try that was right; what was wrong before stays counted."""
        with self._database.write() as connection:
            for budget in budgets:
                failures, _ = _read(connection, budget)
                _write(connection, budget, max(failures - 1, 0), self._clock())

    def clear(self, budgets: Collection[Budget]) -> None:
        """Hold nothing against whoever has logged in; against the address only one try less.

        Somebody with an account of his own must not clear his address by it.
        """
        self.give_back([budget for budget in budgets if budget.key.startswith(_ADDRESS)])
        own = [budget.key for budget in budgets if not budget.key.startswith(_ADDRESS)]
        with self._database.write() as connection:
            connection.execute(delete(tries).where(tries.c.key.in_(own)))


_ADDRESS = "address:"


def limit_account(login_hash: str) -> Budget:
    """Count tries of one name, whether or not there is such a person; by its keyed digest, not as typed."""
    return Budget(f"account:{login_hash}", 5, 300.0)


def limit_code(person_id: str) -> Budget:
    """Count tries of a person's second factor: the right password does not clear them."""
    return Budget(f"code:{person_id}", 5, 300.0)


def limit_address(address: str) -> Budget:
    """Count tries from one address; of IPv6 one network, as a household has."""
    return Budget(f"{_ADDRESS}{find_network(address)}", 10, 900.0)


def limit_browser(browser: str) -> Budget:
    """Count tries of a browser that logged in before."""
    return Budget(f"browser:{hash_secret(browser)}", 10, 900.0)


def find_network(address: str) -> str:
    """Give what an address is counted by: itself, or of IPv6 its network."""
    try:
        known = ip_address(address)
    except ValueError:
        return address[:40]
    return str(known) if known.version == 4 else str(ip_network((known, 64), strict=False))


def _read(connection: Connection, budget: Budget) -> tuple[int, float]:
    row = connection.execute(select(tries).where(tries.c.key == budget.key)).one_or_none()
    return (row.failures, row.blocked_until_s) if row is not None else (0, 0.0)


def _write(connection: Connection, budget: Budget, failures: int, until_s: float) -> None:
    values = {"failures": failures, "blocked_until_s": until_s}
    changed = connection.execute(update(tries).where(tries.c.key == budget.key).values(values))
    if not changed.rowcount:
        connection.execute(insert(tries).values(key=budget.key, **values))


def _tell(connection: Connection, budget: Budget, person_id: str, now_s: float) -> None:
    """Note that tries had to wait, unless that was noted a short time ago.

    An address says nothing of a person.
    """
    told, kind = replace(budget, key=f"told:{budget.key}"), budget.key.partition(":")[0]
    if _read(connection, told)[1] > now_s:
        return
    _write(connection, told, 0, now_s + TOLD_S)
    about = "" if budget.key.startswith(_ADDRESS) else person_id
    note_act(connection, "login.throttled", about, by=kind)
