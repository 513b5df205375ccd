"""A person logs in by a password and a second factor; nothing less lets anybody in."""

import logging
import re
import sqlite3
import stat
from pathlib import Path
from typing import cast

import pyotp
import pytest
from argon2 import PasswordHasher, Type
from fastapi.testclient import TestClient

from acromion.app.accounts import passwords
from acromion.app.accounts.accounts import AccountStore, Person
from acromion.app.accounts.gate import Gate, StartSecret, read_or_create_secret
from acromion.app.accounts.passwords import check_password, hash_password, needs_rehash, verify_password
from acromion.app.accounts.sign_in import Caller, SignIn
from acromion.app.errors import LoginRefused, StartSecretUnusable, WeakPassword
from acromion.app.main import write_opener
from acromion.app.settings import Settings
from tests.app.accounts.conftest import (
    PASSWORD,
    SECRET,
    AddPerson,
    Clock,
    Enter,
    Visit,
    Visitor,
    make_code,
    read_ticket,
)

HERE = Caller("192.0.2.1", "")


def test_password_and_a_code_that_counts_once_let_a_person_in(
    person: Person, enter: Enter, visit: Visit, clock: Clock
) -> None:
    first, second = enter(), visit()
    ticket = read_ticket(second.submit_password("clara"))

    again = second.post("/login/code", ticket=ticket, code=make_code(clock), next="/")

    assert "Clara" in first.get("/account").text
    assert again.status_code == 401
    assert second.client.cookies.get("acromion_session_8080") is None  # the password alone begins no session
    assert second.client.get("/api/v1/version").status_code == 401


def test_a_wrong_password_an_unknown_name_and_an_ended_account_are_refused_alike(
    person: Person, add_person: AddPerson, accounts: AccountStore, visit: Visit
) -> None:
    accounts.end_person(add_person("dora").id)

    answers = [
        visit().submit_password("clara", "nine blue bicycles"),
        visit().submit_password("nobody"),
        visit().submit_password("dora"),
    ]

    assert [answer.status_code for answer in answers] == [401] * 3
    assert answers[0].text == answers[1].text == answers[2].text


def test_a_password_is_taken_as_it_is_typed_and_a_login_name_in_any_case(
    person: Person, sign_in: SignIn
) -> None:
    assert sign_in.submit_password(" Clara ", PASSWORD, HERE).person_id == person.id
    with pytest.raises(LoginRefused):
        sign_in.submit_password("clara", f" {PASSWORD}", HERE)


@pytest.mark.parametrize(("step", "place"), [(-2, None), (-1, "/"), (1, "/"), (2, None)])
def test_a_clock_may_be_one_step_off(
    person: Person, visit: Visit, clock: Clock, step: int, place: str | None
) -> None:
    visitor = visit()
    ticket = read_ticket(visitor.submit_password("clara"))

    code = make_code(clock, step)
    answer = visitor.post("/login/code", ticket=ticket, code=code, next="//evil.example/")

    assert answer.status_code == (401 if place is None else 303)
    assert answer.headers.get("location") == place  # a place of ours alone


def test_a_recovery_code_lets_in_once(person: Person, sign_in: SignIn) -> None:
    sign_in.credentials.set_second_factor(person.id, SECRET, 0, ["abcd-efgh-2345-abcd-efgh-2345"])

    first = sign_in.submit_password("clara", PASSWORD, HERE)
    sign_in.submit_code(first.ticket, "ABCD EFGH 2345 ABCD EFGH 2345", HERE)
    second = sign_in.submit_password("clara", PASSWORD, HERE)

    with pytest.raises(LoginRefused):
        sign_in.submit_code(second.ticket, "abcd-efgh-2345-abcd-efgh-2345", HERE)


def test_the_second_step_is_forgotten_after_ten_minutes(person: Person, visit: Visit, clock: Clock) -> None:
    visitor = visit()
    ticket = read_ticket(visitor.submit_password("clara"))
    clock.wait(601)

    answer = visitor.post("/login/code", ticket=ticket, code=make_code(clock), next="/")

    assert answer.status_code == 410
    assert visitor.client.cookies.get("acromion_session_8080") is None


def test_the_first_login_sets_up_an_authenticator_by_its_first_code_and_shows_ten_codes(
    add_person: AddPerson, visit: Visit, clock: Clock
) -> None:
    add_person(has_second_factor=False)
    visitor = visit()

    shown = visitor.submit_password("clara")
    secret = re.search(r'class="secret">([A-Z2-7]+)<', shown.text)
    assert secret is not None
    refused = visitor.post("/login/enrol", ticket=read_ticket(shown), code="000000", next="/")
    other = visit().submit_password("clara")
    code = pyotp.TOTP(secret[1]).at(int(clock()))
    codes = visitor.post("/login/enrol", ticket=read_ticket(refused), code=code, next="/account")

    assert refused.status_code == 401
    assert "data:image/svg+xml" in refused.text
    assert "data:image/svg+xml" in other.text  # it is not on before its first code
    assert len(set(re.findall(r"<li><code>((?:[a-z2-7]{4}-){5}[a-z2-7]{4})</code>", codes.text))) == 10
    assert visitor.get("/account").status_code == 200


def test_a_password_is_enough_where_the_second_factor_is_only_offered(
    settings: Settings, accounts: AccountStore, add_person: AddPerson
) -> None:
    person = add_person(has_second_factor=False)
    sign_in = SignIn(accounts, settings.model_copy(update={"second_factor": "offered"}))

    assert sign_in.submit_password("clara", PASSWORD, HERE).next == "in"
    assert accounts.get_person(person.id).has_second_factor is False


def test_a_hash_of_other_parameters_is_made_anew_at_login(person: Person, sign_in: SignIn) -> None:
    old = PasswordHasher(time_cost=1, memory_cost=8192, parallelism=1).hash(PASSWORD)
    sign_in.credentials.set_password(person.id, old)

    sign_in.submit_password("clara", PASSWORD, HERE)

    found = sign_in.credentials.find("clara")
    assert found is not None
    assert found.password_hash is not None
    assert found.password_hash != old
    assert not needs_rehash(found.password_hash)
    assert found.password_hash.startswith("$argon2id$")


def test_a_link_sets_a_password_once_and_does_not_pass_by_the_second_factor(
    sign_in: SignIn, add_person: AddPerson, visit: Visit
) -> None:
    link = sign_in.make_link(add_person().id, 3600)
    visitor = visit()

    looked = visitor.get(f"/login/link/{link}")
    done = visitor.post(f"/login/link/{link}", password="five yellow umbrellas")
    again = visitor.post(f"/login/link/{link}", password="four yellow umbrellas")

    assert (looked.status_code, done.status_code, again.status_code) == (200, 303, 410)
    assert visitor.client.cookies.get("acromion_session_8080") is None
    assert 'name="code"' in visitor.submit_password("clara", "five yellow umbrellas").text


def test_a_password_set_by_a_link_ends_every_session(
    person: Person, sign_in: SignIn, enter: Enter, visit: Visit
) -> None:
    signed_in = enter()

    visit().post(f"/login/link/{sign_in.make_link(person.id, 3600)}", password="five yellow umbrellas")

    assert signed_in.client.get("/api/v1/version").status_code == 401


def test_a_link_ends_after_its_time_and_with_a_new_one(
    person: Person, sign_in: SignIn, visit: Visit, clock: Clock
) -> None:
    first, second = (sign_in.make_link(person.id, 3600) for _ in range(2))

    assert visit().get(f"/login/link/{first}").status_code == 410
    assert visit().get(f"/login/link/{second}").status_code == 200
    clock.wait(3601)
    assert visit().get(f"/login/link/{second}").status_code == 410


def test_a_weak_password_leaves_the_link_as_it_was(
    sign_in: SignIn, add_person: AddPerson, visit: Visit
) -> None:
    link = sign_in.make_link(add_person().id, 3600)
    visitor = visit()

    weak = visitor.post(f"/login/link/{link}", password="short")

    assert weak.status_code == 422
    assert "shorter than 12" in weak.text
    assert visitor.get(f"/login/link/{link}").status_code == 200


def test_no_secret_of_a_login_stands_in_the_database(
    person: Person, visitor: Visitor, sign_in: SignIn, enter: Enter, settings: Settings
) -> None:
    told = [PASSWORD, sign_in.make_link(person.id, 3600), sign_in.enter(person.id, HERE).session]
    told += [visitor.client.cookies["acromion_session_8080"], visitor.client.cookies["acromion_browser_8080"]]
    told.append(sign_in.accounts.add_token(person.id, "script", ["read"], 1e12))

    rows = dump(settings.data_dir / "acromion.sqlite3")

    assert [secret for secret in told if secret in rows] == []


def dump(database: Path) -> str:
    with sqlite3.connect(database) as connection:
        return "\n".join(connection.iterdump())


def test_without_an_account_the_secret_is_asked_for(visit: Visit) -> None:
    page = visit().get("/login").text

    assert 'name="secret"' in page
    assert 'name="password"' not in page


def test_from_the_first_account_on_the_secret_opens_nothing(
    person: Person, settings: Settings, visit: Visit
) -> None:
    secret = (settings.data_dir / "secret").read_text()

    answer = visit().client.get("/api/v1/version", headers={"authorization": f"Bearer {secret}"})

    assert answer.status_code == 401


# Which passwords may be had.


def find_fault(password: str, *names: str) -> str:
    try:
        check_password(password, names)
    except WeakPassword as refusal:
        return str(refusal.facts["weak"])
    return ""


@pytest.mark.parametrize(
    ("password", "names", "fault"),
    [
        ("elevenchars", (), "short"),
        ("twelve chars", (), ""),
        ("a1" + "é ü漢😀" * 25 + "z", (), ""),
        ("xyzabcde" * 16 + "!", (), "long"),
        ("123456qwerty", (), "common"),
        ("QwertyQwerty", (), "common"),
        ("aaaaaaaaaaaaaaaa", (), "common"),
        ("abababababababab", (), "common"),
        ("my acromion hurts", (), "name"),
        ("clara goes to work", ("clara",), "name"),
        ("seven annual reports", ("Ann",), ""),  # a short name may be part of a word
    ],
)
def test_a_password_is_judged_by_length_by_how_many_have_it_and_by_names(
    password: str, names: tuple[str, ...], fault: str
) -> None:
    assert find_fault(password, *names) == fault


SERVERS_HASHER = passwords._HASHER  # which the tests replace by a cheap one


def test_a_hash_costs_at_least_what_owasp_asks() -> None:
    assert SERVERS_HASHER.type is Type.ID
    assert SERVERS_HASHER.time_cost >= 2
    assert SERVERS_HASHER.memory_cost >= 19 * 1024  # KiB


def test_a_password_of_128_characters_counts_to_the_last() -> None:
    password = "abcdefgh" * 16

    kept = hash_password(password)

    assert verify_password(kept, password)
    assert not verify_password(kept, password[:-1])
    assert not verify_password(None, password)


# Without accounts: only who has the secret of the start comes in.


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
    assert guarded.cookies["acromion_session_8080"] != secret.bearer
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


@pytest.mark.parametrize("content", [b"", b"\n", b"short", b"\xff" * 43])
def test_a_start_refuses_a_file_that_holds_no_secret(settings: Settings, content: bytes) -> None:
    settings.data_dir.mkdir(parents=True)
    (settings.data_dir / "secret").write_bytes(content)

    with pytest.raises(StartSecretUnusable):
        read_or_create_secret(settings.data_dir)


def test_a_start_refuses_a_link_in_place_of_the_secret_and_leaves_its_target_alone(
    settings: Settings, tmp_path: Path
) -> None:
    settings.data_dir.mkdir(parents=True)
    target = tmp_path / "other"
    target.write_text("x" * 43)
    target.chmod(0o644)
    (settings.data_dir / "secret").symlink_to(target)

    with pytest.raises(StartSecretUnusable):
        read_or_create_secret(settings.data_dir)

    assert target.stat().st_mode & 0o777 == 0o644


def test_each_browser_gets_a_random_cookie_that_ends_after_twelve_hours() -> None:
    now_s = 0.0
    secret = StartSecret("x" * 43, lambda: now_s)
    first, second = secret.admit_browser(), secret.admit_browser()
    now_s = 12 * 3600 - 1
    lasts = secret.matches("", first)
    now_s += 1

    assert first != second
    assert lasts
    assert not secret.matches("", first)


def test_signing_out_ends_the_cookie_on_the_server(guarded: TestClient) -> None:
    guarded.get(f"/login/once/{find_secret(guarded).make_address()}")
    cookie = guarded.cookies["acromion_session_8080"]
    guarded.post("/logout")

    assert guarded.get(LIST, headers={"Cookie": f"acromion_session_8080={cookie}"}).status_code == 401


def test_the_cookie_of_a_server_on_a_port_has_the_port_in_its_name(guarded: TestClient) -> None:
    address = f"/login/once/{find_secret(guarded).make_address()}"

    entered = guarded.get(address, headers={"host": "127.0.0.1:8081"})

    assert entered.headers["set-cookie"].startswith("acromion_session_8081=")


def test_the_file_that_opens_the_browser_is_readable_by_its_owner_only(tmp_path: Path) -> None:
    file = tmp_path / "open.html"
    file.write_text("of an earlier start")

    opened = write_opener(file, "http://127.0.0.1:8080/login/once/ticket")

    assert opened == file.as_uri()
    assert "ticket" in file.read_text()
    assert stat.S_IMODE(file.stat().st_mode) == 0o600


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
    guarded.get("/api/v1/version", headers={"Cookie": "acromion_session_8080=CANARY-2"})
    guarded.get("/api/v1/version?token=CANARY-3")
    guarded.post("/login", data={"secret": "CANARY-4", "password": "CANARY-5"})

    lines = [record.getMessage() for record in caplog.records if not record.name.startswith("httpx")]
    assert with_it.status_code == 200
    assert not [line for line in lines if "CANARY" in line or secret in line]
