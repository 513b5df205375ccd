"""Servers that ask who comes: by the secret, people who log in, and a house with people of every role."""

import re
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field

import pyotp
import pytest
from argon2 import PasswordHasher
from fastapi import FastAPI
from fastapi.testclient import TestClient
from httpx2 import Response
from sqlalchemy import update

from acromion.app.accounts import passwords
from acromion.app.accounts.accounts import LONGEST_S, AccountStore, Person, hash_secret
from acromion.app.accounts.passwords import hash_password
from acromion.app.accounts.sign_in import SignIn
from acromion.app.accounts.subjects import ROLES, Permission, Role
from acromion.app.library.audit_log import AuditFilter, find_lines
from acromion.app.library.database.tables import tokens
from acromion.app.main import create_app
from acromion.app.services import Services
from acromion.app.settings import Settings

PASSWORD = "seven green bicycles"
SECRET = "JBSWY3DPEHPK3PXPJBSWY3DPEHPK3PXP"
NOON_S = 1_790_000_000.0


@dataclass
class Clock:
    """A clock that only the test moves."""

    now_s: float = NOON_S

    def __call__(self) -> float:
        return self.now_s

    def wait(self, seconds: float) -> None:
        self.now_s += seconds


@dataclass
class Visitor:
    """A browser, and what it was last shown."""

    client: TestClient
    codes: list[str] = field(default_factory=list)

    def post(self, path: str, **form: str | list[str]) -> Response:
        return self.client.post(path, data=form, headers={"accept": "text/html"})

    def get(self, path: str) -> Response:
        return self.client.get(path, headers={"accept": "text/html"})

    def submit_password(self, login: str, password: str = PASSWORD) -> Response:
        return self.post("/login", login=login, password=password, next="/account")


Visit = Callable[[], Visitor]
Enter = Callable[..., Visitor]
AddPerson = Callable[..., Person]


def read_ticket(answer: Response) -> str:
    """Return the hidden ticket of a form."""
    found = re.search(r'name="ticket" value="([^"]+)"', answer.text)
    assert found is not None, answer.text
    return found[1]


def make_code(clock: Clock, step: int = 0, secret: str = SECRET) -> str:
    """Return the code that an authenticator shows, some steps from now."""
    return pyotp.TOTP(secret).at(int(clock()) + 30 * step)


@pytest.fixture
def settings(settings: Settings) -> Settings:
    """The settings of the other tests, with the secret."""
    return settings.model_copy(update={"no_secret": False})


@pytest.fixture
def client(settings: Settings) -> Iterator[TestClient]:
    """The application, called by whoever is at the machine."""
    application = create_app(settings)
    secret = (settings.data_dir / "secret").read_text()
    with TestClient(
        application,
        base_url="http://localhost:8080",
        headers={"Authorization": f"Bearer {secret}"},
        raise_server_exceptions=False,
        follow_redirects=False,
    ) as caller:
        yield caller


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def accounts(settings: Settings, clock: Clock) -> Iterator[AccountStore]:
    """The accounts of the installation, without anybody."""
    opened = AccountStore(settings, clock)
    yield opened
    opened.database.close()


@pytest.fixture
def sign_in(accounts: AccountStore, settings: Settings) -> SignIn:
    return SignIn(accounts, settings)


@pytest.fixture(autouse=True, scope="package")
def cheap_hashes() -> Iterator[None]:
    """Hash passwords at the least cost, in all tests of this folder."""
    cheap = PasswordHasher(time_cost=1, memory_cost=8, parallelism=1)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(passwords, "_HASHER", cheap)
        patched.setattr(passwords, "_NOBODY", cheap.hash("of nobody"))
        yield


@pytest.fixture(scope="package")
def password_hash(cheap_hashes: None) -> str:
    """The hash of everybody's password, computed once."""
    return hash_password(PASSWORD)


@pytest.fixture
def add_person(accounts: AccountStore, sign_in: SignIn, password_hash: str) -> AddPerson:
    """Add a person with a password and an authenticator."""

    def add(login: str = "clara", *roles: Role, has_second_factor: bool = True) -> Person:
        person = accounts.add_person(login, login.title(), roles or ("clinician",))
        sign_in.credentials.set_password(person.id, password_hash)
        if has_second_factor:
            sign_in.credentials.set_second_factor(person.id, SECRET, 0, ())
        return accounts.get_person(person.id)

    return add


@pytest.fixture
def person(add_person: AddPerson) -> Person:
    """Clara, a clinician with a password and an authenticator."""
    return add_person()


@contextmanager
def open_server(settings: Settings, clock: Clock, address: str = "192.0.2.1") -> Iterator[Visit]:
    """Open browsers, which all have one address, at one server."""
    application = create_app(settings, clock)
    opened: list[TestClient] = []
    scheme = "https" if settings.proxy else "http"

    def open_browser() -> Visitor:
        browser = TestClient(
            application,
            base_url=f"{scheme}://localhost:8080",
            raise_server_exceptions=False,
            follow_redirects=False,
            client=(address, 50000),
        )
        opened.append(browser)
        return Visitor(browser)

    with open_browser().client:
        yield open_browser
    for browser in opened:
        browser.close()


@pytest.fixture
def visit(settings: Settings, clock: Clock) -> Iterator[Visit]:
    """Open browsers at a server."""
    with open_server(settings, clock) as opened:
        yield opened


@pytest.fixture
def visit_behind_proxy(settings: Settings, clock: Clock) -> Iterator[Visit]:
    """Open browsers at a server behind a proxy that ends TLS."""
    with open_server(settings.model_copy(update={"proxy": "127.0.0.1"}), clock, "127.0.0.1") as opened:
        yield opened


@pytest.fixture
def guarded(visit: Visit) -> TestClient:
    """The application, called by somebody who brings nothing."""
    return visit().client


@pytest.fixture
def enter(visit: Visit, clock: Clock) -> Enter:
    """Log somebody in in a browser of his own, with both steps."""

    def log_in(login: str = "clara") -> Visitor:
        visitor = visit()
        asked = visitor.submit_password(login)
        answer = visitor.post(
            "/login/code", ticket=read_ticket(asked), code=make_code(clock), next="/account"
        )
        assert answer.status_code == 303, answer.text
        return visitor

    return log_in


@pytest.fixture
def visitor(person: Person, enter: Enter) -> Visitor:
    """A browser in which Clara is logged in."""
    return enter()


BASE = "http://localhost:8080"


@dataclass
class House:
    """The server with its people; each is called by a name."""

    application: FastAPI
    accounts: AccountStore
    people: dict[str, str] = field(default_factory=dict)

    @property
    def services(self) -> Services:
        """The services of the server."""
        services: Services = self.application.state.services
        return services

    def add_person(self, name: str, *roles: Role) -> str:
        """Add a person; return the id."""
        person = self.accounts.add_person(name, name.title(), roles)
        self.people[name] = person.id
        return person.id

    def add_token(self, name: str, *permissions: Permission) -> str:
        """Add a token of a person that is good for an hour."""
        return self.accounts.add_token(self.people[name], f"of {name}", permissions, time.time() + 3600)

    def log_in(self, name: str) -> Mapping[str, str]:
        """Return the headers of a session that goes on."""
        cookie = self.accounts.begin_session(self.people[name])
        return {"Cookie": f"acromion_session_8080={cookie}"}

    def log_in_too_long_ago(self, name: str, settings: Settings) -> Mapping[str, str]:
        """Return the headers of a session that is too old."""
        then = AccountStore(settings, clock=lambda: time.time() - LONGEST_S - 60)
        return {"Cookie": f"acromion_session_8080={then.begin_session(self.people[name])}"}

    def revoke(self, bearer: str) -> None:
        """Revoke a token."""
        ended = update(tokens).where(tokens.c.hash == hash_secret(bearer)).values(ended_at="2026-01-01")
        with self.accounts.database.write() as connection:
            connection.execute(ended)


@pytest.fixture
def house(settings: Settings, monkeypatch: pytest.MonkeyPatch) -> Iterator[House]:
    """A server with a person of each role, whose name is that of the role."""
    monkeypatch.delenv("ACROMION_NO_SECRET")
    guarded = settings.model_copy(update={"no_secret": False})
    accounts = AccountStore(guarded)
    application = create_app(guarded)
    house = House(application, accounts)
    for role in ROLES:
        house.add_person(role, role)
    with TestClient(application):
        while not any(find_lines(house.services.store.reader, AuditFilter(act="server.started"))):
            time.sleep(0.02)
        yield house


@pytest.fixture
def caller(house: House) -> TestClient:
    """A client that brings nothing by itself."""
    return TestClient(house.application, BASE, raise_server_exceptions=False, follow_redirects=False)
