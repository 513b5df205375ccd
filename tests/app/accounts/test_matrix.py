"""Every route, by everybody: who is nobody, of each role, or whose login is over."""

import json
import re
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import pytest
from fastapi.testclient import TestClient
from starlette.websockets import WebSocketDisconnect

from acromion.app.accounts.routes import ROUTE_TABLE
from acromion.app.accounts.subjects import ROLES, Permission, collect_permissions
from acromion.app.library.recordings import Description
from acromion.app.main import PAGES, ROUTES
from acromion.app.request import ReportRequest
from acromion.app.settings import Settings
from acromion.app.store.server_secret import ServerSecret
from tests.app.accounts.conftest import House

REFUSED = (401, 403)
UNKNOWN = {
    "analysis_id": "an_00000000000000ff",
    "validation_id": "an_00000000000000ff",
    "recording_id": "rec_00000000000000ff",
    "upload_id": "up_" + "0" * 28,
    "batch_id": "ba_00000000000000ff",
    "study_id": "ba_00000000000000ff",
    "webhook_id": "wh_00000000000000ff",
    "view_id": "view_00000000000000ff",
    "header": "00000000000000ff",
    "session_id": "nothere",
    "token_id": "tok_00000000000000ff",
    "person_id": "per_00000000000000ff",
}
PLAIN = {"ticket": "x", "code": "E-404", "kind": "trash", "form": "pdf", "act": "tag", "name": "x"} | {
    "place": "rec_0123456789abcdef"
}
SLOW = {("POST", "/sample"), ("GET", "/example/report.pdf"), ("GET", "/example/report.html")}
"""What takes seconds to make; its refusals are tried like all others."""
ENDING = {("POST", "/logout"), ("POST", "/account/sessions/end")}
"""What ends the visitor's own login; its refusals are tried, too."""


@dataclass(frozen=True)
class Visitor:
    """Somebody who calls: the headers, and what is permitted; None where the server knows nobody."""

    name: str
    headers: Mapping[str, str]
    permissions: frozenset[Permission] | None


@pytest.fixture
def visitors(house: House, settings: Settings) -> list[Visitor]:
    found = [
        Visitor("nobody", {}, None),
        Visitor("expired session", house.log_in_too_long_ago("clinician", settings), None),
    ]
    revoked = house.add_token("clinician", "read", "export")
    house.revoke(revoked)
    found.append(Visitor("revoked token", {"Authorization": f"Bearer {revoked}"}, None))
    reads = house.add_token("clinician", "read")
    own: frozenset[Permission] = frozenset({"read", "own"})
    found.append(Visitor("token that reads", {"Authorization": f"Bearer {reads}"}, own))
    of_roles = (Visitor(role, house.log_in(role), collect_permissions(frozenset({role}))) for role in ROLES)
    return [*found, *of_roles]


@pytest.fixture
def known(house: House) -> dict[str, str]:
    """Ids of things that are there."""
    services = house.services
    upload = services.storage.open_upload(1_000_000)
    upload.write(b"recording")
    job = services.store.add(upload.keep(), ReportRequest("shift.gt3x", "W-1"), study="spring")
    batch = services.batches.find_page(1)[0].id
    services.views.add("mine", "text=W")
    services.mappings.put("00000000000000aa", "logger", "{}", is_confirmed=False)
    ids = {
        "analysis_id": job.id,
        "validation_id": job.id,
        "recording_id": job.recording_id,
        "upload_id": services.uploads.open(10, "", Description("x")).id,
        "batch_id": batch,
        "study_id": batch,
        "webhook_id": services.webhooks.add(
            "https://example.org/", ("batch.finished",), ServerSecret(services.settings.data_dir)
        ).id,
        "view_id": services.views.find_all()[0].id,
        "header": "00000000000000aa",
        "session_id": "nothere",
        "token_id": UNKNOWN["token_id"],
        "person_id": house.people["clinician"],
    }
    assert ids.keys() == UNKNOWN.keys()
    return ids


def fill(path: str, ids: Mapping[str, str]) -> str:
    return re.sub(r"{(\w+)}", lambda found: {**ids, **PLAIN}[found[1]], path)


def list_http() -> Iterator[tuple[str, str]]:
    return (line for line in ROUTE_TABLE if line[0] != "WS")


def is_allowed(visitor: Visitor, method: str, path: str) -> bool:
    needed = ROUTE_TABLE[method, path].needed
    return needed == "public" or (visitor.permissions is not None and needed in visitor.permissions)


def expect(visitor: Visitor, method: str, path: str, status: int) -> bool:
    """Return whether a status is what the table of permissions says."""
    if not is_allowed(visitor, method, path):
        return status == (401 if visitor.permissions is None else 403)
    if visitor.name.startswith("token") and path.startswith("/api/v1/tokens"):
        return status == 403  # only people make and revoke tokens
    asks_for_proof = path.startswith(("/login", "/confirm", "/account"))
    return asks_for_proof or status not in REFUSED


def test_every_route_answers_each_visitor_as_the_table_says(
    caller: TestClient, visitors: list[Visitor], known: dict[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    wrong, count = [], 0
    for method, path in list_http():
        for visitor in visitors:
            allowed = is_allowed(visitor, method, path)
            if allowed and (method, path) in SLOW | ENDING:
                continue
            address = fill(path, UNKNOWN if allowed else known)
            for verb in ("GET", "HEAD") if method == "GET" and not allowed else (method,):
                status = caller.request(verb, address, headers=dict(visitor.headers)).status_code
                count += 1
                if not expect(visitor, method, path, status):
                    wrong.append((verb, path, visitor.name, status))

    with capsys.disabled():
        sys.stdout.write(f"\nmatrix of routes: {count} requests, {len(wrong)} wrong\n")
    assert wrong == []
    assert count > 2000


def test_a_live_session_asks_for_the_permission_to_upload(
    caller: TestClient, visitors: list[Visitor]
) -> None:
    outcomes = {}
    for visitor in visitors:
        try:
            with caller.websocket_connect(
                "ws://localhost:8080/api/v1/live", headers=dict(visitor.headers)
            ) as socket:
                socket.send_text("{}")
                outcomes[visitor.name] = json.loads(socket.receive_text())["type"]
        except WebSocketDisconnect:  # also of a denial with a response
            outcomes[visitor.name] = "refused"

    uploads = {visitor.name for visitor in visitors if "upload" in (visitor.permissions or ())}
    assert outcomes == {
        visitor.name: "problem" if visitor.name in uploads else "refused" for visitor in visitors
    }


# Each route has a line in one table, which says its permission and its act.


def find_routes() -> Iterator[tuple[str, str]]:
    """Return method and path of every route; a WebSocket's method is WS."""
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
