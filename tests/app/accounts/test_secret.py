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


def test_who_brings_nothing_gets_nothing(guarded: TestClient) -> None:
    answer = guarded.get(LIST)

    assert (answer.status_code, answer.json()["code"]) == (401, "E-SIGN-IN")


def test_a_script_sends_the_contents_of_the_file(guarded: TestClient, settings: Settings) -> None:
    secret = (settings.data_dir / "secret").read_text()

    assert guarded.get(LIST, headers={"Authorization": f"Bearer {secret}"}).status_code == 200


def test_only_its_owner_may_read_the_file(guarded: TestClient, settings: Settings) -> None:
    assert stat.S_IMODE((settings.data_dir / "secret").stat().st_mode) == 0o600


def test_a_wrong_secret_is_refused(guarded: TestClient) -> None:
    assert guarded.get(LIST, headers={"Authorization": "Bearer wrong"}).status_code == 401


def test_the_secret_in_the_address_counts_for_nothing(guarded: TestClient) -> None:
    assert guarded.get(LIST, params={"secret": find_secret(guarded).bearer}).status_code == 401


def test_the_address_of_the_start_lets_a_browser_in(guarded: TestClient) -> None:
    ticket = find_secret(guarded).make_address()

    guarded.get(f"/login/once/{ticket}")

    assert guarded.get("/").status_code == 200


def test_the_address_of_the_start_works_once(guarded: TestClient) -> None:
    ticket = find_secret(guarded).make_address()
    guarded.get(f"/login/once/{ticket}")
    guarded.cookies.clear()

    assert guarded.get(f"/login/once/{ticket}").status_code == 401


def test_the_cookie_is_not_the_secret(guarded: TestClient) -> None:
    guarded.get(f"/login/once/{find_secret(guarded).make_address()}")

    assert guarded.cookies["acromion_session"] != find_secret(guarded).bearer


def test_the_cookie_is_out_of_reach_of_scripts(guarded: TestClient) -> None:
    answer = guarded.get(f"/login/once/{find_secret(guarded).make_address()}")

    assert "httponly" in answer.headers["set-cookie"].lower()


def test_a_browser_that_brings_nothing_is_asked_and_led_back(guarded: TestClient) -> None:
    answer = guarded.get("/days?study=ba_1", headers={"accept": "text/html"})

    assert answer.headers["location"] == "/login?next=%2Fdays%3Fstudy%3Dba_1"


def test_the_secret_can_be_typed(guarded: TestClient) -> None:
    form = {"secret": find_secret(guarded).bearer, "next": "/help"}

    assert guarded.post("/login", data=form).headers["location"] == "/help"


@pytest.mark.parametrize("wanted", ["//evil.example/", "https://evil.example/", "/\\evil.example", "/a\r\nb"])
def test_no_login_leads_to_another_site(guarded: TestClient, wanted: str) -> None:
    form = {"secret": find_secret(guarded).bearer, "next": wanted}

    assert guarded.post("/login", data=form).headers["location"] == "/"


def test_a_wrong_secret_that_is_typed_is_told(guarded: TestClient) -> None:
    answer = guarded.post("/login", data={"secret": "wrong", "next": "/"})

    assert (answer.status_code, "set-cookie" in answer.headers) == (401, False)


def test_logging_out_takes_the_cookie(guarded: TestClient) -> None:
    guarded.get(f"/login/once/{find_secret(guarded).make_address()}")

    guarded.post("/logout")

    assert guarded.get(LIST).status_code == 401


def test_the_next_start_has_the_same_secret(settings: Settings) -> None:
    settings.data_dir.mkdir(parents=True)

    assert read_or_create_secret(settings.data_dir).bearer == read_or_create_secret(settings.data_dir).bearer


def test_a_secret_that_was_deleted_is_made_anew(settings: Settings) -> None:
    settings.data_dir.mkdir(parents=True)
    before = read_or_create_secret(settings.data_dir).bearer
    (settings.data_dir / "secret").unlink()

    assert read_or_create_secret(settings.data_dir).bearer != before


@pytest.mark.parametrize("path", ["/healthz", "/readyz", "/login"])
def test_what_is_public_is_answered(guarded: TestClient, path: str) -> None:
    assert guarded.get(path).status_code == 200


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
