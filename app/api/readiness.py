"""Whether an upload would be taken now: each thing that it needs, asked for by itself and within a limit."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import anyio
import anyio.to_thread
from sqlalchemy.exc import SQLAlchemyError

from app.errors import AppError, Busy, DatabaseAway, DiskFull, FolderUnusable, StoreAway
from app.jobs.database import check_writable
from app.jobs.store import JobStore
from app.settings import Settings
from app.storage import Storage, check_folder

ANSWER_S = 3.0
"""Less than the 4 s after which the container's health check gives up."""
LOCK_S = 2
KEPT_S = 1.0
GOOD = "ok"


@dataclass(slots=True)
class Readiness:
    """Makes the checks, and keeps what they found for a second: anybody may ask, and often.

    A check that hangs (a disk or a network that never answers) occupies one thread and is not made again
    before it ends; meanwhile its answer is the code that it stands for.
    """

    store: JobStore
    storage: Storage
    settings: Settings
    _found: Mapping[str, str] = field(default_factory=dict)
    _made_at_s: float = -KEPT_S
    _busy: set[str] = field(default_factory=set)
    _turn: anyio.Lock = field(default_factory=anyio.Lock)

    async def check(self) -> Mapping[str, str]:
        """Give each check by its name, with ``ok`` or the code of what is wrong."""
        async with self._turn:
            if time.monotonic() - self._made_at_s >= KEPT_S:
                self._found = await self._ask_all()
                self._made_at_s = time.monotonic()
            return self._found

    async def _ask_all(self) -> Mapping[str, str]:
        checks = self._list_checks()
        found = {name: trouble.code for name, (_, trouble) in checks.items()}
        async with anyio.create_task_group() as tasks:
            for name, (check, trouble) in checks.items():
                tasks.start_soon(self._ask, found, name, check, trouble)
        return found

    def _list_checks(self) -> Mapping[str, tuple[Callable[[], None], type[AppError]]]:
        """Give each check with what it means that it fails without a code, or does not end."""
        settings = self.settings
        return {
            "folder": (lambda: check_folder(settings.data_dir), FolderUnusable),
            "disk": (lambda: self.storage.check_space(0, settings.min_free_bytes), DiskFull),
            "database": (lambda: check_writable(settings.database_url, LOCK_S), DatabaseAway),
            "store": (self.storage.prepare, StoreAway),
            "queue": (self._check_queue, DatabaseAway),
        }

    async def _ask(
        self, found: dict[str, str], name: str, check: Callable[[], None], trouble: type[AppError]
    ) -> None:
        if name in self._busy:
            return
        self._busy.add(name)
        with anyio.move_on_after(ANSWER_S):
            found[name] = await anyio.to_thread.run_sync(
                self._make, name, check, trouble, abandon_on_cancel=True, limiter=anyio.CapacityLimiter(1)
            )

    def _make(self, name: str, check: Callable[[], None], trouble: type[AppError]) -> str:
        try:
            check()
        except AppError as refusal:
            return refusal.code
        except (OSError, SQLAlchemyError):
            return trouble.code
        finally:
            self._busy.discard(name)
        return GOOD

    def _check_queue(self) -> None:
        if self.store.count_waiting() >= self.settings.max_queued:
            raise Busy
