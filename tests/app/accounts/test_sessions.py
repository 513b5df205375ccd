"""A session is new at login, ends by itself, and ends at once when it is told to."""

import re

import pytest

from acromion.app.accounts.accounts import AccountStore, Person, SessionAges
from tests.app.accounts.conftest import (
    PASSWORD,
    AddPerson,
    Clock,
    Enter,
    Visit,
    Visitor,
    make_code,
    read_ticket,
)

MINUTE_S, HOUR_S = 60.0, 3600.0


def is_in(visitor: Visitor) -> bool:
    return visitor.client.get("/api/v1/version").status_code == 200


def copy_session(visitor: Visitor, visit: Visit) -> Visitor:
    """Open a browser that has the cookie of another."""
    thief = visit()
    thief.client.cookies.set("acromion_session_8080", visitor.client.cookies["acromion_session_8080"])
    return thief


def log_in_again(visitor: Visitor, clock: Clock) -> None:
    ticket = read_ticket(visitor.submit_password("clara"))
    visitor.post("/login/code", ticket=ticket, code=make_code(clock), next="/")


@pytest.fixture
def two(add_person: AddPerson, enter: Enter, clock: Clock) -> tuple[Visitor, Visitor]:
    """Two browsers in which one person is logged in, the second a minute later."""
    add_person()
    first = enter()
    clock.wait(60)
    return first, enter()


def test_a_cookie_that_was_planted_before_the_login_opens_nothing_after_it(
    person: Person, visit: Visit, clock: Clock
) -> None:
    victim, attacker = visit(), visit()
    planted = "A" * 43
    victim.client.cookies.set("acromion_session_8080", planted)
    attacker.client.cookies.set("acromion_session_8080", planted)

    log_in_again(victim, clock)

    assert not is_in(attacker)


@pytest.mark.parametrize("way", ["login", "confirmation"])
def test_a_session_is_new_after_a_login_and_after_the_password_was_given_again(
    visitor: Visitor, clock: Clock, visit: Visit, way: str
) -> None:
    thief = copy_session(visitor, visit)
    clock.wait(60)

    if way == "login":
        log_in_again(visitor, clock)
    else:
        visitor.post("/confirm", proof=PASSWORD, next="/")

    assert (is_in(visitor), is_in(thief)) == (True, False)


def test_logging_out_ends_the_session_at_the_server(visitor: Visitor, visit: Visit) -> None:
    thief = copy_session(visitor, visit)

    answer = visitor.post("/logout")

    assert answer.headers["location"] == "/login"
    assert answer.headers["clear-site-data"] == '"cache", "storage"'
    assert not is_in(thief)


def test_a_session_ends_after_thirty_minutes_without_use(visitor: Visitor, clock: Clock) -> None:
    clock.wait(29 * MINUTE_S)
    assert is_in(visitor)
    clock.wait(31 * MINUTE_S)

    assert not is_in(visitor)


def test_what_a_page_asks_by_itself_keeps_no_session(visitor: Visitor, clock: Clock) -> None:
    for _ in range(31):
        clock.wait(MINUTE_S)
        visitor.client.get("/rows", headers={"x-unattended": "1"})

    assert not is_in(visitor)


@pytest.mark.parametrize("way", ["used", "confirmed"])
def test_a_session_ends_after_twelve_hours_of_use_or_confirmation(
    visitor: Visitor, clock: Clock, way: str
) -> None:
    for _ in range(35):
        clock.wait(20 * MINUTE_S)
        if way == "confirmed":
            visitor.post("/confirm", proof=PASSWORD, next="/")
        assert is_in(visitor)
    clock.wait(20 * MINUTE_S)

    assert not is_in(visitor)


def test_roles_and_the_end_of_a_person_hold_from_the_next_request_on(
    person: Person, visitor: Visitor, accounts: AccountStore
) -> None:
    accounts.set_roles(person.id, ["auditor"])
    assert visitor.client.get("/api/v1/recordings").status_code == 403
    accounts.end_person(person.id)

    assert not is_in(visitor)


def test_a_cookie_is_read_by_no_script_and_by_no_other_site(visitor: Visitor) -> None:
    cookie = next(cookie for cookie in visitor.client.cookies.jar if cookie.name == "acromion_session_8080")
    assert (cookie.path, cookie.secure, cookie.domain_specified) == ("/", False, False)
    assert cookie.has_nonstandard_attr("HttpOnly")
    assert cookie.get_nonstandard_attr("SameSite") == "lax"


def test_behind_tls_a_cookie_is_bound_to_this_very_host(
    add_person: AddPerson, visit_behind_proxy: Visit, clock: Clock, accounts: AccountStore
) -> None:
    session = accounts.begin_session(add_person().id)
    visitor, other = visit_behind_proxy(), visit_behind_proxy()
    ticket = read_ticket(visitor.submit_password("clara"))
    other.client.cookies.set("acromion_session_8080", session)  # without the prefix it opens nothing

    answer = visitor.post("/login/code", ticket=ticket, code=make_code(clock), next="/")

    set_cookies = answer.headers.get_list("set-cookie")
    assert sorted(cookie.partition("=")[0] for cookie in set_cookies) == [
        "__Host-acromion_browser_8080",
        "__Host-acromion_session_8080",
    ]
    assert all("Secure" in cookie and "Path=/" in cookie for cookie in set_cookies)
    assert not is_in(other)


@pytest.mark.parametrize(
    ("path", "form"),
    [
        ("/account/password", {"proof": PASSWORD, "password": "five yellow umbrellas"}),
        ("/account/sessions/end", {}),
    ],
)
def test_a_person_ends_the_other_sessions_by_a_new_password_or_by_will(
    two: tuple[Visitor, Visitor], path: str, form: dict[str, str]
) -> None:
    first, second = two

    second.post(path, **form)

    assert (is_in(first), is_in(second)) == (False, True)


def test_a_person_ends_one_session(two: tuple[Visitor, Visitor]) -> None:
    first, second = two
    shown = re.search(r'name="session" value="([0-9a-f]{64})"', second.get("/account").text)
    assert shown is not None

    second.post("/account/sessions/end", session=shown[1])

    assert (is_in(first), is_in(second)) == (False, True)


def test_nobody_ends_the_session_of_another(
    person: Person, add_person: AddPerson, enter: Enter, accounts: AccountStore
) -> None:
    add_person("dora")
    clara, dora = enter(), enter("dora")
    subject = accounts.find_by_session(clara.client.cookies["acromion_session_8080"])
    assert subject is not None

    dora.post("/account/sessions/end", session=subject.session)

    assert is_in(clara)


# Asked again for what cannot be undone.


ASKED_AGAIN = [
    ("GET", "/people"),
    ("POST", "/people"),
    ("POST", "/recordings/rec_x/purge"),
    ("GET", "/library/reports.zip"),
    ("GET", "/library/recordings.zip"),
    ("GET", "/library/summary.csv"),
    ("POST", "/library/acts/reports.zip"),
    ("GET", "/api/v1/batches/ba_x/summary.csv"),
    ("GET", "/api/v1/batches/ba_x/problems.csv"),
    ("GET", "/days/profile.csv?analysis=an_x"),
    ("GET", "/api/v1/profile/profile.json?analysis=an_x"),
    ("GET", "/api/v1/profile/profile.csv?analysis=an_x"),
    ("POST", "/api/v1/webhooks"),
    ("POST", "/api/v1/tokens"),
    ("POST", "/account/sessions/end"),
    ("DELETE", "/api/v1/recordings/rec_x?purge=now"),
]


def test_the_password_is_asked_for_again_after_ten_minutes(
    add_person: AddPerson, enter: Enter, clock: Clock
) -> None:
    add_person("clara", "clinician", "manager")
    visitor = enter()
    body = {"name": "x", "permissions": ["read"]}

    def find_asked() -> list[tuple[str, str]]:
        answers = {one: visitor.client.request(*one, json=body) for one in ASKED_AGAIN}
        return [
            one
            for one, answer in answers.items()
            if (answer.status_code, "E-CONFIRM" in answer.text) == (403, True)
        ]

    clock.wait(9 * MINUTE_S)
    early = find_asked()
    clock.wait(2 * MINUTE_S)

    assert (early, find_asked()) == ([], ASKED_AGAIN)


FREE = [
    *(f"/api/v1/analyses/an_x/{name}" for name in ("bundle.zip", "report.pdf", "summary.csv", "fhir.json")),
    "/api/v1/recordings/rec_x/file",
]


def test_a_file_of_one_recording_is_downloaded_without_the_password(visitor: Visitor, clock: Clock) -> None:
    clock.wait(11 * MINUTE_S)

    assert [visitor.client.get(address).status_code for address in FREE] == [404] * 5


def test_a_browser_is_led_to_the_question_and_back(add_person: AddPerson, enter: Enter, clock: Clock) -> None:
    add_person("clara", "clinician", "manager")
    visitor = enter()
    clock.wait(11 * MINUTE_S)

    led = visitor.get("/people")
    wrong = visitor.post("/confirm", proof="wrong wrong wrong", next="/people")
    right = visitor.post("/confirm", proof=PASSWORD, next="/people")

    assert led.headers["location"] == "/confirm?next=%2Fpeople"
    assert wrong.status_code == 401
    assert right.headers["location"] == "/people"
    assert visitor.get("/people").status_code == 200


def test_a_form_leads_back_to_the_page_it_stood_on(visitor: Visitor, clock: Clock) -> None:
    clock.wait(11 * MINUTE_S)

    led = visitor.client.post(
        "/recordings/rec_x/purge",
        headers={"accept": "text/html", "referer": "http://localhost:8080/trash?a=b"},
    )

    assert led.headers["location"] == "/confirm?next=%2Ftrash%3Fa%3Db"


def test_a_code_of_the_authenticator_confirms_once(visitor: Visitor, clock: Clock) -> None:
    clock.wait(60)

    answers = [visitor.post("/confirm", proof=make_code(clock), next="/").status_code for _ in range(2)]

    assert answers == [303, 401]


# Where somebody is led.


@pytest.mark.parametrize(
    ("role", "place"), [("manager", "/people"), ("auditor", "/trail"), ("employer", "/aggregate")]
)
def test_whoever_may_not_read_is_led_to_what_he_may_use(
    add_person: AddPerson, enter: Enter, role: str, place: str
) -> None:
    add_person("clara", role)

    assert enter().get("/").headers["location"] == place


def test_a_session_that_was_used_by_a_clock_that_was_ahead_has_ended(
    person: Person, accounts: AccountStore, clock: Clock
) -> None:
    cookie = accounts.begin_session(person.id)
    clock.wait(29 * MINUTE_S)
    assert accounts.find_by_session(cookie) is not None
    clock.wait(-20 * MINUTE_S)

    assert accounts.find_by_session(cookie) is None


def test_setting_the_clock_back_makes_no_session_younger() -> None:
    now_s = 0.0
    ages = SessionAges(lambda: now_s)
    is_over = [ages.is_over("s", 0.0)]
    now_s = 11.9 * 3600
    is_over.append(ages.is_over("s", 60.0))
    now_s = 12 * 3600
    is_over.append(ages.is_over("s", 60.0))

    assert is_over == [False, False, True]
