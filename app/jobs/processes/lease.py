"""The lease: how long a worker holds a job without a word.

The worker's own loop renews it, the one that receives the progress of the child process; no thread does. A
worker that hangs, was killed or has lost the database loses its job. Every write names the token of the
attempt, so that a worker that lost its job changes nothing.
"""

import logging
import os
import time
from collections.abc import Callable
from typing import TypeVar

from sqlalchemy.exc import OperationalError

from app.jobs.children.attempt import run_beside
from app.jobs.store import JobStore

RENEWAL_S = 1.0

T = TypeVar("T")

logger = logging.getLogger(__name__)


class Lease:
    """The hold of this worker on a job that it has claimed."""

    def __init__(self, store: JobStore, analysis_id: str, token: str) -> None:
        self._store, self._claim = store, (analysis_id, token)
        self._progress: tuple[str | None, float] = (None, 0.0)
        self._renewed_s = time.monotonic()

    def renew(self, stage: str | None, fraction: float) -> bool:
        """Renew the lease where progress was made or a second has passed; False when the job is lost.

        While the database is away nobody can take the job: the attempt continues, and its end is guarded.
        """
        now_s, progress = time.monotonic(), (stage, fraction)
        if progress == self._progress and now_s - self._renewed_s < RENEWAL_S:
            return True
        self._progress, self._renewed_s = progress, now_s
        try:
            return self._store.renew(*self._claim, *progress)
        except OperationalError:
            logger.warning("%s: not renewed, the database does not answer", self._claim[0])
            return True

    def keep_during(self, act: Callable[[], T], limit_s: float) -> T:
        """Renew the lease while a step runs that reads or writes large files; return its result.

        A step that takes longer than the limit waits for a disk or a network that never answers: this process
        ends, and whoever takes the job begins anew.
        """
        end_s = time.monotonic() + limit_s

        def renew_until_limit() -> None:
            if time.monotonic() > end_s:
                logger.critical("the store has not answered for %.0f s; the worker ends itself", limit_s)
                os._exit(1)
            self.renew(*self._progress)

        return run_beside(act, renew_until_limit)
