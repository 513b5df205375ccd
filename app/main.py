"""Puts the application together, and serves it."""

import logging
import signal
import socket
import threading
import webbrowser
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from ipaddress import ip_address
from pathlib import Path

import uvicorn
from fastapi import FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from fastapi.routing import APIRoute
from fastapi.staticfiles import StaticFiles
from sqlalchemy.exc import OperationalError
from starlette.exceptions import HTTPException

import app.web
from app.api.guard import SECURITY_HEADERS, Guard
from app.api.patience import make_patient_protocol
from app.api.problems import answer_refusal, name_refusal
from app.api.routes import router as api_routes
from app.api.services import Services
from app.api.validations import router as validation_routes
from app.errors import AppError, DiskFull, ForeignAddress, PortTaken
from app.jobs.pool import WorkerPool
from app.jobs.store import JobStore
from app.settings import Settings
from app.storage import FolderLock, Storage
from app.version import software_version
from app.web.routes import answer_with_page
from app.web.routes import router as page_routes
from app.web.validations import router as validation_pages
from fusion.errors import FusionError

MAX_HEADER_BYTES = 64 * 1024
GRACE_S = 3
STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM)

logger = logging.getLogger(__name__)


def create_app(settings: Settings) -> FastAPI:
    """Put database, folder, API and pages together."""
    storage = Storage(settings.data_dir)
    storage.prepare()
    application = FastAPI(
        title="Acromion",
        version=software_version(),
        openapi_url="/api/v1/openapi.json",
        docs_url=None,
        redoc_url=None,
        generate_unique_id_function=_name_operation,
        lifespan=_live,
    )
    application.state.services = Services(JobStore(settings.database_url), storage, settings)
    application.include_router(api_routes)
    application.include_router(validation_routes)
    application.include_router(page_routes)
    application.include_router(validation_pages)
    _add_health(application)
    application.mount("/static", StaticFiles(directory=Path(app.web.__path__[0]) / "static"))
    _add_refusals(application)
    rate, patience_s = settings.min_body_rate_bytes_per_s, settings.body_patience_s
    application.add_middleware(Guard, answer=answer_error, min_rate_bytes_per_s=rate, patience_s=patience_s)
    return application


def serve(settings: Settings, open_browser: bool = False) -> None:  # noqa: FBT001, FBT002
    """Serve pages and API on loopback, with workers, until interrupted.

    Raises
    ------
    ForeignAddress, PortTaken, FolderTaken
    """
    check_loopback(settings.host)
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(levelname)s %(message)s")
    listener = _listen(settings)
    application = create_app(settings)
    address = f"http://{_write_host(settings.host)}:{listener.getsockname()[1]}/"
    pool = WorkerPool(settings)
    pool.start()
    logger.info("Acromion is at %s (data in %s)", address, settings.data_dir)
    if open_browser:
        threading.Timer(1.0, webbrowser.open, (address,)).start()
    try:
        _Server(configure_server(application, settings)).run(sockets=[listener])
    finally:
        pool.stop()


def check_loopback(host: str) -> None:
    """Refuse any address but this computer's own: there are no accounts yet.

    Raises
    ------
    ForeignAddress
    """
    try:
        own = host == "localhost" or ip_address(host).is_loopback
    except ValueError:
        own = False
    if not own:
        raise ForeignAddress(host=host)


def answer_error(request: Request, error: Exception) -> Response:
    """Answer any refusal or bug: a problem document under ``/api``, a page elsewhere."""
    refusal = DiskFull() if _is_full(error) else name_refusal(error)
    outside = request.url.path.startswith(("/api", "/healthz", "/readyz"))
    response = answer_refusal(request, refusal) if outside else answer_with_page(request, refusal)
    response.headers.update(SECURITY_HEADERS)  # the answer to a bug does not pass the guard
    return response


def _is_full(error: Exception) -> bool:
    return isinstance(error, OperationalError) and "disk is full" in str(error)


@asynccontextmanager
async def _live(application: FastAPI) -> AsyncIterator[None]:
    """Hold the folder while we serve, and sweep first what a crash has left."""
    services: Services = application.state.services
    lock = FolderLock(services.storage.root)
    swept = services.storage.sweep(services.store.list_recordings(), services.store.list_attempts())
    if swept:
        logger.info("swept %d files of interrupted uploads and attempts", swept)
    try:
        yield
    finally:
        lock.release()
        services.store.close()


def _add_refusals(application: FastAPI) -> None:
    for kind in (FusionError, AppError, RequestValidationError, HTTPException, Exception):
        application.add_exception_handler(kind, answer_error)


def _add_health(application: FastAPI) -> None:
    services: Services = application.state.services

    @application.get("/healthz", include_in_schema=False)
    def healthz() -> dict[str, str]:
        """Say that the process answers."""
        return {"status": "ok"}

    @application.get("/readyz", include_in_schema=False)
    def readyz() -> JSONResponse:
        """Say whether work can be taken: the database answers and the disk has room."""
        counts = {state.value: number for state, number in services.store.count_states().items()}
        services.storage.check_space(0, services.settings.min_free_bytes)
        return JSONResponse({"status": "ok", "analyses": counts})


def _name_operation(route: APIRoute) -> str:
    return route.name


def _listen(settings: Settings) -> socket.socket:
    family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((settings.host, settings.port))
    except OSError as error:
        listener.close()
        raise PortTaken(host=settings.host, port=settings.port) from error
    return listener


def configure_server(application: FastAPI, settings: Settings) -> uvicorn.Config:
    """Choose the limits that uvicorn leaves open: size and time of a request's head."""
    return uvicorn.Config(
        application,
        http=make_patient_protocol(settings.header_patience_s),
        ws="none",
        h11_max_incomplete_event_size=MAX_HEADER_BYTES,
        timeout_graceful_shutdown=GRACE_S,
        server_header=False,
        access_log=False,
        log_config=None,
    )


class _Server(uvicorn.Server):
    """Ends when asked to, and lets us tidy up after it (uvicorn's own would raise the signal again)."""

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        before = {number: signal.signal(number, self.handle_exit) for number in STOP_SIGNALS}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)


def _write_host(host: str) -> str:
    return f"[{host}]" if ":" in host else host
