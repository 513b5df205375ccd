"""People log in by a real identity provider on loopback, which is not believed whatever it says."""

import shutil
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

import httpx2
import pytest

from acromion.app.accounts.accounts import AccountStore
from acromion.app.accounts.sign_in import CredentialStore
from acromion.app.settings import Settings
from tests.app.accounts.conftest import AddPerson, Clock, Visit, Visitor, open_server

FOLDER = Path(__file__).parent / "provider"
BACK = "http://localhost:8080/login/provider/back"
SECRET = "a secret of the client that is long enough"


class TestProvider:
    """``oidc-provider`` in a process of its own."""

    __test__ = False

    def __init__(self) -> None:
        node = shutil.which("node")
        if node is None or not (FOLDER / "node_modules" / "oidc-provider").is_dir():
            pytest.skip("node, or the npm package oidc-provider, is not installed")
        command = [node, str(FOLDER / "server.mjs"), BACK]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        assert self.process.stdout is not None
        self.issuer = f"http://127.0.0.1:{self.process.stdout.readline().strip()}"

    def say(self, *roles: str, **more: Any) -> None:
        """Say who logs in next, by ``account`` and roles, and with which lies."""
        answer = httpx2.post(f"{self.issuer}/control", json={"roles": roles} | more)
        assert answer.status_code == 200

    def log_in(self, address: str) -> str:
        """Go where the application sent the browser; gives where the provider sends it back to."""
        with httpx2.Client(follow_redirects=False, timeout=30) as browser:
            while not address.startswith(BACK):
                answer = browser.get(address)
                assert answer.status_code in (302, 303), answer.text
                address = str(answer.url.join(answer.headers["location"]))
        return address

    def stop(self) -> None:
        self.process.kill()
        self.process.wait()
        assert self.process.stdout is not None
        self.process.stdout.close()


@pytest.fixture(scope="module")
def provider() -> Iterator[TestProvider]:
    started = TestProvider()
    yield started
    started.stop()


@pytest.fixture
def clock() -> Clock:
    """The provider's tokens are of today."""
    return Clock(time.time())


@pytest.fixture
def settings(settings: Settings, provider: TestProvider) -> Settings:
    about = {"oidc_issuer": provider.issuer, "oidc_client_id": "acromion", "oidc_client_secret": SECRET}
    return settings.model_copy(update=about)


@pytest.fixture
def visit(settings: Settings, clock: Clock, add_person: AddPerson) -> Iterator[Visit]:
    """A server on which there is a manager already."""
    add_person("boss", "manager")
    with open_server(settings, clock) as opened:
        yield opened


def go(visitor: Visitor, path: str = "/login/provider?next=/account") -> str:
    """Begin; return the provider's address."""
    answer = visitor.get(path)
    assert answer.status_code == 303, answer.text
    return str(answer.headers["location"])


def come_back(visitor: Visitor, address: str) -> Any:
    return visitor.get(address.removeprefix("http://localhost:8080"))


def log_in(provider: TestProvider, visitor: Visitor, path: str = "/login/provider?next=/account") -> Any:
    """Go to the provider, log in there, and come back."""
    return come_back(visitor, provider.log_in(go(visitor, path)))


def enter(provider: TestProvider, visit: Visit, *roles: str, **more: Any) -> tuple[Visitor, Any]:
    """Say who logs in (Rosa, by default), and log them in in a browser of their own."""
    provider.say(*roles, **{"account": "rosa"} | more)
    visitor = visit()
    return visitor, log_in(provider, visitor)


def is_in(visitor: Visitor) -> bool:
    return visitor.client.get("/api/v1/version").status_code == 200


def test_a_person_is_made_at_the_first_login_with_the_roles_of_the_claim(
    provider: TestProvider, visit: Visit, settings: Settings, accounts: AccountStore
) -> None:
    visitor, answer = enter(provider, visit, "clinician", "auditor", "gardener")

    assert answer.headers["location"] == "/account"
    assert "Rosa" in visitor.get("/account").text
    person = accounts.find_person_of(provider.issuer, "rosa")
    assert person is not None
    assert person.roles == {"clinician", "auditor"}


def test_the_same_person_is_known_again(provider: TestProvider, visit: Visit, accounts: AccountStore) -> None:
    for roles in (["clinician"], ["researcher"]):
        enter(provider, visit, *roles)

    known = [person for person in accounts.find_people() if person.issuer]
    assert [person.roles for person in known] == [{"researcher"}]


def test_nobody_is_made_without_a_role(provider: TestProvider, visit: Visit, accounts: AccountStore) -> None:
    visitor, answer = enter(provider, visit, "gardener", account="stranger")

    assert answer.status_code == 403
    assert not is_in(visitor)
    assert accounts.find_person_of(provider.issuer, "stranger") is None


def test_whoever_has_no_role_any_more_is_ended_everywhere(
    provider: TestProvider, visit: Visit, accounts: AccountStore
) -> None:
    provider.say("clinician", account="rosa")
    first, second = visit(), visit()
    log_in(provider, first)
    assert is_in(first)

    provider.say(account="rosa")
    log_in(provider, second)

    assert not is_in(first)
    assert not is_in(second)


def test_an_ended_person_stays_out_whatever_the_provider_says(
    provider: TestProvider, visit: Visit, accounts: AccountStore
) -> None:
    visitor, _ = enter(provider, visit, "clinician")
    person = accounts.find_person_of(provider.issuer, "rosa")
    assert person is not None
    accounts.end_person(person.id)

    assert log_in(provider, visitor).status_code == 403
    assert not is_in(visitor)


def test_values_of_the_claim_are_translated(
    provider: TestProvider, settings: Settings, clock: Clock, add_person: AddPerson, accounts: AccountStore
) -> None:
    add_person("boss", "manager")
    provider.say("GRP-PHYSIO", "manager", account="rosa")
    translated = settings.model_copy(update={"oidc_roles": "GRP-PHYSIO=clinician, GRP-IT=manager"})

    with open_server(translated, clock) as visit:
        visitor = visit()
        log_in(provider, visitor)

    person = accounts.find_person_of(provider.issuer, "rosa")
    assert person is not None
    assert person.roles == {"clinician"}


LIES = {
    "issuer": {"lie": {"iss": "http://127.0.0.1:1"}},
    "audience": {"lie": {"aud": "another"}},
    "no audience": {"lie": {"aud": None}},
    "several audiences, another party": {"lie": {"aud": ["acromion", "another"], "azp": "another"}},
    "several audiences, no party": {"lie": {"aud": ["acromion", "another"]}},
    "nonce": {"lie": {"nonce": "of another login"}},
    "no nonce": {"lie": {"nonce": None}},
    "expired": {"lie": {"exp": 1_600_000_000}},
    "no end": {"lie": {"exp": None}},
    "of tomorrow": {"lie": {"iat": 4_000_000_000}},
    "nobody": {"lie": {"sub": None}},
    "unsigned": {"unsigned": True},
}


@pytest.mark.parametrize("lie", LIES.values(), ids=LIES.keys())
def test_a_token_that_is_not_to_be_believed_lets_nobody_in(
    provider: TestProvider, visit: Visit, lie: dict[str, Any]
) -> None:
    visitor, answer = enter(provider, visit, "clinician", **lie)

    assert answer.status_code == 401
    assert not is_in(visitor)


def test_the_lies_of_these_tests_are_signed_as_the_truth_is(provider: TestProvider, visit: Visit) -> None:
    visitor, _ = enter(provider, visit, "clinician", lie={"name": "Rosalind"})

    assert "Rosalind" in visitor.get("/account").text


def test_an_answer_counts_once_and_its_code_too_even_with_a_fresh_state(
    provider: TestProvider, visit: Visit
) -> None:
    provider.say("clinician", account="rosa")
    visitor = visit()
    back = provider.log_in(go(visitor))
    code = parse_qs(urlsplit(back).query)["code"][0]
    come_back(visitor, back)
    visitor.post("/logout")
    assert come_back(visitor, back).status_code == 401
    state = parse_qs(urlsplit(go(visitor)).query)["state"][0]

    answer = come_back(visitor, f"{BACK}?code={code}&state={state}&iss={provider.issuer}")

    assert answer.status_code == 401
    assert not is_in(visitor)


def test_an_answer_for_another_browser_is_refused(provider: TestProvider, visit: Visit) -> None:
    provider.say("clinician", account="rosa")
    attacker, victim = visit(), visit()
    back = provider.log_in(go(attacker))

    assert come_back(victim, back).status_code == 401
    assert not is_in(victim)


@pytest.mark.parametrize("name", ["state", "iss", "code"])
def test_an_answer_with_a_wrong_part_is_refused(provider: TestProvider, visit: Visit, name: str) -> None:
    provider.say("clinician", account="rosa")
    visitor = visit()
    told = {key: values[0] for key, values in parse_qs(urlsplit(provider.log_in(go(visitor))).query).items()}

    answer = come_back(visitor, f"{BACK}?{httpx2.QueryParams(told | {name: 'wrong'})}")

    assert answer.status_code == 401
    assert not is_in(visitor)


def test_an_answer_after_ten_minutes_is_too_late(provider: TestProvider, visit: Visit, clock: Clock) -> None:
    provider.say("clinician", account="rosa")
    visitor = visit()
    back = provider.log_in(go(visitor))

    clock.wait(601)

    assert come_back(visitor, back).status_code == 401


def test_the_provider_is_asked_with_pkce_and_a_nonce(provider: TestProvider, visit: Visit) -> None:
    asked = parse_qs(urlsplit(go(visit())).query)

    assert asked["code_challenge_method"] == ["S256"]
    assert asked["response_type"] == ["code"]
    assert len(asked["code_challenge"][0]) == 43
    assert len(asked["nonce"][0]) == 43


@pytest.mark.parametrize(
    ("issuer", "told"),
    [
        ("http://localhost:{port}", ""),  # another name of the provider
        ("http://login.clinic.example", ""),  # without TLS beyond this computer
        ("http://127.0.0.1:9", "does not answer"),
    ],
)
def test_a_provider_of_another_name_without_tls_or_away_is_not_asked(
    provider: TestProvider, settings: Settings, clock: Clock, add_person: AddPerson, issuer: str, told: str
) -> None:
    add_person("boss", "manager")
    other = {"oidc_issuer": issuer.format(port=urlsplit(provider.issuer).port)}

    with open_server(settings.model_copy(update=other), clock) as visit:
        answer = visit().get("/login/provider")

    assert answer.status_code == 401
    assert told in answer.text


def test_who_logs_in_by_the_provider_proves_it_again_there(
    provider: TestProvider, visit: Visit, clock: Clock
) -> None:
    visitor, _ = enter(provider, visit, "manager")
    clock.wait(11 * 60)
    assert visitor.get("/people").headers["location"] == "/confirm?next=%2Fpeople"
    provider.say("manager", account="rosa", lie={"auth_time": int(clock())})  # its clock is the real one

    back = provider.log_in(go(visitor, "/confirm/provider?next=/people"))
    answer = come_back(visitor, back)
    clock.wait(9 * 60 + 50)

    assert answer.headers["location"] == "/people"
    assert visitor.get("/people").status_code == 200


def test_an_old_proof_of_the_provider_confirms_nothing(
    provider: TestProvider, visit: Visit, clock: Clock
) -> None:
    visitor, _ = enter(provider, visit, "manager")
    provider.say("manager", account="rosa", lie={"auth_time": int(clock()) - 3600})

    answer = log_in(provider, visitor, "/confirm/provider?next=/people")

    assert answer.status_code == 401


def test_somebody_else_confirms_nothing(provider: TestProvider, visit: Visit, clock: Clock) -> None:
    visitor, _ = enter(provider, visit, "manager")
    provider.say("manager", account="mallory")

    clock.wait(590)

    answer = log_in(provider, visitor, "/confirm/provider?next=/people")
    clock.wait(20)

    assert answer.status_code == 401
    assert visitor.get("/people").status_code == 303


def test_a_person_of_the_provider_has_no_password(
    provider: TestProvider, visit: Visit, accounts: AccountStore
) -> None:
    visitor, _ = enter(provider, visit, "clinician")
    person = accounts.find_person_of(provider.issuer, "rosa")
    assert person is not None

    found = CredentialStore(accounts).find_of(person.id)

    assert found is not None
    assert found.password_hash is None
    assert 'name="proof"' not in visitor.get("/account").text


def test_the_secret_of_the_client_goes_to_no_worker(settings: Settings) -> None:
    chosen = Settings(oidc_client_secret=SECRET, oidc_issuer="https://login.clinic.example")

    assert SECRET not in chosen.as_environment().values()
    assert SECRET not in repr(settings)
