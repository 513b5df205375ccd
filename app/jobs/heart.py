"""The beats of one claim, from its taking to its publication."""

import logging
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from sqlalchemy.exc import OperationalError

from app.jobs.store import JobStore

logger = logging.getLogger(__name__)


class Heart:
    """Says that the holder of a claim lives, in a thread of its own.

    A large recording may take longer to come from a bucket, or the results to go there, than a lease lasts;
    a holder who beat only while the analysis runs would be taken for dead meanwhile.
    """

    def __init__(self, store: JobStore, claim: tuple[str, str], heartbeat_s: float) -> None:
        self._store, self._claim, self._heartbeat_s = store, claim, heartbeat_s
        self._news: tuple[str | None, float] = (None, 0.0)
        self._writing = threading.Lock()

    @contextmanager
    def beating(self) -> Iterator["Heart"]:
        """Beat until the end of the block."""
        ended = threading.Event()
        thread = threading.Thread(target=self._beat_until, args=(ended,), name="heart", daemon=True)
        thread.start()
        try:
            yield self
        finally:
            ended.set()
            thread.join()

    def tell(self, stage: str | None, fraction: float) -> bool:
        """Write down how far the analysis is; False when the claim is no longer ours.

        While the database is away nobody can take the job: we go on, and the end is guarded anyway.
        """
        try:
            return self._write_or_look((stage, fraction))
        except OperationalError:
            logger.warning("%s: no heartbeat, the database does not answer", self._claim[0])
            return True

    def _write_or_look(self, news: tuple[str | None, float]) -> bool:
        with self._writing:
            if news == self._news:
                return self._store.owns(*self._claim)
            self._news = news
            return self._store.beat(*self._claim, *news)

    def _beat_until(self, ended: threading.Event) -> None:
        while not ended.wait(self._heartbeat_s):
            try:
                with self._writing:
                    self._store.beat(*self._claim, *self._news)
            except OperationalError:
                logger.warning("%s: no heartbeat, the database does not answer", self._claim[0])
