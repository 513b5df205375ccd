"""Build the application and serve it."""

import asyncio
import ctypes
import functools
import logging
import signal
import socket
import sys
import threading
import time
import webbrowser
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import ExitStack, asynccontextmanager, closing, contextmanager, suppress
from importlib.util import find_spec
from pathlib import Path

import uvicorn
from fastapi import APIRouter, FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from sqlalchemy.exc import DBAPIError
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect
from starlette.routing import BaseRoute, Match

from acromion.app.accounts.accounts import AccountStore
from acromion.app.accounts.gate import Gate, read_or_create_secret
from acromion.app.accounts.sign_in import SignIn
from acromion.app.errors import (
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
from acromion.app.http.api import about, live, pairs, trust, validations, webhooks
from acromion.app.http.api.housekeeping import reconcile, run_housekeeping, write_side_files
from acromion.app.http.api.library import analyses, batches, mappings, recordings, uploads
from acromion.app.http.middleware.access import CHECKED, Access
from acromion.app.http.middleware.guard import SECURITY_HEADERS, Guard, PlainText, build_timeout_protocol
from acromion.app.http.middleware.problems import Refusal, hide_address, respond_to_refusal, translate_error
from acromion.app.http.pages import account, help, library, login, persons, rendering  # noqa: A004
from acromion.app.http.pages import live as live_page
from acromion.app.http.pages import pairs as pair_pages
from acromion.app.http.pages import trust as trust_pages
from acromion.app.http.pages import validations as validation_pages
from acromion.app.http.pages.recording import analysis, columns, day, drafts, finish
from acromion.app.http.pages.rendering import FOLDER, Assets, get_assets_path
from acromion.app.intake import FolderWatch, Intake
from acromion.app.library.database.connect import (
    bring_up_to_date,
    check_whole,
    classify_error,
    find_database_file,
    translate_start_errors,
)
from acromion.app.library.jobs import JobStore
from acromion.app.live.hub import LiveHub
from acromion.app.logs import start_logging
from acromion.app.ops.place import warn_of_lost_secret
from acromion.app.ops.recover import check_known
from acromion.app.queue.pool import WorkerPool
from acromion.app.services import Services, find_services
from acromion.app.settings import Settings
from acromion.app.start_checks import (
    SOCKET_PREFIX,
    check_certificate,
    check_exposure,
    check_host_names,
    check_passwords,
)
from acromion.app.store.folder import FolderLock, check_folder, load_extra, open_storage
from acromion.app.store.permissions import create_file, make_folder, restrict_new_files, restrict_permissions
from acromion.app.store.reserve import free_reserve, keep_reserve
from acromion.app.version import software_version
from acromion.fusion.errors import FusionError

ROUTES = (
    *(module.router for module in (uploads, recordings, analyses, batches, webhooks, validations, mappings)),
    *(pairs.router, about.router, about.health_router, live.router, trust.router, trust.token_router),
)
PAGES = (
    *(module.router for module in (analysis, day, drafts, finish)),
    *(module.router for module in (library, persons, pair_pages, columns, help, rendering)),
    *(module.router for module in (validation_pages, live_page, login, trust_pages, account)),
)
MAX_HEADER_BYTES = 64 * 1024
MAX_LIVE_MESSAGE_BYTES = 256 * 1024
GRACE_S = 3
BACKLOG = 2048
M_ARENA_MAX, MOST_ARENAS = -8, 2
"""Option of glibc's mallopt, and its value."""
TLS_CIPHERS = "ECDHE+AESGCM:ECDHE+CHACHA20"
"""For TLS 1.2; uvicorn's default includes ciphers without forward secrecy."""
OPENER = "open.html"
STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM)

logger = logging.getLogger(__name__)


@functools.cache
def _build_routes() -> tuple[BaseRoute, ...]:
    """Return the routes of API and pages; cached because FastAPI prepares routes at first use."""
    router = APIRouter(generate_unique_id_function=lambda route: route.name)
    for routes in (*ROUTES, *PAGES):
        router.include_router(routes, dependencies=CHECKED)
    router.mount(get_assets_path(), Assets(directory=FOLDER))
    return tuple(router.routes)


def create_app(settings: Settings, clock: Callable[[], float] = time.time) -> FastAPI:
    """Build the application of database, folder, API and pages; sessions expire by ``clock``."""
    application = FastAPI(
        title="Acromion",
        version=software_version(),
        openapi_url=None,
        docs_url=None,
        redoc_url=None,
        lifespan=_live,
        routes=[*_build_routes()],
    )
    services = application.state.services = Services(settings)
    services.live = LiveHub(live.LiveLibrary(services))
    accounts = AccountStore(settings, clock, services.store.engine)
    try:
        accounts.check_kept()
        warn_of_lost_secret(services.store.reader, accounts.secrets)
    except BaseException:
        services.store.close()
        raise
    secret = None
    if not settings.no_secret:
        make_folder(settings.data_dir)
        secret = read_or_create_secret(settings.data_dir)
    gate = application.state.gate = Gate(secret, accounts)
    application.state.sign_in = SignIn(accounts, settings)
    refused = (FusionError, AppError, RecordedProblem, RequestValidationError, HTTPException)
    for kind in (*refused, ClientDisconnect, Exception):
        application.add_exception_handler(kind, respond_to_error)
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
    """Serve pages and API, with workers, until interrupted.

    Raises ForeignAddress, BadParameter, ExamplePassword, PortTaken, FolderTaken, FolderUnusable, WrongSchema,
    DatabaseDamaged, DatabaseLocked, DatabaseAway, StoreAway, DiskFull or UnknownRecordings.
    """
    limit_arenas()
    restrict_new_files()
    check_certificate(settings)
    check_host_names(settings)
    check_passwords(settings)
    start_logging()
    free_reserve(settings.data_dir)  # the first look at the database may write
    with translate_start_errors(settings):
        check_exposure(settings, has_accounts=AccountStore(settings).exist())
    listener = listen(settings)
    try:
        with translate_start_errors(settings):
            _prepare_database(settings)
            application = create_app(settings)
    except BaseException:
        listener.close()
        raise
    host = f"[{settings.host}]" if ":" in settings.host else settings.host
    is_socket = settings.host.startswith(SOCKET_PREFIX)
    place = settings.host if is_socket else f"{host}:{listener.getsockname()[1]}"
    address = f"{'https' if settings.tls_cert else 'http'}://{place}/"
    gate: Gate = application.state.gate
    secret = None if gate.needs_accounts else gate.secret
    pool = WorkerPool(settings)
    pool.start()
    services: Services = application.state.services
    watch = None
    if settings.watch_dir is not None:
        watch = FolderWatch(Intake(services.store, services.storage, settings), settings.watch_dir)
        watch.start()
    logger.info("Acromion is at %s (data in %s)", address, settings.data_dir)
    if secret is not None:
        logger.info("open it once by %slogin/once/%s", address, secret.make_address())
    opener = settings.data_dir / OPENER
    if open_browser:
        place = (
            address
            if secret is None
            else write_opener(opener, f"{address}login/once/{secret.make_address()}")
        )
        threading.Timer(1.0, webbrowser.open, (place,)).start()
    try:
        _Server(configure_server(application, settings)).run(sockets=[listener])
    finally:
        if watch is not None:
            watch.stop()
        pool.stop()
        opener.unlink(missing_ok=True)


def limit_arenas() -> None:
    """Limit glibc to two memory arenas; by default many threads have one each, which keeps its peak.

    Without it the server grows by some 60 MB within an hour of requests (``python -m benchmarks.soak``).
    """
    if sys.platform == "linux":
        with suppress(OSError, AttributeError):  # another C library
            ctypes.CDLL(None).mallopt(M_ARENA_MAX, MOST_ARENAS)


def write_opener(path: Path, address: str) -> str:
    """Return the URL of a file that leads a browser to an address.

    The command line of the browser then shows the file only: other users of the computer can read command
    lines, but not this file.
    """
    path.unlink(missing_ok=True)
    with create_file(path) as file:
        file.write(f'<!doctype html><meta http-equiv="refresh" content="0; url={address}">'.encode())
    return path.resolve().as_uri()


def _prepare_database(settings: Settings) -> None:
    """Upgrade the tables while no other server uses the folder, and notify waiting workers."""
    make_folder(settings.data_dir)
    lock = FolderLock(settings.data_dir)
    try:
        check_folder(settings.data_dir)
        file = find_database_file(settings.database_url)
        restrict_permissions(settings.data_dir, Path(file) if file else None)
        keep_reserve(settings.data_dir)
        check_whole(settings.database_url)
        bring_up_to_date(settings)
        storage = open_storage(settings)
        storage.prepare()
        with closing(JobStore(settings)) as store:
            check_known(store, storage)  # do not start if the database lacks stored recordings
    finally:
        lock.release()
    if settings.engine == "procrastinate":
        load_extra("acromion.app.queue.cluster").install(settings.database_url)


def respond_to_error(request: Request, error: Exception) -> Response:
    """Respond to a refusal or a bug: a problem document under ``/api``, a page elsewhere."""
    request = hide_address(request)
    refusal = _find_refusal(request, error)
    path = request.url.path.removeprefix(request.scope.get("root_path", ""))
    accepts_page = "text/html" in request.headers.get("accept", "")
    # A link or a form navigates to a page or a file; a script of a page sends another fetch mode.
    is_sent = accepts_page and request.headers.get("sec-fetch-mode", "navigate") == "navigate"
    is_opened = is_sent and request.method in ("GET", "HEAD") and not path.startswith("/login")
    if isinstance(refusal, NotSignedIn) and is_opened:
        return login.respond_with_sign_in(request)
    if isinstance(refusal, NotConfirmed) and is_sent:
        return login.respond_with_confirmation(request)
    if isinstance(refusal, NotPermitted) and is_opened and path == "/":
        return login.respond_with_permitted_page(request)
    is_page = not path.startswith(("/api", "/healthz", "/readyz", "/metrics"))
    if isinstance(refusal, ResultDamaged | NotHere):  # the error page offers the next step
        is_page = is_page or accepts_page
    response = (
        analysis.respond_with_page(request, refusal) if is_page else respond_to_refusal(request, refusal)
    )
    response.headers.update(SECURITY_HEADERS)  # the response to a bug bypasses the guard
    if isinstance(refusal, WrongVerb) and refusal.facts["allowed"]:
        response.headers["Allow"] = str(refusal.facts["allowed"])
    return response


def _find_refusal(request: Request, error: Exception) -> Refusal:
    """Distinguish a refusal, a full disk, a damaged or unreachable database, and a bug."""
    if isinstance(error, DBAPIError):
        trouble = classify_error(error, find_services(request).settings.database_url)
        if trouble is None or isinstance(trouble, DiskFull):
            return trouble or translate_error(request, error)
        logger.error("the database does not respond: %s", error.orig)
        return DatabaseDamaged() if isinstance(trouble, DatabaseDamaged) else DatabaseAway()
    refusal = translate_error(request, error)
    if not isinstance(refusal, WrongVerb):
        return refusal
    # all methods of the address; the framework lists only those of the first matching route
    known = (route for routes in (*ROUTES, *PAGES) for route in routes.routes)
    here = (route for route in known if route.matches(request.scope)[0] is not Match.NONE)
    methods = {method for route in here for method in getattr(route, "methods", None) or ()}
    return WrongVerb(method=request.method, allowed=", ".join(sorted(methods)))


@asynccontextmanager
async def _live(application: FastAPI) -> AsyncIterator[None]:
    """Run the background tasks of the server; first repair what a crash has left."""
    services: Services = application.state.services
    with ExitStack() as stack:
        stack.callback(services.store.close)
        stack.callback(FolderLock(services.storage.root).release)
        reconcile(services)
        services.inspector.sweep()
        services.pairs.sweep()
        if count := live.import_interrupted_sessions(services):
            logger.warning("the server stopped during %d live sessions; at most 2 s of each are lost", count)
        house = asyncio.create_task(run_housekeeping(services))
        try:
            yield
        finally:
            house.cancel()
            await asyncio.gather(house, return_exceptions=True)
            await asyncio.to_thread(services.live.close)
            await asyncio.to_thread(write_side_files, services)


def listen(settings: Settings) -> socket.socket:
    """Open the listening socket, at an address or in the file system. Raises PortTaken."""
    path = None
    address: str | tuple[str, int] = (settings.host, settings.port)
    if settings.host.startswith(SOCKET_PREFIX):
        address = settings.host.removeprefix(SOCKET_PREFIX)
        path, listener = Path(address), socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    else:
        family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
        # asyncio sends responses at once (TCP_NODELAY) only if the protocol is named; otherwise each waits 40
        # ms
        listener = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        if path is not None:
            path.unlink(missing_ok=True)
        listener.bind(address)
        if path is not None:
            path.chmod(0o660)  # readable by owner and group, the user of a proxy
        listener.listen(BACKLOG)  # clients can connect as soon as the address is printed
    except OSError as error:
        listener.close()
        raise PortTaken(host=settings.host, port=settings.port) from error
    return listener


def configure_server(application: FastAPI, settings: Settings) -> uvicorn.Config:
    """Set limits that uvicorn leaves open: size and time of a request's header."""
    return uvicorn.Config(
        application,
        root_path=settings.root_path.rstrip("/"),
        ssl_certfile=settings.tls_cert,
        ssl_keyfile=settings.tls_key,
        ssl_ciphers=TLS_CIPHERS,
        http=build_timeout_protocol(settings.header_patience_s),
        ws="websockets-sansio" if find_spec("websockets") else "none",
        ws_max_size=MAX_LIVE_MESSAGE_BYTES,
        ws_per_message_deflate=False,
        h11_max_incomplete_event_size=MAX_HEADER_BYTES,
        timeout_graceful_shutdown=GRACE_S,
        server_header=False,
        proxy_headers=False,  # middleware/guard.py reads forwarded headers, only from the configured proxy
        access_log=False,
        log_config=None,
    )


class _Server(uvicorn.Server):
    """Returns when it is stopped, so that we can clean up (uvicorn's own class raises the signal again)."""

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        before = {number: signal.signal(number, self.handle_exit) for number in STOP_SIGNALS}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)
