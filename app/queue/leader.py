"""The leader: the one of several processes that does the work they share.

Of the web servers it does the housekeeping (terms, webhooks): with three that all count time, a term of
thirty days would pass in ten. Of the workers it puts back what dead ones held: where each reads the rows of
all, their number goes with the square of the workers.
"""

from contextlib import suppress
from dataclasses import dataclass

from sqlalchemy import Connection, Engine, text
from sqlalchemy.exc import OperationalError

UPKEEP, REVIVAL = 0x6163726B, 0x61637276  # arbitrary numbers: whoever holds the advisory lock leads

_KEYS = ":key, hashtext(current_schema())"
"""Servers in several schemas of one database lead apart."""
_NOTICE_DEATH = text(
    "SELECT set_config(name, CASE name WHEN 'tcp_keepalives_count' THEN '3' ELSE '5' END, false) "
    "FROM pg_settings WHERE name LIKE 'tcp\\_keepalives\\_%'"
)
"""The database lets go of the lock within 20 s of the end of a leader's computer, which says no word."""
_NOTICE_SILENCE = text(
    "SELECT set_config(name, :limit, false) FROM pg_settings WHERE name = 'idle_session_timeout'"
)
"""PostgreSQL 14 and newer: it ends the session of a leader that stands still, and its lock with it."""


@dataclass(slots=True)
class Leader:
    """Leads as long as its connection lives; with SQLite there is no other server.

    ``lock`` names the work. A leader that does not ask within ``silence_s`` leads no more; None: it may be
    silent.
    """

    engine: Engine
    lock: int = UPKEEP
    silence_s: float | None = None
    _connection: Connection | None = None

    def is_leader(self) -> bool:
        """Return whether this process leads; it becomes the leader where there is none.

        Raises OperationalError: the connection is cut; this process leads no more.
        """
        if self.engine.dialect.name != "postgresql":
            return True
        try:
            if self._connection is None:
                self._connection = self._try_lock()
            else:
                self._connection.execute(text("SELECT 1"))
        except OperationalError:
            self.close()
            raise
        return self._connection is not None

    def close(self) -> None:
        """Lead no more, from this moment: one that only hangs up holds its lock a little longer."""
        if self._connection is None:
            return
        connection, self._connection = self._connection, None
        with suppress(OperationalError):
            if not connection.invalidated:
                connection.execute(text(f"SELECT pg_advisory_unlock({_KEYS})").bindparams(key=self.lock))
        connection.invalidate()
        connection.close()

    def _try_lock(self) -> Connection | None:
        connection = self.engine.connect().execution_options(isolation_level="AUTOCOMMIT")
        lock = text(f"SELECT pg_try_advisory_lock({_KEYS})").bindparams(key=self.lock)
        if not connection.execute(lock).scalar_one():
            connection.close()
            return None
        connection.execute(_NOTICE_DEATH)
        if self.silence_s is not None:
            connection.execute(_NOTICE_SILENCE, {"limit": f"{round(1000 * self.silence_s)}ms"})
        return connection
