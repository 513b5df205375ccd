"""Who may ask, what every answer carries, and how errors look from outside."""

import asyncio
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from starlette.types import Message

from acromion.app.errors import BadParameter, FileTooLarge, ForeignAddress, SlowUpload
from acromion.app.http.middleware.guard import _BodyWatch, accepts_file
from acromion.app.library.jobs import JobStore
from acromion.app.main import create_app
from acromion.app.settings import Settings
from acromion.app.start_checks import check_exposure, check_host_names
from tests.loops import run_coroutine

CHANGES = ("/api/v1/analyze", "/api/v1/analyses/an_1/cancel", "/analyses/an_1/cancel")
NAMED = {"hosts": "clinic.example"}
PROXIED = NAMED | {"proxy": "127.0.0.1"}


@pytest.mark.parametrize(
    ("hosts", "status", "code"),
    [
        (("evil.example", "evil.example:8080", "127.0.0.1.evil.example", "[::1", ""), 421, "E-HOST-NAME"),
        (("localhost:8080", "127.0.0.1", "[::1]:8080"), 200, None),
    ],
    ids=["foreign", "of this computer"],
)
def test_only_names_of_this_computer_are_answered(
    shared: TestClient, hosts: tuple[str, ...], status: int, code: str | None
) -> None:
    for host in hosts:
        answer = shared.get("/api/v1/version", headers={"host": host})
        assert (answer.status_code, answer.json().get("code")) == (status, code), host


@pytest.mark.parametrize("path", CHANGES)
@pytest.mark.parametrize(
    "headers",
    [
        {"origin": "https://evil.example"},
        {"origin": "null"},
        {"origin": "http://localhost:9999"},
        {"origin": "https://localhost:8080"},
        {"sec-fetch-site": "cross-site"},
        {"sec-fetch-site": "same-site"},
    ],
)
def test_another_site_may_change_nothing(shared: TestClient, path: str, headers: dict[str, str]) -> None:
    answer = shared.post(path, content=b"x", headers=headers)

    assert (answer.status_code, "E-ORIGIN" in answer.text) == (403, True)


@pytest.mark.parametrize(
    ("changes", "base", "origin", "host", "status"),
    [
        ({}, "https://localhost:8080", "http://localhost:8080", "localhost:8080", 403),
        ({}, "https://localhost:8080", "https://localhost:8080", "localhost:8080", 202),
        (PROXIED, "http://clinic.example", "http://clinic.example", "clinic.example", 403),
        (PROXIED, "http://clinic.example", "https://clinic.example", "clinic.example", 202),
        (NAMED, "https://clinic.example", "https://clinic.example", "clinic.example:443", 202),
    ],
    ids=[
        "without TLS",
        "with TLS",
        "not the scheme of the proxy",
        "the scheme of the proxy",
        "port left out",
    ],
)
def test_our_own_site_has_our_scheme_or_that_of_the_proxy(
    settings: Settings, changes: dict[str, Any], base: str, origin: str, host: str, status: int
) -> None:
    with TestClient(create_app(settings.model_copy(update=changes)), base_url=base) as caller:
        answer = caller.post(CHANGES[0], content=b"x", headers={"origin": origin, "host": host})

    assert answer.status_code == status


def test_our_own_page_may_change_things(client: TestClient) -> None:
    headers = {"origin": "http://localhost:8080", "sec-fetch-site": "same-origin"}

    assert client.post(CHANGES[0], content=b"x", headers=headers).status_code == 202


@pytest.mark.parametrize(
    "path", ["/", "/rows", "/static/page.css", "/api/v1/version", "/nowhere", "/healthz"]
)
def test_every_answer_carries_the_security_headers(shared: TestClient, path: str) -> None:
    headers = shared.get(path).headers

    assert headers["content-security-policy"] == (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
        "form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
    )
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["referrer-policy"] == "same-origin"
    assert headers["cache-control"] == "no-store"
    assert "strict-transport-security" not in headers  # without a name no browser is bound


def test_a_server_with_a_name_binds_browsers_to_tls_for_a_year(settings: Settings) -> None:
    application = create_app(settings.model_copy(update=NAMED))
    with TestClient(application, base_url="https://clinic.example") as caller:
        answers = [caller.get(path) for path in ("/healthz", "/nowhere")]
        answers.append(caller.get("/healthz", headers={"host": "x"}))

    bound = {answer.headers["strict-transport-security"] for answer in answers}
    assert bound == {"max-age=31536000; includeSubDomains"}


@pytest.mark.parametrize("path", ["/", "/api/v1/version", "/healthz"])
def test_a_request_is_never_echoed(shared: TestClient, path: str) -> None:
    assert shared.request("TRACE", path).status_code == 405


def test_no_other_site_may_read_an_answer(shared: TestClient) -> None:
    answer = shared.get("/api/v1/version", headers={"origin": "https://evil.example"})

    assert [name for name in answer.headers if name.startswith("access-control-")] == []


@pytest.mark.parametrize(
    "path",
    [
        "/static/../../../../etc/passwd",
        "/static/%2e%2e/%2e%2e/app/settings.py",
        "/static/..%2f..%2fapp%2fsettings.py",
        "/vendor/..%2f..%2fpyproject.toml",
        "/static/.git/config",
        "/.git/config",
        "/static/",
    ],
)
def test_no_path_leads_to_a_file_that_is_not_the_pages_or_to_a_list_of_them(
    shared: TestClient, path: str
) -> None:
    assert shared.get(path).status_code in (404, 405)


@pytest.fixture
def broken(client: TestClient, store: JobStore) -> TestClient:
    """A server whose database has lost a table: everything that asks it is a bug."""
    with store._engine.begin() as connection:
        connection.exec_driver_sql("DROP TABLE analyses")
    return client


def test_a_bug_is_a_500_with_a_reference_and_no_traceback(broken: TestClient) -> None:
    answer = broken.get("/api/v1/analyses")

    assert (answer.status_code, answer.json()["code"]) == (500, "E-INTERNAL")
    assert "Traceback" not in answer.text
    assert "sqlite" not in answer.text
    assert answer.headers["x-content-type-options"] == "nosniff"


def test_a_bug_behind_a_page_is_a_page(broken: TestClient) -> None:
    answer = broken.get("/", headers={"accept-language": "fr"})

    assert answer.status_code == 500
    assert 'lang="fr"' in answer.text
    assert "E-INTERNAL" in answer.text


@pytest.mark.parametrize(
    ("method", "path", "status", "code"),
    [
        ("GET", "/api/v1/nowhere", 404, "E-NOT-FOUND"),
        ("GET", "/api/v1/analyses/an_none", 404, "E-NOT-FOUND"),
        ("GET", "/api/v1/analyses/..%2f..%2fetc%2fpasswd", 404, "E-NOT-FOUND"),
        ("POST", "/api/v1/analyses/an_none/cancel", 404, "E-NOT-FOUND"),
        ("DELETE", "/api/v1/version", 405, "E-METHOD"),
        ("GET", "/api/v1/analyses?limit=0", 422, "E-PARAMETER"),
        ("GET", "/api/v1/problems/E-NONE", 404, "E-NOT-FOUND"),
    ],
)
def test_every_refusal_is_a_problem_document(
    shared: TestClient, method: str, path: str, status: int, code: str
) -> None:
    answer = shared.request(method, path)

    assert (answer.status_code, answer.json()["code"]) == (status, code)
    assert answer.headers["content-type"] == "application/problem+json"


@pytest.mark.parametrize(
    ("path", "allowed"),
    [("/api/v1/recordings", "GET, POST"), ("/columns/0", "POST"), ("/login", "GET, POST"), ("/help", "GET")],
)
def test_a_wrong_verb_is_told_every_right_one(shared: TestClient, path: str, allowed: str) -> None:
    refused = shared.delete(path)

    assert (refused.status_code, refused.headers["allow"]) == (405, allowed)


ALL_THREE = "acromion account add, --hosts, --tls-cert"


@pytest.mark.parametrize(
    ("given", "has_accounts", "missing"),
    [
        *(({"host": host}, False, ALL_THREE) for host in ("0.0.0.0", "192.168.1.4", "::", "example.org", "")),
        ({"host": "0.0.0.0", "hosts": "arm.example", "tls_cert": "c.pem"}, False, "acromion account add"),
        ({"host": "0.0.0.0", "tls_cert": "c.pem"}, True, "--hosts"),
        ({"host": "0.0.0.0", "hosts": "arm.example"}, True, "--tls-cert"),
        ({"host": "0.0.0.0", "hosts": "arm.example", "proxy": "127.0.0.1"}, True, "--tls-cert"),
        ({"hosts": "arm.example", "proxy": "127.0.0.1"}, False, "acromion account add"),
    ],
)
def test_an_address_that_others_reach_is_refused_with_each_thing_that_is_missing(
    given: dict[str, Any], has_accounts: bool, missing: str
) -> None:
    with pytest.raises(ForeignAddress) as refused:
        check_exposure(Settings(**given), has_accounts=has_accounts)

    assert refused.value.facts["missing"] == missing


@pytest.mark.parametrize(
    ("given", "has_accounts"),
    [
        *(({"host": host}, False) for host in ("127.0.0.1", "127.1.2.3", "::1", "localhost")),
        ({"host": "0.0.0.0", "hosts": "arm.example", "tls_cert": Path("c.pem")}, True),
        ({"hosts": "arm.example", "proxy": "127.0.0.1"}, True),
    ],
)
def test_this_computer_and_a_server_with_accounts_name_and_tls_are_served(
    given: dict[str, Any], has_accounts: bool
) -> None:
    check_exposure(Settings(**given), has_accounts=has_accounts)


@pytest.mark.parametrize("name", ["*", "*.example", "arm.example:8080", "https://arm.example", "arm example"])
def test_a_name_by_which_no_browser_asks_is_refused_at_the_start(name: str) -> None:
    with pytest.raises(BadParameter) as refused:
        check_host_names(Settings(hosts=f"arm.example, {name}"))

    assert refused.value.facts["name"] == "--hosts"
    assert refused.value.facts["value"] == name


@pytest.mark.parametrize("names", ["", "arm.example", "ARM_1.Clinic.example, 192.0.2.7, 2001:db8::7, arm"])
def test_names_and_addresses_are_taken(names: str) -> None:
    check_host_names(Settings(hosts=names))


async def send_slowly(body: bytes, pause_s: float) -> Message:
    await asyncio.sleep(pause_s)
    return {"type": "http.request", "body": body, "more_body": True}


@pytest.mark.parametrize(("body", "pause_s"), [(b"x", 0.02), (b"", 0.02), (b"x", 60)])
def test_a_body_that_dribbles_or_stops_is_given_up(body: bytes, pause_s: float) -> None:
    watch = _BodyWatch(lambda: send_slowly(body, pause_s), min_rate_bytes_per_s=1000, body_timeout_s=0.05)

    async def listen() -> None:
        for _ in range(20):
            await watch.receive()

    with pytest.raises(SlowUpload):
        run_coroutine(listen())


def test_a_body_that_flows_is_heard_to_its_end() -> None:
    watch = _BodyWatch(lambda: send_slowly(b"x" * 1000, 0.02), min_rate_bytes_per_s=1000, body_timeout_s=0.05)

    async def listen() -> int:
        return sum([len((await watch.receive())["body"]) for _ in range(10)])

    assert run_coroutine(listen()) == 10_000


def test_nothing_is_awaited_after_a_last_piece_that_makes_the_body_too_large() -> None:
    pieces = iter([{"type": "http.request", "body": b"x" * 11, "more_body": False}])

    async def receive() -> Message:
        return next(pieces)

    async def refuse() -> None:
        watch = _BodyWatch(receive, min_rate_bytes_per_s=1, body_timeout_s=60, most_bytes=10)
        with pytest.raises(FileTooLarge):
            await watch.receive()
        await watch.finish()

    run_coroutine(refuse())


@pytest.mark.parametrize("root", ["", "/acromion"])
def test_only_an_address_that_takes_files_is_not_held_to_the_size_of_words(root: str) -> None:
    files = ["/api/v1/analyze", "/api/v1/recordings", "/api/v1/validations", "/validations"]
    others = ["/", "/api/v1/batches", "/api/v1/webhooks", "/analyses/an_1/validations"]

    scopes = [{"type": "http", "path": root + path, "root_path": root} for path in files + others]

    assert [accepts_file(scope) for scope in scopes] == [True] * 4 + [False] * 4
