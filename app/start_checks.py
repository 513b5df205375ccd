"""Whom a start would let reach the server: refused where anything is missing that keeps strangers out."""

import os
import re
import ssl
from collections.abc import Mapping
from ipaddress import ip_address

from app.errors import BadParameter, ExamplePassword, ForeignAddress
from app.settings import Settings

SOCKET_PREFIX = "unix:"
"""Before the path of a socket in place of a host."""
HOST_NAMES_HINT = "arm.clinic.example, 192.0.2.7"
EXAMPLE_PASSWORD = "change-me"  # noqa: S105 - of the example files
_HOST_NAME = re.compile(r"[a-z0-9_]([a-z0-9._-]*[a-z0-9_])?", re.ASCII)


def check_exposure(settings: Settings, *, has_accounts: bool) -> None:
    """Refuse an address that others reach where anything is missing that keeps strangers out.

    A proxy on this computer reaches a loopback address or a socket; others reach it through the proxy.
    Raises ForeignAddress.
    """
    is_own = is_own_address(settings.host)
    if is_own and not settings.proxy and not settings.host.startswith(SOCKET_PREFIX):
        return
    needed = {
        "acromion account add": has_accounts,
        "--hosts": bool(settings.host_names),
        "--tls-cert": bool(settings.tls_cert) or (bool(settings.proxy) and is_own),
    }
    missing = [name for name, is_there in needed.items() if not is_there]
    if missing:
        raise ForeignAddress(host=settings.host, missing=", ".join(missing))


def is_own_address(host: str) -> bool:
    """Return whether only this computer reaches an address."""
    try:
        return host == "localhost" or host.startswith(SOCKET_PREFIX) or ip_address(host).is_loopback
    except ValueError:
        return False


def check_host_names(settings: Settings) -> None:
    """Refuse a name by which no browser asks: a pattern, a port, an address with its scheme.

    Raises BadParameter.
    """
    for name in sorted(settings.host_names):
        try:
            ip_address(name)
        except ValueError:
            if not _HOST_NAME.fullmatch(name):
                raise BadParameter(name="--hosts", value=name[:60], allowed=HOST_NAMES_HINT) from None


def check_passwords(settings: Settings, environment: Mapping[str, str] = os.environ) -> None:
    """Refuse the passwords of the example files (``docker/*.example``). Raises ExamplePassword."""
    known = {
        "ACROMION_DATABASE_URL": settings.database_url,
        "AWS_SECRET_ACCESS_KEY": environment.get("AWS_SECRET_ACCESS_KEY", ""),
    }
    for name, value in known.items():
        if EXAMPLE_PASSWORD in value:
            raise ExamplePassword(name=name)


def check_certificate(settings: Settings) -> None:
    """Refuse a certificate without its key, and files that are none. Raises BadParameter."""
    cert, key = settings.tls_cert, settings.tls_key
    if cert is None and key is None:
        return
    try:
        if cert is None or key is None:
            raise FileNotFoundError
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(cert, key)
    except OSError as error:  # SSLError is one
        given = ", ".join(str(path) for path in (cert, key) if path)
        allowed = "--tls-cert CERT.pem --tls-key KEY.pem"
        raise BadParameter(name="--tls-cert, --tls-key", value=given, allowed=allowed) from error
