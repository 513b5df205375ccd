"""Telling a webhook: one signed POST (Standard Webhooks 1.0), no redirect, no address that is not allowed."""

import base64
import hashlib
import hmac
import http.client
import ipaddress
import logging
import socket
import ssl
import time
from dataclasses import dataclass
from urllib.parse import urlsplit

from app.errors import ForeignWebhook

TIMEOUT_S = 10.0

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Message:
    """What is told: under one id however often it is tried."""

    id: str
    url: str
    secret: str
    body: str


def send_message(message: Message, *, allow_private: bool) -> bool:
    """Tell it once; whether it was heard (a status of 2xx)."""
    parts = urlsplit(message.url)
    target = (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
    try:
        connection = _connect(message.url, allow_private=allow_private)
        try:
            connection.request("POST", target, message.body.encode(), sign_message(message, int(time.time())))
            return 200 <= connection.getresponse().status < 300
        finally:
            connection.close()
    except (OSError, http.client.HTTPException, ForeignWebhook) as error:
        logger.warning("webhook %s not reached: %s", message.id, type(error).__name__)
        return False


def sign_message(message: Message, unix_s: int) -> dict[str, str]:
    """Give the headers: id, time and HMAC-SHA256 over ``id.time.body``."""
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
    """Give the address that a webhook's name stands for.

    Raises
    ------
    ForeignWebhook
        It is no http or https address, or it leads into a private network where that is not allowed.
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
    if not allow_private and not all(ipaddress.ip_address(a.partition("%")[0]).is_global for a in addresses):
        raise ForeignWebhook(url=url[:100])
    return addresses[0], port


def _connect(url: str, *, allow_private: bool) -> http.client.HTTPConnection:
    """Connect to the very address that was checked: the name is not asked for a second time."""
    address, port = check_address(url, allow_private=allow_private)
    parts = urlsplit(url)
    connection = http.client.HTTPConnection(parts.hostname or "", port, timeout=TIMEOUT_S)
    line: socket.socket = socket.create_connection((address, port), TIMEOUT_S)
    if parts.scheme == "https":
        line = ssl.create_default_context().wrap_socket(line, server_hostname=parts.hostname)
    connection.sock = line
    return connection
