"""The leader: the one of several processes that does their shared work.

Among web servers it does the housekeeping (retention, webhooks): if three servers counted time, thirty days
would pass in ten. Among workers it puts back the jobs of dead workers: if every worker checked all others,
the load would grow with the square of their number.
"""

from contextlib import suppress
from dataclasses import dataclass

from sqlalchemy import Connection, Engine, text
from sqlalchemy.exc import OperationalError

UPKEEP, REVIVAL = 0x6163726B, 0x61637276  # arbitrary numbers of advisory locks: the holder leads

_KEYS = ":key, hashtext(current_schema())"
"""Servers in different schemas of one database have separate leaders."""
_NOTICE_DEATH = text(
    "SELECT set_config(name, CASE name WHEN 'tcp_keepalives_count' THEN '3' ELSE '5' END, false) "
    "FROM pg_settings WHERE name LIKE 'tcp\\_keepalives\\_%'"
)
"""The database releases the lock within 20 s after the leader's computer fails without notice."""
_NOTICE_SILENCE = text(
    "SELECT set_config(name, :limit, false) FROM pg_settings WHERE name = 'idle_session_timeout'"
)
"""PostgreSQL 14 and newer end the session of a stalled leader, which releases its lock."""


@dataclass(slots=True)
class Leader:
    """Leads while its connection lives; SQLite has no other server.

    ``lock`` identifies the work. A leader that does not check within ``silence_s`` loses the lead; None: no
    limit.
    """

    engine: Engine
    lock: int = UPKEEP
    silence_s: float | None = None
    _connection: Connection | None = None

    def is_leader(self) -> bool:
        """Return whether this process leads; it becomes the leader if there is none.

        Raises OperationalError if the connection is lost; this process then no longer leads.
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
        """Stop leading at once: without the unlock the database would keep the lock a little longer."""
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
