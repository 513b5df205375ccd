"""Webhooks: addresses that are notified of finished analyses, finished batches and cues."""

import asyncio
import base64
import concurrent.futures
import hashlib
import hmac
import ipaddress
import logging
import socket
import ssl
import threading
import time
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Annotated, Literal
from urllib.parse import SplitResult, quote, urlsplit

import h11
from fastapi import APIRouter, Response
from fastapi.responses import JSONResponse
from pydantic import BaseModel, ConfigDict, Field
from sqlalchemy.exc import OperationalError

from acromion.app.errors import ForeignWebhook, SecretUnreadable
from acromion.app.http.api.library.analyses import run_to_end
from acromion.app.http.middleware.problems import PROBLEM_RESPONSES
from acromion.app.library.webhooks import EVENTS, SECRET_OF_WEBHOOK, USUAL_EVENTS, Delivery, Webhook
from acromion.app.services import Services, UsedServices
from acromion.app.store.server_secret import SECRET_FILE, ServerSecret

# Delivery: one signed POST (Standard Webhooks 1.0) to a permitted address, without redirects.


LIMIT_S = 30.0
"""For one whole delivery, from the name lookup to the response header."""
READ_BYTES = 1 << 12
MAX_HEAD_BYTES = 1 << 16
TARGET_SIGNS = "/?%:@!$&'()*+,;=~"
"""Characters that are sent unchanged; all others in a path or query are percent-encoded."""

REFUSED_NETWORKS = tuple(
    ipaddress.ip_network(network)
    for network in (
        "0.0.0.0/8",  # this network, RFC 1122
        "10.0.0.0/8",  # private, RFC 1918
        "100.64.0.0/10",  # shared by a carrier's customers, RFC 6598
        "127.0.0.0/8",  # this computer, RFC 1122
        "169.254.0.0/16",  # link-local, RFC 3927
        "172.16.0.0/12",  # private, RFC 1918
        "192.0.0.0/24",  # protocol assignments, RFC 6890
        "192.0.2.0/24",  # documentation, RFC 5737
        "192.88.99.0/24",  # relays of 6to4, RFC 7526
        "192.168.0.0/16",  # private, RFC 1918
        "198.18.0.0/15",  # benchmarks, RFC 2544
        "198.51.100.0/24",  # documentation, RFC 5737
        "203.0.113.0/24",  # documentation, RFC 5737
        "224.0.0.0/4",  # multicast, RFC 5771
        "240.0.0.0/4",  # reserved, RFC 1112, and broadcast, RFC 919
        "::/96",  # unspecified, this computer and IPv4-compatible, RFC 4291
        "::ffff:0:0/96",  # IPv4-mapped, RFC 4291
        "::ffff:0:0:0/96",  # IPv4-translated, RFC 2765
        "64:ff9b::/96",  # IPv4 behind NAT64, RFC 6052
        "64:ff9b:1::/48",  # local-use NAT64, RFC 8215
        "100::/64",  # discarded, RFC 6666
        "100:0:0:1::/64",  # dummy prefix, RFC 9780
        "2001::/23",  # protocol assignments, RFC 2928: Teredo (RFC 4380), benchmarks, ORCHID
        "2001:db8::/32",  # documentation, RFC 3849
        "2002::/16",  # 6to4, RFC 3056
        "3fff::/20",  # documentation, RFC 9637
        "5f00::/16",  # segment routing, RFC 9602
        "fc00::/7",  # private, RFC 4193
        "fe80::/10",  # link-local, RFC 4291
        "fec0::/10",  # site-local, RFC 3879
        "ff00::/8",  # multicast, RFC 4291
    )
)
"""Networks that webhooks may not reach unless the settings allow private networks.

Python's ``is_global`` is not used: it changed between versions, and it treats IPv6 forms that contain an IPv4
address as global.
"""

logger = logging.getLogger(__name__)


async def send_message(message: Delivery, *, allow_private: bool, limit_s: float = LIMIT_S) -> bool:
    """Send a message once; return True if the receiver accepted it (2xx) in time.

    The secret in ``message`` must be decrypted. The message keeps its id over all attempts.
    """
    try:
        async with asyncio.timeout(limit_s):
            return await _send(message, allow_private=allow_private)
    except (OSError, ValueError, h11.ProtocolError, ForeignWebhook) as error:
        logger.warning("webhook %s not reached: %s", message.id, type(error).__name__)
        return False


def sign_message(message: Delivery, unix_s: int) -> dict[str, str]:
    """Return the headers: id, time and HMAC-SHA256 over ``id.time.body``."""
    key = base64.b64decode(message.secret.removeprefix("whsec_"))
    signed = f"{message.id}.{unix_s}.{message.body}".encode()
    signature = base64.b64encode(hmac.new(key, signed, hashlib.sha256).digest()).decode()
    return {
        "Content-Type": "application/json",
        "User-Agent": "acromion",
        "webhook-id": message.id,
        "webhook-timestamp": str(unix_s),
        "webhook-signature": f"v1,{signature}",
    }


def check_address(url: str, *, allow_private: bool) -> tuple[str, int]:
    """Resolve a webhook's host name to an address and port.

    Raises ForeignWebhook if the URL is not http or https, or if it resolves to a refused network.
    """
    try:
        parts = urlsplit(url)
        port = parts.port or (443 if parts.scheme == "https" else 80)
        if parts.scheme not in ("http", "https") or not parts.hostname or parts.username:
            raise ValueError
        found = socket.getaddrinfo(parts.hostname, port, type=socket.SOCK_STREAM)
    except (OSError, ValueError):
        raise ForeignWebhook(url=url[:100]) from None
    addresses = [str(entry[4][0]) for entry in found]
    if not allow_private and not all(map(is_public, addresses)):
        raise ForeignWebhook(url=url[:100])
    return addresses[0], port


def is_public(address: str) -> bool:
    """Return whether an address is outside of every refused network."""
    found = ipaddress.ip_address(address.partition("%")[0])
    return not any(found in network for network in REFUSED_NETWORKS)


async def _send(message: Delivery, *, allow_private: bool) -> bool:
    """Connect to the address that was checked; resolving the name again could return another one."""
    address, port = await _find_address(message.url, allow_private=allow_private)
    parts = urlsplit(message.url)
    tls, name = (ssl.create_default_context(), parts.hostname) if parts.scheme == "https" else (None, None)
    reader, writer = await asyncio.open_connection(
        address, port, limit=MAX_HEAD_BYTES, ssl=tls, server_hostname=name
    )
    try:
        connection = h11.Connection(h11.CLIENT, max_incomplete_event_size=MAX_HEAD_BYTES)
        writer.write(_write_request(connection, message, parts))
        while not isinstance(event := connection.next_event(), h11.Response):  # skip 1xx responses
            if event is h11.NEED_DATA:
                connection.receive_data(await reader.read(READ_BYTES))
        return 200 <= event.status_code < 300
    finally:
        writer.transport.abort()


async def _find_address(url: str, *, allow_private: bool) -> tuple[str, int]:
    """Resolve the name in a daemon thread, because a slow lookup cannot be cancelled."""
    found: concurrent.futures.Future[tuple[str, int]] = concurrent.futures.Future()

    def look_up() -> None:
        if found.set_running_or_notify_cancel():
            try:
                found.set_result(check_address(url, allow_private=allow_private))
            except ForeignWebhook as error:
                found.set_exception(error)

    threading.Thread(target=look_up, name="webhook-look-up", daemon=True).start()
    return await asyncio.wrap_future(found)


def _write_request(connection: h11.Connection, message: Delivery, parts: SplitResult) -> bytes:
    target = (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
    body, name = message.body.encode(), parts.hostname or ""
    host = f"[{name}]" if ":" in name else name.encode("idna").decode()
    headers = {
        "Host": f"{host}:{parts.port}" if parts.port else host,
        **sign_message(message, int(time.time())),
        "Content-Length": str(len(body)),
        "Connection": "close",
    }
    request = h11.Request(method="POST", target=quote(target, TARGET_SIGNS), headers=list(headers.items()))
    events = (request, h11.Data(data=body), h11.EndOfMessage())
    return b"".join(connection.send(event) or b"" for event in events)


router = APIRouter(prefix="/api/v1/webhooks", responses=PROBLEM_RESPONSES, tags=["webhooks"])
EventName = Literal["analysis.finished", "batch.finished", "live.cue"]


class WebhookWish(BaseModel):
    """A new webhook: its address and its events."""

    model_config = ConfigDict(extra="forbid")

    url: Annotated[str, Field(max_length=2000, description="http or https")]
    events: Annotated[list[EventName], Field(min_length=1, max_length=len(EVENTS))] = list(USUAL_EVENTS)


class WebhookView(BaseModel):
    """A webhook. ``secret`` is shown only once, when it is created."""

    id: str
    url: str
    events: list[EventName]
    created_at: str
    secret: str | None = None


class WebhookList(BaseModel):
    """Every webhook."""

    items: list[WebhookView]


@router.post("", status_code=201)
def create_webhook(body: WebhookWish, services: UsedServices) -> WebhookView:
    """Notify an address of events: ids only, signed with the secret (Standard Webhooks)."""
    check_address(body.url, allow_private=services.settings.webhooks_may_be_private)
    secret = ServerSecret(services.settings.data_dir)
    hook = services.webhooks.add(body.url, tuple(dict.fromkeys(body.events)), secret)
    view = _view(hook)
    view.secret = hook.secret
    headers = {"Location": f"/api/v1/webhooks/{hook.id}"}
    return JSONResponse(view.model_dump(), 201, headers)  # type: ignore[return-value]


@router.get("", response_model_exclude_none=True)
def list_webhooks(services: UsedServices) -> WebhookList:
    """Return every webhook, without its secret."""
    return WebhookList(items=[_view(hook) for hook in services.webhooks.find_all()])


@router.delete("/{webhook_id}", status_code=204)
def delete_webhook(webhook_id: str, services: UsedServices) -> Response:
    """Delete a webhook."""
    services.webhooks.drop(webhook_id)
    return Response(status_code=204)


def _view(hook: Webhook) -> WebhookView:
    return WebhookView(id=hook.id, url=hook.url, events=list(hook.events), created_at=hook.created_at)


# Background delivery.

MAX_PARALLEL_DELIVERIES = 16
"""Addresses served at the same time; each gets one message at a time."""


@dataclass(slots=True)
class WebhookSender:
    """Deliver to several addresses at once, in background tasks.

    ``limit_s`` applies to each delivery.
    """

    services: Services
    limit_s: float = LIMIT_S
    _under_way: dict[str, asyncio.Task[None]] = field(default_factory=dict)
    _starts: dict[str, int] = field(default_factory=dict)
    _started: int = 0

    async def start_due(self, elapsed_s: float) -> None:
        """Start the due deliveries to addresses that have none in progress.

        The address served longest ago goes first, so that slow addresses with long queues do not block the
        others.
        """
        due: dict[str, list[Delivery]] = {}
        for delivery in await run_to_end(self.services.webhooks.find_due, elapsed_s):
            due.setdefault(delivery.url, []).append(delivery)
        self._under_way = {url: task for url, task in self._under_way.items() if not task.done()}
        self._starts = {url: start for url, start in self._starts.items() if url in due}
        free = sorted(due.keys() - self._under_way.keys(), key=lambda url: (self._starts.get(url, 0), url))
        for url in free[: MAX_PARALLEL_DELIVERIES - len(self._under_way)]:
            self._started += 1
            self._starts[url] = self._started
            self._under_way[url] = asyncio.create_task(self._deliver(due[url]))

    async def finish(self) -> None:
        """Wait until no delivery is in progress."""
        await asyncio.gather(*self._under_way.values())

    async def stop(self) -> None:
        """Cancel deliveries in progress; they are retried after their pause."""
        for task in self._under_way.values():
            task.cancel()
        await asyncio.gather(*self._under_way.values(), return_exceptions=True)

    async def _deliver(self, deliveries: Iterable[Delivery]) -> None:
        """Deliver the due messages to one address in order, until one fails."""
        webhooks, settings = self.services.webhooks, self.services.settings
        try:
            for delivery in deliveries:
                if not await run_to_end(webhooks.take, delivery):
                    continue
                secret = ServerSecret(settings.data_dir).decrypt(delivery.secret, SECRET_OF_WEBHOOK)
                message = replace(delivery, secret=secret)
                allow_private = settings.webhooks_may_be_private
                if not await send_message(message, allow_private=allow_private, limit_s=self.limit_s):
                    return
                await run_to_end(webhooks.drop_delivery, delivery)
        except OperationalError:
            logger.exception("the database does not answer; the webhook is retried later")
        except SecretUnreadable:
            logger.error("%s did not encrypt the secret of a webhook: add the webhook again", SECRET_FILE)
