"""What every route works with, put together once in :mod:`app.main`."""

from dataclasses import dataclass
from typing import Annotated, cast

from fastapi import Depends, Request

from app.api.readiness import Readiness
from app.decoded import DecodedCache
from app.incoming import Incoming, Turns
from app.jobs.batches import BatchStore
from app.jobs.inspecting import Inspector
from app.jobs.kept_answers import AnswerStore
from app.jobs.queueing import WayIn
from app.jobs.recordings import RecordingStore
from app.jobs.side_files import SideWriter
from app.jobs.store import JobStore
from app.jobs.uploads import UploadStore
from app.jobs.webhooks import WebhookStore
from app.report.wording import Language
from app.settings import Settings
from app.storage import Storage, name_once
from app.stores import open_storage

LANGUAGE_COOKIE = "acromion_lang"


@dataclass(slots=True)
class Quarantine:
    """What lay among the recordings and is not known, as it was last looked up."""

    names: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Services:
    """The database, the folders and the settings of this server."""

    store: JobStore
    storage: Storage
    settings: Settings
    recordings: RecordingStore
    uploads: UploadStore
    incoming: Incoming
    inspector: Inspector
    batches: BatchStore
    answers: AnswerStore
    webhooks: WebhookStore
    turns: Turns
    side_files: SideWriter
    quarantine: Quarantine
    cache: DecodedCache
    readiness: Readiness


def open_services(settings: Settings) -> Services:
    """Open database and folders."""
    storage = open_storage(settings)
    storage.prepare()
    store = JobStore(settings.database_url)
    store.check_belongs(storage.identify())
    rows = (store.engine, store.reader)
    incoming = Incoming(settings.data_dir / "incoming")
    inspector = Inspector(settings, settings.data_dir / "inspections")
    incoming.prepare()
    inspector.prepare()
    return Services(
        store=store,
        storage=storage,
        settings=settings,
        recordings=RecordingStore(*rows),
        uploads=UploadStore(*rows),
        incoming=incoming,
        inspector=inspector,
        batches=BatchStore(*rows),
        answers=AnswerStore(*rows, name_once(settings.data_dir / "server.id", "server")),
        webhooks=WebhookStore(*rows),
        turns=Turns(settings.max_uploads_at_once),
        side_files=SideWriter(*rows, storage),
        quarantine=Quarantine(),
        cache=DecodedCache(settings.data_dir / "cache", settings.max_cache_bytes),
        readiness=Readiness(store, storage, settings),
    )


def find_services(request: Request) -> Services:
    """Give the services of the application that answers."""
    return cast("Services", request.app.state.services)


def choose_language(request: Request) -> Language:
    """Choose French or English: ``?lang=``, else the choice made on the page, else the browser's wish."""
    chosen = request.query_params.get("lang") or request.cookies.get(LANGUAGE_COOKIE)
    if chosen in ("en", "fr"):
        return "fr" if chosen == "fr" else "en"
    return _prefer(request.headers.get("accept-language", ""))


def _prefer(header: str) -> Language:
    """Read ``Accept-Language`` (RFC 9110, 12.5.4); English where neither is asked for."""
    weights = {"en": 0.0, "fr": 0.0}
    for part in header.split(","):
        tag, _, parameters = part.strip().partition(";")
        language = tag.strip().lower().partition("-")[0]
        if language in weights:
            weights[language] = max(weights[language], _read_weight(parameters))
    return "fr" if weights["fr"] > weights["en"] else "en"


def _read_weight(parameters: str) -> float:
    name, _, value = parameters.strip().partition("=")
    try:
        return float(value) if name.strip() == "q" else 1.0
    except ValueError:
        return 0.0


UsedServices = Annotated[Services, Depends(find_services)]
UsedLanguage = Annotated[Language, Depends(choose_language)]


def tell_way_in(request: Request) -> WayIn:
    """Tell a person at the page (the browser says so, and the guard has checked it) from a script."""
    from_page = request.headers.get("origin") or request.headers.get("sec-fetch-site") == "same-origin"
    return "web" if from_page else "api"


UsedWayIn = Annotated[WayIn, Depends(tell_way_in)]
