"""Who may ask, what every answer carries, and how errors look from outside."""

import asyncio
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from starlette.requests import Request
from starlette.types import Message

from app.api.middleware.guard import _BodyWatch, takes_file
from app.api.middleware.problems import respond_to_refusal
from app.errors import BadParameter, FileTooLarge, ForeignAddress, SlowUpload
from app.jobs.store import JobStore
from app.main import create_app
from app.settings import Settings
from app.start_checks import check_exposure, check_host_names
from tests.loops import run_coroutine

CHANGES = ("/api/v1/analyze", "/api/v1/analyses/an_1/cancel", "/analyses/an_1/cancel")


@pytest.mark.parametrize("host", ["evil.example", "evil.example:8080", "127.0.0.1.evil.example", "[::1", ""])
def test_a_foreign_host_name_is_refused(client: TestClient, host: str) -> None:
    answer = client.get("/api/v1/version", headers={"host": host})

    assert (answer.status_code, answer.json()["code"]) == (421, "E-HOST-NAME")


@pytest.mark.parametrize("host", ["localhost:8080", "127.0.0.1", "[::1]:8080"])
def test_this_computers_names_are_answered(client: TestClient, host: str) -> None:
    assert client.get("/api/v1/version", headers={"host": host}).status_code == 200


@pytest.mark.parametrize("path", CHANGES)
@pytest.mark.parametrize("origin", ["https://evil.example", "null", "http://localhost:9999"])
def test_another_site_may_change_nothing(client: TestClient, path: str, origin: str) -> None:
    assert client.post(path, content=b"x", headers={"origin": origin}).status_code == 403


def test_the_same_name_without_tls_is_another_site(settings: Settings) -> None:
    with TestClient(create_app(settings), base_url="https://localhost:8080") as caller:
        answers = [
            caller.post(CHANGES[0], content=b"x", headers={"origin": f"{scheme}://localhost:8080"})
            for scheme in ("http", "https")
        ]

    assert [answer.status_code for answer in answers] == [403, 202]


def test_the_same_name_with_tls_is_another_site_than_ours_without(client: TestClient) -> None:
    answer = client.post(CHANGES[0], content=b"x", headers={"origin": "https://localhost:8080"})

    assert (answer.status_code, answer.json()["code"]) == (403, "E-ORIGIN")


def test_behind_a_proxy_our_own_pages_ask_by_its_scheme(settings: Settings) -> None:
    proxied = settings.model_copy(update={"hosts": "clinic.example", "proxy": "127.0.0.1"})
    with TestClient(create_app(proxied), base_url="http://clinic.example") as caller:
        answers = [
            caller.post(CHANGES[0], content=b"x", headers={"origin": f"{scheme}://clinic.example"})
            for scheme in ("http", "https")
        ]

    assert [answer.status_code for answer in answers] == [403, 202]


@pytest.mark.parametrize("host", ["clinic.example", "clinic.example:443"])
def test_the_port_of_a_scheme_may_be_left_out(settings: Settings, host: str) -> None:
    named = settings.model_copy(update={"hosts": "clinic.example"})
    headers = {"origin": "https://clinic.example", "host": host}
    with TestClient(create_app(named), base_url="https://clinic.example") as caller:
        assert caller.post(CHANGES[0], content=b"x", headers=headers).status_code == 202


@pytest.mark.parametrize("site", ["cross-site", "same-site"])
def test_a_browser_that_says_another_site_asks_is_believed(client: TestClient, site: str) -> None:
    assert client.post(CHANGES[0], content=b"x", headers={"sec-fetch-site": site}).status_code == 403


def test_our_own_page_may_change_things(client: TestClient) -> None:
    headers = {"origin": "http://localhost:8080", "sec-fetch-site": "same-origin"}

    assert client.post(CHANGES[0], content=b"x", headers=headers).status_code == 202


@pytest.mark.parametrize(
    "path", ["/", "/rows", "/static/page.css", "/api/v1/version", "/nowhere", "/healthz"]
)
def test_every_answer_carries_the_security_headers(client: TestClient, path: str) -> None:
    headers = client.get(path).headers

    assert headers["content-security-policy"] == (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
        "form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
    )
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["referrer-policy"] == "same-origin"
    assert headers["cache-control"] == "no-store"


def test_a_server_with_a_name_binds_browsers_to_tls_for_a_year(settings: Settings) -> None:
    named = settings.model_copy(update={"hosts": "clinic.example"})
    with TestClient(create_app(named), base_url="https://clinic.example") as caller:
        answers = [
            caller.get("/healthz"),
            caller.get("/nowhere"),
            caller.get("/healthz", headers={"host": "x"}),
        ]

    bound = {answer.headers["strict-transport-security"] for answer in answers}
    assert bound == {"max-age=31536000; includeSubDomains"}


def test_without_a_name_no_browser_is_bound(client: TestClient) -> None:
    assert "strict-transport-security" not in client.get("/healthz").headers


@pytest.mark.parametrize("path", ["/", "/api/v1/version", "/healthz"])
def test_a_request_is_never_echoed(client: TestClient, path: str) -> None:
    assert client.request("TRACE", path).status_code == 405


def test_no_other_site_may_read_an_answer(client: TestClient) -> None:
    answer = client.get("/api/v1/version", headers={"origin": "https://evil.example"})

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
    client: TestClient, path: str
) -> None:
    assert client.get(path).status_code in (404, 405)


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
        ("GET", "/api/v1/analyses/an_none/results.json", 404, "E-NOT-FOUND"),
        ("POST", "/api/v1/analyses/an_none/cancel", 404, "E-NOT-FOUND"),
        ("DELETE", "/api/v1/version", 405, "E-METHOD"),
        ("GET", "/api/v1/analyses/an_1?wait=61", 422, "E-PARAMETER"),
        ("GET", "/api/v1/analyses?limit=0", 422, "E-PARAMETER"),
        ("GET", "/api/v1/problems/E-NONE", 404, "E-NOT-FOUND"),
    ],
)
def test_every_refusal_is_a_problem_document(
    client: TestClient, method: str, path: str, status: int, code: str
) -> None:
    answer = client.request(method, path)

    assert (answer.status_code, answer.json()["code"]) == (status, code)
    assert answer.headers["content-type"] == "application/problem+json"


@pytest.mark.parametrize(
    ("path", "allowed"),
    [("/api/v1/recordings", "GET, POST"), ("/columns/0", "POST"), ("/login", "GET, POST"), ("/help", "GET")],
)
def test_a_wrong_verb_is_told_every_right_one(client: TestClient, path: str, allowed: str) -> None:
    refused = client.delete(path)

    assert (refused.status_code, refused.headers["allow"]) == (405, allowed)


def test_a_code_can_be_looked_up(client: TestClient) -> None:
    assert client.get("/api/v1/problems/E-EMPTY?lang=fr").json()["title"] == "Le fichier est vide"


@pytest.mark.parametrize("host", ["0.0.0.0", "192.168.1.4", "::", "example.org", ""])
def test_an_address_that_others_reach_needs_accounts_names_and_tls(host: str) -> None:
    with pytest.raises(ForeignAddress) as refused:
        check_exposure(Settings(host=host), has_accounts=False)

    assert refused.value.facts["missing"] == "acromion account add, --hosts, --tls-cert"


@pytest.mark.parametrize(
    ("given", "has_accounts", "missing"),
    [
        ({"hosts": "arm.example", "tls_cert": "c.pem"}, False, "acromion account add"),
        ({"tls_cert": "c.pem"}, True, "--hosts"),
        ({"hosts": "arm.example"}, True, "--tls-cert"),
        ({"hosts": "arm.example", "proxy": "127.0.0.1"}, True, "--tls-cert"),
    ],
)
def test_each_thing_that_is_missing_is_named(given: dict[str, Any], has_accounts: bool, missing: str) -> None:
    with pytest.raises(ForeignAddress) as refused:
        check_exposure(Settings(host="0.0.0.0", **given), has_accounts=has_accounts)

    assert refused.value.facts["missing"] == missing


def test_with_all_three_an_address_is_served_that_others_reach() -> None:
    settings = Settings(host="0.0.0.0", hosts="arm.example", tls_cert=Path("c.pem"))

    check_exposure(settings, has_accounts=True)


def test_behind_a_proxy_on_this_computer_the_proxy_ends_tls() -> None:
    check_exposure(Settings(hosts="arm.example", proxy="127.0.0.1"), has_accounts=True)


def test_a_proxy_makes_a_server_need_accounts() -> None:
    with pytest.raises(ForeignAddress):
        check_exposure(Settings(hosts="arm.example", proxy="127.0.0.1"), has_accounts=False)


@pytest.mark.parametrize("name", ["*", "*.example", "arm.example:8080", "https://arm.example", "arm example"])
def test_a_name_by_which_no_browser_asks_is_refused_at_the_start(name: str) -> None:
    with pytest.raises(BadParameter) as refused:
        check_host_names(Settings(hosts=f"arm.example, {name}"))

    assert refused.value.facts["name"] == "--hosts"
    assert refused.value.facts["value"] == name


@pytest.mark.parametrize("names", ["", "arm.example", "ARM_1.Clinic.example, 192.0.2.7, 2001:db8::7, arm"])
def test_names_and_addresses_are_taken(names: str) -> None:
    check_host_names(Settings(hosts=names))


@pytest.mark.parametrize("host", ["127.0.0.1", "127.1.2.3", "::1", "localhost"])
def test_this_computers_addresses_are_served(host: str) -> None:
    check_exposure(Settings(host=host), has_accounts=False)


def test_readiness_tells_the_state_of_the_queue(client: TestClient) -> None:
    client.post("/api/v1/analyze", content=b"x")

    assert client.get("/readyz").json()["analyses"]["queued"] == 1


async def send_slowly(body: bytes, pause_s: float) -> Message:
    await asyncio.sleep(pause_s)
    return {"type": "http.request", "body": body, "more_body": True}


@pytest.mark.parametrize("body", [b"x", b""])
def test_a_body_that_dribbles_is_given_up(body: bytes) -> None:
    watch = _BodyWatch(lambda: send_slowly(body, 0.02), min_rate_bytes_per_s=1000, body_timeout_s=0.05)

    async def listen() -> None:
        for _ in range(20):
            await watch.receive()

    with pytest.raises(SlowUpload):
        run_coroutine(listen())


def test_a_body_that_stops_is_given_up() -> None:
    watch = _BodyWatch(lambda: send_slowly(b"x", 60), min_rate_bytes_per_s=1000, body_timeout_s=0.05)

    with pytest.raises(SlowUpload):
        run_coroutine(watch.receive())


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


def test_a_slow_upload_is_answered_and_the_line_closed() -> None:
    scope = {"type": "http", "method": "POST", "path": "/", "headers": [], "query_string": b""}

    answer = respond_to_refusal(Request(scope), SlowUpload())

    assert (answer.status_code, answer.headers["connection"]) == (408, "close")


@pytest.mark.parametrize(
    "path", ["/api/v1/analyze", "/api/v1/recordings", "/api/v1/validations", "/validations"]
)
@pytest.mark.parametrize("root", ["", "/acromion"])
def test_an_address_that_takes_files_is_not_held_to_the_size_of_words(path: str, root: str) -> None:
    assert takes_file({"type": "http", "path": root + path, "root_path": root})


@pytest.mark.parametrize("path", ["/", "/api/v1/batches", "/api/v1/webhooks", "/analyses/an_1/validations"])
def test_any_other_address_is(path: str) -> None:
    assert not takes_file({"type": "http", "path": path, "root_path": ""})
