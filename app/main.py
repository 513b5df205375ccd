"""Puts the application together, and serves it."""

import asyncio
import logging
import signal
import socket
import threading
import time
import webbrowser
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import ExitStack, asynccontextmanager, contextmanager
from importlib.util import find_spec
from pathlib import Path

import uvicorn
from fastapi import FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.routing import APIRoute
from sqlalchemy.exc import DBAPIError
from starlette.exceptions import HTTPException
from starlette.routing import Match

from app.access.accounts import AccountStore
from app.access.gate import Gate, open_gate
from app.access.logins import Logins
from app.api.about import router as about_routes
from app.api.health import router as health_routes
from app.api.housekeeping import keep_house, reconcile, write_side_files
from app.api.library.analyses import router as analysis_routes
from app.api.library.batches import router as batch_routes
from app.api.library.mappings import router as mapping_routes
from app.api.library.recordings import router as recording_routes
from app.api.library.uploads import router as upload_routes
from app.api.live import router as live_routes
from app.api.live_library import take_in_cut
from app.api.middleware.access import CHECKED, Access
from app.api.middleware.echoes import hide_address
from app.api.middleware.guard import SECURITY_HEADERS, Guard, make_timeout_protocol
from app.api.middleware.plain_text import PlainText
from app.api.middleware.problems import Refusal, respond_to_refusal, translate_error
from app.api.pairs import router as pair_routes
from app.api.tokens import router as token_routes
from app.api.trust import router as trust_routes
from app.api.validations import router as validation_routes
from app.api.webhooks import router as webhook_routes
from app.errors import (
    AppError,
    DatabaseAway,
    DatabaseDamaged,
    DiskFull,
    NotConfirmed,
    NotHere,
    NotPermitted,
    NotSignedIn,
    PortTaken,
    RecordedProblem,
    ResultDamaged,
    WrongVerb,
)
from app.intake import FolderWatch, Intake
from app.jobs.database.connect import (
    bring_up_to_date,
    check_whole,
    classify_error,
    find_database_file,
    translate_start_errors,
)
from app.jobs.processes.pool import WorkerPool
from app.jobs.store import JobStore
from app.logs import start_logging
from app.services import Services, find_services, open_services
from app.settings import Settings
from app.start_checks import (
    SOCKET_PREFIX,
    check_certificate,
    check_exposure,
    check_host_names,
    check_passwords,
)
from app.storage.open import load_extra, open_storage
from app.storage.permissions import make_folder, restrict_permissions
from app.storage.store import FolderLock, check_folder
from app.upkeep.account_rows import warn_of_lost_secret
from app.upkeep.recover import check_known
from app.version import software_version
from app.web.account import router as account_pages
from app.web.acts import router as act_routes
from app.web.api_docs import router as docs_routes
from app.web.batches import router as batch_pages
from app.web.example import router as example_routes
from app.web.help import router as help_routes
from app.web.library import router as library_routes
from app.web.live import router as live_page
from app.web.login import respond_with_confirmation, respond_with_login, respond_with_place
from app.web.login import router as login_routes
from app.web.pairs import router as pair_pages
from app.web.people import router as people_pages
from app.web.profile import router as profile_pages
from app.web.recording.analysis import respond_with_page
from app.web.recording.analysis import router as page_routes
from app.web.recording.columns import router as column_routes
from app.web.recording.conclusion import router as conclusion_routes
from app.web.recording.day import router as day_routes
from app.web.rendering import FOLDER, Assets, find_assets
from app.web.rendering import router as asset_routes
from app.web.reports import router as report_pages
from app.web.trust import router as trust_pages
from app.web.validations import router as validation_pages
from fusion.errors import FusionError

ROUTES = (
    upload_routes,
    recording_routes,
    analysis_routes,
    batch_routes,
    webhook_routes,
    validation_routes,
    mapping_routes,
    pair_routes,
    about_routes,
    health_routes,
    live_routes,
    trust_routes,
    token_routes,
)
PAGES = (
    page_routes,
    report_pages,
    batch_pages,
    day_routes,
    conclusion_routes,
    library_routes,
    act_routes,
    pair_pages,
    profile_pages,
    column_routes,
    help_routes,
    docs_routes,
    example_routes,
    asset_routes,
    validation_pages,
    live_page,
    login_routes,
    trust_pages,
    account_pages,
    people_pages,
)
MAX_HEADER_BYTES = 64 * 1024
MAX_LIVE_MESSAGE_BYTES = 256 * 1024
GRACE_S = 3
BACKLOG = 2048
TLS_CIPHERS = "ECDHE+AESGCM:ECDHE+CHACHA20"
"""Of TLS 1.2; uvicorn's own choice takes in those without forward secrecy."""
STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM)

logger = logging.getLogger(__name__)


def create_app(settings: Settings, clock: Callable[[], float] = time.time) -> FastAPI:
    """Build the application of database, folder, API and pages; logins end by ``clock``."""
    application = FastAPI(
        title="Acromion",
        version=software_version(),
        openapi_url=None,
        docs_url=None,
        redoc_url=None,
        generate_unique_id_function=_find_operation_id,
        lifespan=_live,
    )
    services = application.state.services = open_services(settings)
    accounts = AccountStore(settings, clock, services.store.engine)
    try:
        accounts.check_kept()
        warn_of_lost_secret(services.store.reader, accounts.secrets)
    except BaseException:
        services.store.close()
        raise
    gate = application.state.gate = open_gate(settings, accounts)
    application.state.logins = Logins(accounts, settings)
    for routes in (*ROUTES, *PAGES):
        application.include_router(routes, dependencies=CHECKED)
    application.mount(find_assets(), Assets(directory=FOLDER))
    _add_error_handlers(application)
    application.add_middleware(Access, gate=gate, respond=respond_to_error)
    application.add_middleware(PlainText, respond=respond_to_error)
    application.add_middleware(
        Guard,
        respond=respond_to_error,
        host_names=settings.host_names,
        min_rate_bytes_per_s=settings.min_body_rate_bytes_per_s,
        body_timeout_s=settings.body_patience_s,
    )
    return application


def serve(settings: Settings, open_browser: bool = False) -> None:  # noqa: FBT001, FBT002
    """Serve pages and API on loopback, with workers, until interrupted.

    Raises
    ------
    ForeignAddress, BadParameter, ExamplePassword, PortTaken, FolderTaken, FolderUnusable, WrongSchema,
    DatabaseDamaged, DatabaseLocked, DatabaseAway, StoreAway, DiskFull, UnknownRecordings
    """
    check_certificate(settings)
    check_host_names(settings)
    check_passwords(settings)
    start_logging()
    with translate_start_errors(settings):
        check_exposure(settings, has_accounts=AccountStore(settings).exist())
    listener = listen(settings)
    application = _prepare(settings, listener)
    address = _write_address(settings, listener)
    opened = address + _make_way_in(application.state.gate)
    pool = WorkerPool(settings)
    pool.start()
    watch = _watch_folder(application, settings)
    logger.info("Acromion is at %s (data in %s)", address, settings.data_dir)
    if open_browser:
        threading.Timer(1.0, webbrowser.open, (opened,)).start()
    elif opened != address:
        logger.info("open it once by %s", opened)
    try:
        _Server(configure_server(application, settings)).run(sockets=[listener])
    finally:
        if watch is not None:
            watch.stop()
        pool.stop()


def _prepare(settings: Settings, listener: socket.socket) -> FastAPI:
    """Prepare the database, and build the application; the socket is closed where that fails."""
    try:
        with translate_start_errors(settings):
            _prepare_database(settings)
            return create_app(settings)
    except BaseException:
        listener.close()
        raise


def _make_way_in(gate: Gate) -> str:
    """Make the part of the address by which a browser gets in once; "" where none is needed."""
    if gate.secret is None or gate.needs_accounts:
        return ""
    return f"login/once/{gate.secret.make_address()}"


def _watch_folder(application: FastAPI, settings: Settings) -> FolderWatch | None:
    if settings.watch_dir is None:
        return None
    services: Services = application.state.services
    watch = FolderWatch(Intake(services.store, services.storage, settings), settings.watch_dir)
    watch.start()
    return watch


def _prepare_database(settings: Settings) -> None:
    """Bring the tables up to date while no other server works in the folder, and wake who waits for work."""
    make_folder(settings.data_dir)
    lock = FolderLock(settings.data_dir)
    try:
        check_folder(settings.data_dir)
        file = find_database_file(settings.database_url)
        restrict_permissions(settings.data_dir, Path(file) if file else None)
        check_whole(settings.database_url)
        bring_up_to_date(settings)
        _check_recordings(settings)
    finally:
        lock.release()
    if settings.engine == "procrastinate":
        load_extra("app.jobs.processes.cluster").install(settings.database_url)


def _check_recordings(settings: Settings) -> None:
    """Refuse to start over recordings that the database does not know."""
    storage = open_storage(settings)
    storage.prepare()
    store = JobStore(settings)
    try:
        check_known(store, storage)
    finally:
        store.close()


def respond_to_error(request: Request, error: Exception) -> Response:
    """Respond to any refusal or bug: with a problem document under ``/api``, a page elsewhere."""
    request = hide_address(request)
    refusal = (
        _translate_database_error(request, error)
        if isinstance(error, DBAPIError)
        else translate_error(request, error)
    )
    if isinstance(refusal, WrongVerb):
        refusal = WrongVerb(method=request.method, allowed=", ".join(_find_methods(request)))
    path = request.url.path.removeprefix(request.scope.get("root_path", ""))
    led = _lead_on(request, refusal, path)
    if led is not None:
        return led
    outside = path.startswith(("/api", "/healthz", "/readyz", "/metrics"))
    is_page = not outside or _is_read_by_person(request, refusal)
    response = respond_with_page(request, refusal) if is_page else respond_to_refusal(request, refusal)
    response.headers.update(SECURITY_HEADERS)  # the response to a bug does not pass the guard
    return response


def _lead_on(request: Request, refusal: Refusal, path: str) -> Response | None:
    """Lead a browser on to where it logs in, gives the password again, or may go; None for any other."""
    is_opened = _is_opened_by_person(request, path)
    if isinstance(refusal, NotSignedIn) and is_opened:
        return respond_with_login(request)
    if isinstance(refusal, NotConfirmed) and _is_sent_by_person(request):
        return respond_with_confirmation(request)
    if isinstance(refusal, NotPermitted) and is_opened and path == "/":
        return respond_with_place(request)
    return None


def _is_opened_by_person(request: Request, path: str) -> bool:
    """Whether a browser opens a page or a file by itself."""
    is_read = request.method in ("GET", "HEAD")
    return is_read and _is_sent_by_person(request) and not path.startswith("/login")


def _is_sent_by_person(request: Request) -> bool:
    """Whether a link or a form asks; a script of a page says that it does."""
    is_page = request.headers.get("sec-fetch-mode", "navigate") == "navigate"
    return is_page and "text/html" in request.headers.get("accept", "")


def _is_read_by_person(request: Request, refusal: Refusal) -> bool:
    """Whether a browser has opened a file that is damaged or in the trash: its page offers what helps."""
    return isinstance(refusal, ResultDamaged | NotHere) and "text/html" in request.headers.get("accept", "")


def _find_methods(request: Request) -> list[str]:
    """Give every method of the address; the framework names only those of the first route it finds."""
    known = (route for routes in (*ROUTES, page_routes) for route in routes.routes)
    here = (route for route in known if route.matches(request.scope)[0] is not Match.NONE)
    return sorted({method for route in here for method in getattr(route, "methods", None) or ()})


def _translate_database_error(request: Request, error: DBAPIError) -> Refusal:
    """Tell apart a full disk, a damaged database, one that does not answer, and a bug."""
    refusal = classify_error(error, find_services(request).settings.database_url)
    if refusal is None:
        return translate_error(request, error)
    if isinstance(refusal, DiskFull):
        return refusal
    logger.error("the database does not answer: %s", error.orig)
    return DatabaseDamaged() if isinstance(refusal, DatabaseDamaged) else DatabaseAway()


@asynccontextmanager
async def _live(application: FastAPI) -> AsyncIterator[None]:
    """Look after the server while it runs; first repair what a crash has left."""
    services: Services = application.state.services
    with ExitStack() as stack:
        stack.callback(services.store.close)
        stack.callback(prepare_house(services).release)
        house = asyncio.create_task(keep_house(services))
        try:
            yield
        finally:
            house.cancel()
            await asyncio.gather(house, return_exceptions=True)
            if services.live.made is not None:
                await asyncio.to_thread(services.live.made.close)
            await asyncio.to_thread(write_side_files, services)


def prepare_house(services: Services) -> FolderLock:
    """Lock the data folder, and repair what a crash has left."""
    lock = FolderLock(services.storage.root)
    try:
        reconcile(services)
        services.inspector.sweep()
        services.pairs.sweep()
        _report_cut(services)
    except BaseException:
        lock.release()
        raise
    return lock


def _report_cut(services: Services) -> None:
    count = take_in_cut(services)
    if count:
        logger.warning(
            "live sessions cut off by the end of the server: %d; of each at most 2 s are lost", count
        )


def _add_error_handlers(application: FastAPI) -> None:
    for kind in (FusionError, AppError, RecordedProblem, RequestValidationError, HTTPException, Exception):
        application.add_exception_handler(kind, respond_to_error)


def _find_operation_id(route: APIRoute) -> str:
    return route.name


def listen(settings: Settings) -> socket.socket:
    """Open the socket that callers connect to.

    Raises
    ------
    PortTaken
    """
    if settings.host.startswith(SOCKET_PREFIX):
        return _listen_at_socket(Path(settings.host.removeprefix(SOCKET_PREFIX)), settings)
    family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
    # asyncio sends answers at once (TCP_NODELAY) only where the protocol is named; else each waits 40 ms
    listener = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((settings.host, settings.port))
        listener.listen(BACKLOG)  # so that whoever reads our address may connect at once
    except OSError as error:
        listener.close()
        raise PortTaken(host=settings.host, port=settings.port) from error
    return listener


def _listen_at_socket(path: Path, settings: Settings) -> socket.socket:
    """Listen at a socket of the file system, which its owner and group may open: a proxy's user."""
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        path.unlink(missing_ok=True)
        listener.bind(str(path))
        path.chmod(0o660)
        listener.listen(BACKLOG)
    except OSError as error:
        listener.close()
        raise PortTaken(host=settings.host, port=settings.port) from error
    return listener


def configure_server(application: FastAPI, settings: Settings) -> uvicorn.Config:
    """Set the limits that uvicorn leaves open: size and time of a request's header."""
    return uvicorn.Config(
        application,
        root_path=settings.root_path.rstrip("/"),
        ssl_certfile=settings.tls_cert,
        ssl_keyfile=settings.tls_key,
        ssl_ciphers=TLS_CIPHERS,
        http=make_timeout_protocol(settings.header_patience_s),
        ws="websockets-sansio" if find_spec("websockets") else "none",
        ws_max_size=MAX_LIVE_MESSAGE_BYTES,
        ws_per_message_deflate=False,
        h11_max_incomplete_event_size=MAX_HEADER_BYTES,
        timeout_graceful_shutdown=GRACE_S,
        server_header=False,
        proxy_headers=False,  # middleware/callers.py reads what a proxy says, only from the one that is set
        access_log=False,
        log_config=None,
    )


class _Server(uvicorn.Server):
    """Returns when it is stopped, so that we can tidy up (uvicorn's own raises the signal again)."""

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        before = {number: signal.signal(number, self.handle_exit) for number in STOP_SIGNALS}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)


def _write_address(settings: Settings, listener: socket.socket) -> str:
    scheme = "https" if settings.tls_cert else "http"
    return f"{scheme}://{_write_place(settings, listener)}/"


def _write_place(settings: Settings, listener: socket.socket) -> str:
    if settings.host.startswith(SOCKET_PREFIX):
        return settings.host
    host = f"[{settings.host}]" if ":" in settings.host else settings.host
    return f"{host}:{listener.getsockname()[1]}"
