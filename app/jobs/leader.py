"""Which of several web servers looks after what they share: terms that pass, webhooks that are told.

Time is counted by whoever keeps house. Were it counted by all, three servers would let a term of thirty days
pass in ten.
"""

from dataclasses import dataclass

from sqlalchemy import Connection, Engine, text
from sqlalchemy.exc import OperationalError

_KEEPING = 0x6163726B  # any number of our own: who holds it keeps house


@dataclass(slots=True)
class Keeper:
    """Holds the office as long as its connection lives; with SQLite there is no other server."""

    engine: Engine
    _connection: Connection | None = None

    def holds_office(self) -> bool:
        """Tell whether this server keeps house, and take the office where nobody holds it."""
        if self.engine.dialect.name != "postgresql":
            return True
        try:
            if self._connection is None:
                self._connection = self._take()
            else:
                self._connection.execute(text("SELECT 1"))
        except OperationalError:
            self.close()
            raise
        return self._connection is not None

    def close(self) -> None:
        """Give the office up."""
        if self._connection is not None:
            self._connection.invalidate()
            self._connection.close()
            self._connection = None

    def _take(self) -> Connection | None:
        connection = self.engine.connect().execution_options(isolation_level="AUTOCOMMIT")
        take = text("SELECT pg_try_advisory_lock(:key)").bindparams(key=_KEEPING)
        if connection.execute(take).scalar_one():
            return connection
        connection.close()
        return None
