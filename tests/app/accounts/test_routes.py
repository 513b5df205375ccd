"""Each route has a line in one table, which says its permission and its act."""

from collections.abc import Iterator
from typing import Any

from app.access.routes import ROUTE_TABLE
from app.main import PAGES, ROUTES


def find_routes() -> Iterator[tuple[str, str]]:
    """Give method and path of every route; a WebSocket's method is WS."""
    found: Any = (route for router in (*ROUTES, *PAGES) for route in router.routes)
    for route in found:
        for method in getattr(route, "methods", None) or {"WS"}:
            yield method, route.path


def test_every_route_has_a_line() -> None:
    assert sorted(set(find_routes()) - ROUTE_TABLE.keys()) == []


def test_every_line_is_of_a_route() -> None:
    assert sorted(ROUTE_TABLE.keys() - set(find_routes())) == []


def test_whatever_reads_about_people_declares_an_act() -> None:
    silent = {
        path
        for (method, path), route in ROUTE_TABLE.items()
        if method == "GET" and route.act is None and route.needed not in ("public", "own", "upload")
    }

    assert silent == {"/metrics"}
