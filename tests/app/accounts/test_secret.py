"""Without accounts: only who has the secret of the start comes in."""

import logging
import stat
from typing import cast

import pytest
from fastapi.testclient import TestClient

from app.access.gate import Gate, StartSecret, read_or_create_secret
from app.settings import Settings

LIST = "/api/v1/recordings"


def find_secret(client: TestClient) -> StartSecret:
    gate = cast("Gate", client.app.state.gate)  # type: ignore[attr-defined]
    assert gate.secret is not None
    return gate.secret


def test_who_does_not_bring_the_secret_gets_nothing(guarded: TestClient) -> None:
    secret = find_secret(guarded).bearer
    answers = [
        guarded.get(LIST),
        guarded.get(LIST, headers={"Authorization": "Bearer wrong"}),
        guarded.get(LIST, params={"secret": secret}),  # in the address it counts for nothing
    ]
    typed = guarded.post("/login", data={"secret": "wrong", "next": "/"})

    assert [(answer.status_code, answer.json()["code"]) for answer in answers] == [(401, "E-SIGN-IN")] * 3
    assert (typed.status_code, "set-cookie" in typed.headers) == (401, False)


def test_a_script_sends_the_contents_of_the_file_which_only_its_owner_may_read(
    guarded: TestClient, settings: Settings
) -> None:
    file = settings.data_dir / "secret"

    assert guarded.get(LIST, headers={"Authorization": f"Bearer {file.read_text()}"}).status_code == 200
    assert stat.S_IMODE(file.stat().st_mode) == 0o600


def test_the_address_of_the_start_lets_a_browser_in_once_until_it_logs_out(guarded: TestClient) -> None:
    secret = find_secret(guarded)
    address = f"/login/once/{secret.make_address()}"

    entered = guarded.get(address)

    assert guarded.get("/").status_code == 200
    assert "httponly" in entered.headers["set-cookie"].lower()
    assert guarded.cookies["acromion_session"] != secret.bearer
    guarded.post("/logout")
    assert guarded.get(LIST).status_code == 401
    assert guarded.get(address).status_code == 401


def test_a_browser_that_brings_nothing_is_asked_and_led_back(guarded: TestClient) -> None:
    answer = guarded.get("/days?study=ba_1", headers={"accept": "text/html"})

    assert answer.headers["location"] == "/login?next=%2Fdays%3Fstudy%3Dba_1"


@pytest.mark.parametrize(
    ("wanted", "place"),
    [
        ("/help", "/help"),
        ("//evil.example/", "/"),
        ("https://evil.example/", "/"),
        ("/\\evil.example", "/"),
        ("/a\r\nb", "/"),
    ],
)
def test_a_login_by_the_typed_secret_leads_to_a_page_of_ours(
    guarded: TestClient, wanted: str, place: str
) -> None:
    form = {"secret": find_secret(guarded).bearer, "next": wanted}

    assert guarded.post("/login", data=form).headers["location"] == place


def test_the_next_start_has_the_same_secret_unless_it_was_deleted(settings: Settings) -> None:
    settings.data_dir.mkdir(parents=True)

    first, second = (read_or_create_secret(settings.data_dir).bearer for _ in range(2))
    (settings.data_dir / "secret").unlink()

    assert first == second != read_or_create_secret(settings.data_dir).bearer


def test_what_is_public_is_answered(guarded: TestClient) -> None:
    assert [guarded.get(path).status_code for path in ("/healthz", "/readyz", "/login")] == [200] * 3


def test_a_stranger_is_not_told_what_lies_in_the_trash(guarded: TestClient) -> None:
    answer = guarded.get("/nowhere/an_0123456789abcdef", headers={"accept": "text/html"})

    assert answer.status_code == 404


def test_no_secret_of_a_request_reaches_the_log(
    guarded: TestClient, settings: Settings, caplog: pytest.LogCaptureFixture
) -> None:
    secret = (settings.data_dir / "secret").read_text()
    caplog.set_level(logging.DEBUG)

    with_it = guarded.get("/api/v1/version", headers={"Authorization": f"Bearer {secret}"})
    guarded.get("/api/v1/version", headers={"Authorization": "Bearer acr_CANARY-1"})
    guarded.get("/api/v1/version", headers={"Cookie": "acromion_session=CANARY-2"})
    guarded.get("/api/v1/version?token=CANARY-3")
    guarded.post("/login", data={"secret": "CANARY-4", "password": "CANARY-5"})

    lines = [record.getMessage() for record in caplog.records if not record.name.startswith("httpx")]
    assert with_it.status_code == 200
    assert not [line for line in lines if "CANARY" in line or secret in line]
