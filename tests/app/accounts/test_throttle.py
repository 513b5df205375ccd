"""Guessing is slow, and nobody's guesses lock anybody else out."""

import hashlib
import json

import pytest
from sqlalchemy import select

from acromion.app.accounts import passwords
from acromion.app.accounts.accounts import AccountStore, Person
from acromion.app.accounts.sign_in import LOG_PERIOD_S, Budget, Caller, SignIn, limit_address
from acromion.app.errors import LoginRefused, TooManyTries
from acromion.app.library.audit_log import NOBODY, acting
from acromion.app.library.database.tables import audit_log, tries
from acromion.app.settings import Settings
from tests.app.accounts.conftest import PASSWORD, AddPerson, Clock, Visit, Visitor, make_code, read_ticket
from tests.app.conftest import on_both_databases

STRANGER = Caller("203.0.113.9", "")


@pytest.fixture
def hashes(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Every password that was hashed for a comparison, in order; the real function does it."""
    seen: list[str] = []
    real = passwords.verify_password

    def verify(kept: str | None, password: str) -> bool:
        seen.append(password)
        return real(kept, password)

    monkeypatch.setattr(passwords, "verify_password", verify)
    return seen


def guess(sign_in: SignIn, login: str, password: str = "wrong", caller: Caller = STRANGER) -> str:
    """Try once; return the code of the refusal."""
    try:
        sign_in.submit_password(login, password, caller)
    except (LoginRefused, TooManyTries) as refusal:
        return refusal.code
    return "in"


@pytest.mark.parametrize("way", ["one address", "one name"])
def test_guesses_for_500_s_from_one_address_or_of_one_name_cost_at_most_twenty_hashes(
    person: Person, sign_in: SignIn, hashes: list[str], clock: Clock, way: str
) -> None:
    for number in range(250):
        caller = Caller(f"198.51.100.{number}", "")
        if way == "one address":
            guess(sign_in, f"person{number}", f"guess {number}")
        else:
            guess(sign_in, "clara", f"guess {number}", caller)
        clock.wait(2.0)

    assert 10 <= len(hashes) <= 20


def test_a_known_browser_gets_in_while_strangers_guess(person: Person, sign_in: SignIn) -> None:
    known = Caller("192.0.2.1", sign_in.enter(person.id, Caller("192.0.2.1", "")).browser)
    for number in range(50):
        guess(sign_in, "clara", caller=Caller(f"203.0.113.{number}", ""))

    assert guess(sign_in, "clara", PASSWORD, Caller("192.0.2.2", "")) == "E-TRIES"
    assert guess(sign_in, "clara", PASSWORD, known) == "in"


def test_a_known_browser_gets_in_from_an_address_that_guesses(person: Person, sign_in: SignIn) -> None:
    browser = sign_in.enter(person.id, STRANGER).browser
    for number in range(50):
        guess(sign_in, f"person{number}")

    assert guess(sign_in, "clara", PASSWORD, Caller(STRANGER.address, browser)) == "in"


def test_a_known_browser_has_no_budget_for_other_people(sign_in: SignIn, add_person: AddPerson) -> None:
    browser = sign_in.enter(add_person().id, STRANGER).browser
    add_person("dora")

    tried = [guess(sign_in, "dora", caller=Caller(STRANGER.address, browser)) for _ in range(6)]

    assert tried == ["E-LOGIN"] * 5 + ["E-TRIES"]


def test_a_known_browser_may_not_guess_without_end(
    sign_in: SignIn, add_person: AddPerson, hashes: list[str]
) -> None:
    browser = sign_in.enter(add_person().id, STRANGER).browser

    for _ in range(100):
        guess(sign_in, "clara", caller=Caller(STRANGER.address, browser))

    assert len(hashes) <= 20


def test_the_name_of_a_known_browser_changes_with_each_login(person: Person, sign_in: SignIn) -> None:
    first = sign_in.enter(person.id, STRANGER).browser

    second = sign_in.enter(person.id, Caller(STRANGER.address, first)).browser

    assert sign_in.credentials.knows_browser(second, person.id)
    assert not sign_in.credentials.knows_browser(first, person.id)


def test_people_who_share_a_browser_are_each_known_in_it(sign_in: SignIn, add_person: AddPerson) -> None:
    clara, dora = add_person(), add_person("dora")
    first = sign_in.enter(clara.id, STRANGER).browser

    shared = sign_in.enter(dora.id, Caller(STRANGER.address, first)).browser

    assert sign_in.credentials.knows_browser(shared, clara.id)
    assert sign_in.credentials.knows_browser(shared, dora.id)


def test_an_account_of_ones_own_does_not_clear_the_address(
    sign_in: SignIn, add_person: AddPerson, hashes: list[str]
) -> None:
    add_person("mallory", has_second_factor=False)
    for number in range(200):
        guess(sign_in, f"person{number}")
        if number % 5 == 0:
            guess(sign_in, "mallory", PASSWORD)

    assert len(hashes) <= 20


def test_the_right_password_does_not_clear_wrong_codes(person: Person, sign_in: SignIn, clock: Clock) -> None:
    refused = []
    for number in range(7):
        caller = Caller(f"198.51.100.{number}", "")
        step = sign_in.submit_password("clara", PASSWORD, caller)
        try:
            sign_in.submit_code(step.ticket, "000000", caller)
        except (LoginRefused, TooManyTries) as refusal:
            refused.append(refusal.code)

    assert refused == ["E-LOGIN"] * 5 + ["E-TRIES"] * 2


def test_delays_double_up_to_the_longest() -> None:
    budget = Budget("address:x", 10, 900.0)

    delays = [budget.find_delay_s(failures) for failures in (9, 10, 11, 12, 19, 20, 40)]
    assert delays == [0.0, 1.0, 2.0, 4.0, 512.0, 900.0, 900.0]


def test_many_tries_at_once_are_counted_one_by_one_and_forgiven_after_an_hour_of_silence(
    sign_in: SignIn, clock: Clock
) -> None:
    budget = limit_address("203.0.113.1")
    sign_in.throttle.refund([budget])  # without rows

    for _ in range(2):
        taken = 0
        for _ in range(30):  # none of them has been looked at yet
            try:
                sign_in.throttle.take([budget])
                taken += 1
            except TooManyTries:
                pass
        assert taken == 10
        clock.wait(3700)


def test_addresses_of_one_network_of_ipv6_share_a_budget() -> None:
    assert limit_address("2001:db8::1").key == limit_address("2001:db8::ffff:2").key
    assert limit_address("2001:db8::1").key != limit_address("2001:db8:0:1::1").key


def test_a_name_that_was_typed_is_not_kept(sign_in: SignIn, settings: Settings) -> None:
    guess(sign_in, "my password by mistake")

    kept = (settings.data_dir / "acromion.sqlite3").read_bytes()
    kept += (settings.data_dir / "acromion.sqlite3-wal").read_bytes()
    assert b"my password" not in kept


def test_a_name_that_was_typed_is_not_confirmed_by_a_digest(
    person: Person, sign_in: SignIn, accounts: AccountStore
) -> None:
    for _ in range(7):
        guess(sign_in, "hunter2")

    keys = find_keys(accounts)
    assert sum(key.startswith(("account:", "told:account:")) for key in keys) == 3
    assert [key for key in keys if hashlib.sha256(b"hunter2").hexdigest() in key] == []


def find_keys(accounts: AccountStore) -> list[str]:
    """Return the key under which tries are counted."""
    return [row.key for row in accounts.database.read_all(select(tries.c.key))]


@on_both_databases
def test_two_servers_count_the_tries_of_a_name_together(
    person: Person, sign_in: SignIn, settings: Settings, clock: Clock
) -> None:
    other = SignIn(AccountStore(settings, clock), settings)

    told = [
        guess(server, "clara", caller=Caller(f"{network}.{number}", ""))
        for server, network in ((sign_in, "198.51.100"), (other, "203.0.113"))
        for number in range(3)
    ]
    other.accounts.database.close()

    assert told == ["E-LOGIN"] * 5 + ["E-TRIES"]


def test_the_page_says_how_long_to_wait(person: Person, visit: Visit) -> None:
    visitor = visit()
    for _ in range(5):
        visitor.submit_password("clara", "wrong wrong wrong")

    answer = visitor.submit_password("clara", "wrong wrong wrong")

    assert (answer.status_code, answer.headers["retry-after"]) == (429, "1")


@pytest.mark.parametrize(
    ("browsers", "forwarded"),
    [("visit_behind_proxy", "10.0.0.{}, 203.0.113.9"), ("visit", "203.0.113.{}")],
    ids=["named proxy", "stranger"],
)
def test_the_last_address_of_a_named_proxy_counts_and_what_a_stranger_says_does_not(
    person: Person, request: pytest.FixtureRequest, browsers: str, forwarded: str
) -> None:
    visitor: Visitor = request.getfixturevalue(browsers)()

    answers = []
    for number in range(11):
        form = {"login": f"person{number}", "password": "wrong wrong wrong"}
        headers = {"x-forwarded-for": forwarded.format(number)}
        answers.append(visitor.client.post("/login", data=form, headers=headers).status_code)

    assert answers == [401] * 10 + [429]


def test_confirming_is_throttled_too(visitor: Visitor, hashes: list[str]) -> None:
    for _ in range(100):
        visitor.post("/confirm", proof="wrong wrong wrong", next="/")

    assert len(hashes) <= 21


def test_codes_from_one_ticket_are_throttled(
    person: Person, visit: Visit, clock: Clock, sign_in: SignIn
) -> None:
    visitor = visit()
    ticket = read_ticket(visitor.submit_password("clara"))

    answers = [
        visitor.post("/login/code", ticket=ticket, code="000000", next="/").status_code for _ in range(6)
    ]
    late = visitor.post("/login/code", ticket=ticket, code=make_code(clock), next="/")

    assert answers == [401] * 5 + [429]
    assert late.status_code == 429
    assert [told for *_, told in find_notes(sign_in)] == [{"by": "code", "person": person.id}]


# What of it is in the audit log.


def find_notes(sign_in: SignIn) -> list[tuple[str, dict[str, str]]]:
    """Return what the audit log says of tries that had to wait: who, codes."""
    query = select(audit_log).where(audit_log.c.act == "login.throttled")
    return [(row.who, json.loads(row.other)) for row in sign_in.accounts.database.read_all(query)]


@pytest.mark.parametrize(
    ("login", "address", "told"),
    [
        ("clara", "198.51.100.{}", {"by": "account", "person": "clara"}),
        ("person{}", STRANGER.address, {"by": "address"}),
        ("canary", "198.51.100.{}", {"by": "account"}),  # nobody has this name
    ],
)
def test_tries_that_have_to_wait_are_one_line_with_the_person_if_there_is_one(
    person: Person, sign_in: SignIn, login: str, address: str, told: dict[str, str]
) -> None:
    with acting(NOBODY):
        for number in range(20):
            guess(sign_in, login.format(number), caller=Caller(address.format(number), ""))

    expected = told | {"person": person.id} if "person" in told else told
    assert find_notes(sign_in) == [(NOBODY, expected)]


def test_a_quarter_of_an_hour_later_it_is_a_line_again(person: Person, sign_in: SignIn, clock: Clock) -> None:
    for _ in range(2):
        for _ in range(30):
            guess(sign_in, "clara")
        clock.wait(LOG_PERIOD_S)

    assert len(find_notes(sign_in)) == 2


def test_a_second_server_does_not_tell_it_again(
    person: Person, sign_in: SignIn, settings: Settings, clock: Clock
) -> None:
    other = SignIn(AccountStore(settings, clock), settings)

    for server in (sign_in, other):
        for _ in range(20):
            guess(server, "clara")
    other.accounts.database.close()

    assert len(find_notes(sign_in)) == 1


def test_a_new_browser_gets_in_while_one_address_polls_with_wrong_passwords(
    person: Person, sign_in: SignIn, clock: Clock
) -> None:
    got_in = []
    for minute in range(60):
        for _ in range(10):
            guess(sign_in, "clara")
            clock.wait(6.0)
        got_in.append(guess(sign_in, "clara", PASSWORD, Caller(f"198.51.100.{minute}", "")))

    assert got_in == ["in"] * 60


# A clock that was ahead and is corrected.


DAYS_400_S = 400 * 24 * 3600.0


def test_a_wait_lasts_at_most_its_maximum_after_the_clock_was_set_back(
    person: Person, sign_in: SignIn, clock: Clock
) -> None:
    clock.wait(DAYS_400_S)
    while guess(sign_in, "clara") != "E-TRIES":
        continue
    clock.wait(-DAYS_400_S)
    waits = guess(sign_in, "clara")
    clock.wait(901.0)

    assert waits == "E-TRIES"
    assert guess(sign_in, "clara", PASSWORD) == "in"


def test_forgotten_tries_let_a_person_sign_in_at_once(person: Person, sign_in: SignIn) -> None:
    while guess(sign_in, "clara") != "E-TRIES":
        continue

    sign_in.forget_tries(person)

    assert guess(sign_in, "clara", PASSWORD, Caller("198.51.100.7", "")) == "in"


def test_a_code_is_right_after_the_clock_was_set_back_and_still_counts_once(
    person: Person, sign_in: SignIn, clock: Clock
) -> None:
    def enter_with_code() -> str:
        caller = Caller("198.51.100.7", "")
        ticket = sign_in.submit_password("clara", PASSWORD, caller).ticket
        try:
            sign_in.submit_code(ticket, make_code(clock), caller)
        except LoginRefused as refusal:
            return refusal.code
        return "in"

    clock.wait(DAYS_400_S)
    ahead = enter_with_code()
    clock.wait(-DAYS_400_S)

    assert [ahead, enter_with_code(), enter_with_code()] == ["in", "in", "E-LOGIN"]
