"""Checks before the server starts: it must not be reachable by strangers without protection."""

import os
import re
import ssl
from collections.abc import Mapping
from ipaddress import ip_address

from acromion.app.errors import BadParameter, ExamplePassword, ForeignAddress
from acromion.app.settings import Settings

SOCKET_PREFIX = "unix:"
"""Prefix of a socket path that replaces a host."""
HOST_NAMES_HINT = "arm.clinic.example, 192.0.2.7"
EXAMPLE_PASSWORD = "change-me"  # noqa: S105 - of the example files
_HOST_NAME = re.compile(r"[a-z0-9_]([a-z0-9._-]*[a-z0-9_])?", re.ASCII)


def check_exposure(settings: Settings, *, has_accounts: bool) -> None:
    """Reject an address that other computers can reach if accounts, host names or TLS are missing.

    A proxy on this computer uses a loopback address or a socket; other computers reach it through the proxy.
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
    """Return whether an address is reachable only from this computer."""
    try:
        return host == "localhost" or host.startswith(SOCKET_PREFIX) or ip_address(host).is_loopback
    except ValueError:
        return False


def check_host_names(settings: Settings) -> None:
    """Reject a host name that no browser sends: a pattern, a port, or an address with its scheme.

    Raises BadParameter.
    """
    for name in sorted(settings.host_names):
        try:
            ip_address(name)
        except ValueError:
            if not _HOST_NAME.fullmatch(name):
                raise BadParameter(name="--hosts", value=name[:60], allowed=HOST_NAMES_HINT) from None


def check_passwords(settings: Settings, environment: Mapping[str, str] = os.environ) -> None:
    """Reject the passwords of the example files (``docker/*.example``). Raises ExamplePassword."""
    known = {
        "ACROMION_DATABASE_URL": settings.database_url,
        "AWS_SECRET_ACCESS_KEY": environment.get("AWS_SECRET_ACCESS_KEY", ""),
    }
    for name, value in known.items():
        if EXAMPLE_PASSWORD in value:
            raise ExamplePassword(name=name)


def check_certificate(settings: Settings) -> None:
    """Reject a certificate without its key, and unreadable files. Raises BadParameter."""
    cert, key = settings.tls_cert, settings.tls_key
    if cert is None and key is None:
        return
    try:
        if cert is None or key is None:
            raise FileNotFoundError
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(cert, key)
    except OSError as error:  # SSLError is an OSError
        given = ", ".join(str(path) for path in (cert, key) if path)
        allowed = "--tls-cert CERT.pem --tls-key KEY.pem"
        raise BadParameter(name="--tls-cert, --tls-key", value=given, allowed=allowed) from error
