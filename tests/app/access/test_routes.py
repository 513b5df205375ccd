"""Each route asks for a permission, and gets it from one table."""

from collections.abc import Iterator
from typing import Any

from app.access.routes import NEEDED
from app.main import PAGES, ROUTES


def find_routes() -> Iterator[tuple[str, str]]:
    """Give method and path of every route; a WebSocket's method is WS."""
    found: Any = (route for router in (*ROUTES, *PAGES) for route in router.routes)
    for route in found:
        for method in getattr(route, "methods", None) or {"WS"}:
            yield method, route.path


def test_every_route_has_a_line() -> None:
    assert sorted(set(find_routes()) - NEEDED.keys()) == []


def test_every_line_is_of_a_route() -> None:
    assert sorted(NEEDED.keys() - set(find_routes())) == []
