"""From where a request comes, and the cookies that a browser is given."""

from typing import cast

from starlette.requests import HTTPConnection
from starlette.responses import Response

from app.accounts.logins import Caller, Logins
from app.settings import Settings

SESSION_COOKIE = "acromion_session"
BROWSER_COOKIE = "acromion_browser"
STATE_COOKIE = "acromion_state"
_HOST_PREFIX = "__Host-"
"""Browsers keep a cookie of such a name only if this very host has set it, by HTTPS and for every path."""
LONGEST_COOKIE = 200


def find_settings(connection: HTTPConnection) -> Settings:
    """Return the settings of the server."""
    return cast("Settings", connection.app.state.services.settings)


def find_logins(connection: HTTPConnection) -> Logins:
    """Return what logs people in."""
    return cast("Logins", connection.app.state.logins)


def find_address(connection: HTTPConnection) -> str:
    """Return the address that asks: of the peer, or what the proxy of the settings says last."""
    peer, proxy = connection.client.host if connection.client else "unix", find_settings(connection).proxy
    told = connection.headers.get("x-forwarded-for", "").rpartition(",")[2].strip()
    return told if told and proxy and (peer or "unix") == proxy else peer or "unix"


def find_caller(connection: HTTPConnection) -> Caller:
    """Return from where somebody tries to log in."""
    browser = connection.cookies.get(name_cookie(connection, BROWSER_COOKIE), "")
    return Caller(find_address(connection), browser[:LONGEST_COOKIE])


def is_secure(connection: HTTPConnection) -> bool:
    """Return whether the browser speaks HTTPS, with us or with the proxy before us."""
    return connection.url.scheme in ("https", "wss") or bool(find_settings(connection).proxy)


def find_origin(connection: HTTPConnection) -> str:
    """Return scheme and host by which the browser asks."""
    scheme = "https" if is_secure(connection) else "http"
    return f"{scheme}://{connection.headers.get('host', '')}"


def name_cookie(connection: HTTPConnection, name: str) -> str:
    """Return the name under which a browser keeps a cookie."""
    is_bound = is_secure(connection) and find_path(connection) == "/"
    return f"{_HOST_PREFIX}{name}" if is_bound else name


def set_cookie(connection: HTTPConnection, response: Response, name: str, value: str, age_s: int) -> None:
    """Give the browser a cookie that no script reads."""
    response.set_cookie(
        name_cookie(connection, name),
        value,
        max_age=age_s,
        httponly=True,
        secure=is_secure(connection),
        samesite="lax",
        path=find_path(connection),
    )


def drop_cookie(connection: HTTPConnection, response: Response, name: str) -> None:
    """Take a cookie from the browser."""
    set_cookie(connection, response, name, "", 0)


def find_path(connection: HTTPConnection) -> str:
    """Return the path for which the browser keeps our cookies."""
    return str(connection.scope.get("root_path", "")).rstrip("/") or "/"
