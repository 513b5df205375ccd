"""The leader: the one of several web servers that does the upkeep they share (terms, webhooks).

Only the leader counts time: with three servers that all count, a term of thirty days would pass in ten.
"""

from contextlib import suppress
from dataclasses import dataclass

from sqlalchemy import Connection, Engine, text
from sqlalchemy.exc import OperationalError

_LEADER_LOCK = 0x6163726B  # an arbitrary number: whoever holds this advisory lock leads


@dataclass(slots=True)
class Leader:
    """Leads as long as its connection lives; with SQLite there is no other server."""

    engine: Engine
    _connection: Connection | None = None

    def is_leader(self) -> bool:
        """Tell whether this server leads; it becomes the leader where there is none.

        Raises
        ------
        OperationalError
            The connection is cut; this server leads no more.
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
        """Lead no more, from this moment: a server that only hangs up holds its lock a little longer."""
        if self._connection is None:
            return
        connection, self._connection = self._connection, None
        with suppress(OperationalError):
            if not connection.invalidated:
                connection.execute(text("SELECT pg_advisory_unlock(:key)").bindparams(key=_LEADER_LOCK))
        connection.invalidate()
        connection.close()

    def _try_lock(self) -> Connection | None:
        connection = self.engine.connect().execution_options(isolation_level="AUTOCOMMIT")
        lock = text("SELECT pg_try_advisory_lock(:key)").bindparams(key=_LEADER_LOCK)
        if connection.execute(lock).scalar_one():
            return connection
        connection.close()
        return None
