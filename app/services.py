"""The stores, folders and settings that all routes share."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, cast

import anyio
import anyio.to_thread
from fastapi import Depends, Request
from sqlalchemy.exc import SQLAlchemyError
from starlette.requests import HTTPConnection

from acromion.app.accounts.subjects import Subject
from acromion.app.analysis.inspecting import Inspector
from acromion.app.errors import AppError, Busy, DatabaseAway, DiskFull, FolderUnusable, StoreAway
from acromion.app.library.batches import BatchStore
from acromion.app.library.claims import WayIn
from acromion.app.library.database.connect import check_writable
from acromion.app.library.drafts import DraftStore
from acromion.app.library.governance import AggregateStore, ReleaseStore, RetentionStore
from acromion.app.library.jobs import JobStore
from acromion.app.library.listing import SavedViews
from acromion.app.library.mappings import MappingStore
from acromion.app.library.recordings import RecordingStore, UploadStore
from acromion.app.library.report_cache import PairReports
from acromion.app.library.results import ResultReader
from acromion.app.library.side_files import SideWriter
from acromion.app.library.webhooks import WebhookStore
from acromion.app.live.hub import LiveHub
from acromion.app.report.words.wording import EVERY_LANGUAGE, Language
from acromion.app.settings import Settings
from acromion.app.store.decoded import DecodedCache
from acromion.app.store.folder import Storage, check_folder, open_storage
from acromion.app.store.incoming import Incoming, UploadSlots

# Readiness: each dependency of an upload is checked separately and within a time limit.


CHECK_LIMIT_S = 3.0
"""Less than the 4 s after which the container's health check gives up."""
LOCK_S = 2
KEPT_S = 1.0
GOOD = "ok"


@dataclass(slots=True)
class Readiness:
    """Runs the checks and caches their result for a second, because anyone may request it often.

    A check that hangs (a disk or a network that never responds) occupies one thread and is not started again
    before it ends; in the meantime its result is its error code.
    """

    store: JobStore
    storage: Storage
    settings: Settings
    _found: Mapping[str, str] = field(default_factory=dict)
    _made_at_s: float = -KEPT_S
    _busy: set[str] = field(default_factory=set)
    _turn: anyio.Lock = field(default_factory=anyio.Lock)

    async def check(self) -> Mapping[str, str]:
        """Return the result of each check by name: ``ok`` or an error code."""
        settings = self.settings
        # each with the error for a failure without a code or for a check that does not end
        checks: Mapping[str, tuple[Callable[[], None], type[AppError]]] = {
            "folder": (lambda: check_folder(settings.data_dir), FolderUnusable),
            "disk": (lambda: self.storage.check_space(0, settings.min_free_bytes), DiskFull),
            "database": (lambda: check_writable(settings.database_url, LOCK_S), DatabaseAway),
            "store": (self.storage.prepare, StoreAway),
            "queue": (self._check_queue, DatabaseAway),
        }
        async with self._turn:
            if time.monotonic() - self._made_at_s >= KEPT_S:
                found = {name: trouble.code for name, (_, trouble) in checks.items()}
                async with anyio.create_task_group() as tasks:
                    for name, (check, trouble) in checks.items():
                        if name not in self._busy:
                            tasks.start_soon(self._run_check, found, name, check, trouble)
                self._found, self._made_at_s = found, time.monotonic()
            return self._found

    async def _run_check(
        self, found: dict[str, str], name: str, check: Callable[[], None], trouble: type[AppError]
    ) -> None:
        def run() -> str:
            try:
                check()
            except AppError as refusal:
                return refusal.code
            except (OSError, SQLAlchemyError):
                return trouble.code
            finally:
                self._busy.discard(name)
            return GOOD

        self._busy.add(name)
        with anyio.move_on_after(CHECK_LIMIT_S):
            alone = anyio.CapacityLimiter(1)
            found[name] = await anyio.to_thread.run_sync(run, abandon_on_cancel=True, limiter=alone)

    def _check_queue(self) -> None:
        if self.store.count_waiting() >= self.settings.max_queued:
            raise Busy


LANGUAGE_COOKIE = "acromion_lang"


class Services:
    """The open database, folders and settings of this server."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.storage = storage = open_storage(settings)
        storage.prepare()
        self.store = store = JobStore(settings)
        try:
            store.check_belongs(storage.identify())
        except BaseException:
            store.close()
            raise
        self.incoming = Incoming(settings.data_dir / "incoming")
        self.incoming.prepare()
        self.inspector = Inspector(settings, settings.data_dir / "inspections")
        self.inspector.prepare()
        rows = (store.engine, store.reader)
        self.recordings, self.uploads = RecordingStore(*rows), UploadStore(*rows)
        self.results = ResultReader(store, storage)
        self.pairs = PairReports(settings, self.results, settings.data_dir / "cache" / "pairs")
        self.batches, self.mappings = BatchStore(*rows), MappingStore(*rows)
        self.views, self.side_files = SavedViews(*rows, storage), SideWriter(*rows, storage)
        self.webhooks, self.releases = WebhookStore(*rows), ReleaseStore(*rows)
        self.drafts = DraftStore(*rows)
        self.retention, self.aggregates = RetentionStore(*rows), AggregateStore(*rows)
        self.upload_slots = UploadSlots(settings.max_uploads_at_once)
        self.quarantined: tuple[str, ...] = ()
        """Unknown entries among the recordings, from the last check."""
        self.cache = DecodedCache(settings.data_dir / "cache", settings.max_cache_bytes)
        self.readiness = Readiness(store, storage, settings)
        self.live: LiveHub
        """The live sessions; the application sets it, because they store recordings with these services."""


SUBJECT = "acromion.subject"
"""Key of the caller's subject in the scope of a request."""


def find_services(connection: HTTPConnection) -> Services:
    """Return the services of the application that handles the request."""
    return cast("Services", connection.scope["app"].state.services)


def choose_language(request: Request) -> Language:
    """Return the language of ``?lang=``, else of the page's cookie, else of the browser."""
    chosen = request.query_params.get("lang") or request.cookies.get(LANGUAGE_COOKIE)
    known = next((language for language in EVERY_LANGUAGE if language == chosen), None)
    return known or prefer_language(request, EVERY_LANGUAGE)


def prefer_language(request: Request, among: Sequence[Language]) -> Language:
    """Return the browser's preferred language by ``Accept-Language`` (RFC 9110, 12.5.4), else the first.

    "fr-CA" is chosen only if the browser names it; any other French is "fr".
    """
    weights = dict.fromkeys(among, 0.0)
    for part in request.headers.get("accept-language", "").split(","):
        tag, _, parameters = part.strip().partition(";")
        place = tag.strip().lower()
        asked = next(
            (language for language in among if language.lower() in (place, place.partition("-")[0])), None
        )
        if place == "fr-ca" and "fr-CA" in weights:
            asked = "fr-CA"
        if asked is None:
            continue
        name, _, value = parameters.strip().partition("=")
        try:
            weight = float(value) if name.strip() == "q" else 1.0
        except ValueError:
            weight = 0.0
        weights[asked] = max(weights[asked], weight)
    return max(among, key=lambda language: weights[language])


UsedServices = Annotated[Services, Depends(find_services)]
UsedLanguage = Annotated[Language, Depends(choose_language)]


def get_request_origin(request: Request) -> WayIn:
    """Return whether the page ("web", which has priority) or a script ("api") sends a recording.

    A session belongs to a page and a token to a script. On a server without accounts the browser's headers
    decide, which the guard has checked.
    """
    subject: Subject | None = request.scope.get(SUBJECT)
    if subject is not None and subject.kind != "machine":
        return "web" if subject.kind == "person" else "api"
    from_page = request.headers.get("origin") or request.headers.get("sec-fetch-site") == "same-origin"
    return "web" if from_page else "api"


UsedWayIn = Annotated[WayIn, Depends(get_request_origin)]
