"""Servers that ask who comes: by the secret, or with people of every role in "own" and one of elsewhere."""

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient
from sqlalchemy import update

from app.access.accounts import LONGEST_S, AccountStore, hash_secret
from app.access.subjects import ROLES, Permission, Role
from app.access.tables import tokens
from app.jobs.trail import TrailQuestion, find_lines
from app.main import create_app, find_own_services
from app.services import Services
from app.settings import Settings

BASE = "http://localhost:8080"
OTHER = "org_other"


@dataclass
class House:
    """The server with its people; each is called by a name."""

    application: FastAPI
    accounts: AccountStore
    people: dict[str, str] = field(default_factory=dict)

    @property
    def services(self) -> Services:
        """The services of the organisation "own"."""
        return find_own_services(self.application)

    def find_services(self, organisation: str) -> Services:
        """Give the services of an organisation."""
        services: Services = self.application.state.offices.find(organisation)
        return services

    def add_person(self, name: str, *roles: Role, organisation: str = "own") -> str:
        """Add a person; gives the id."""
        person = self.accounts.add_person(organisation, name, name.title(), roles)
        self.people[name] = person.id
        return person.id

    def add_token(self, name: str, *permissions: Permission) -> str:
        """Add a token of a person that is good for an hour."""
        return self.accounts.add_token(self.people[name], f"of {name}", permissions, time.time() + 3600)

    def log_in(self, name: str) -> Mapping[str, str]:
        """Give the headers of a session that goes on."""
        cookie = self.accounts.begin_session(self.people[name])
        return {"Cookie": f"acromion_session={cookie}"}

    def log_in_too_long_ago(self, name: str, settings: Settings) -> Mapping[str, str]:
        """Give the headers of a session that is too old."""
        then = AccountStore(settings, clock=lambda: time.time() - LONGEST_S - 60)
        return {"Cookie": f"acromion_session={then.begin_session(self.people[name])}"}

    def revoke(self, bearer: str) -> None:
        """Revoke a token."""
        ended = update(tokens).where(tokens.c.hash == hash_secret(bearer)).values(ended_at="2026-01-01")
        with self.accounts._open().begin() as connection:
            connection.execute(ended)


@pytest.fixture
def house(settings: Settings, monkeypatch: pytest.MonkeyPatch) -> Iterator[House]:
    """A server with a person of each role, whose name is that of the role, and "other" elsewhere."""
    monkeypatch.delenv("ACROMION_NO_SECRET")
    guarded = settings.model_copy(update={"no_secret": False})
    accounts = AccountStore(guarded)
    accounts.add_organisation("own", "Own")
    accounts.add_organisation(OTHER, "Other")
    application = create_app(guarded)
    house = House(application, accounts)
    for role in ROLES:
        house.add_person(role, role)
    house.add_person("other", *ROLES, organisation=OTHER)
    with TestClient(application):
        while not any(find_lines(house.services.store.reader, TrailQuestion(act="server.started"))):
            time.sleep(0.02)
        yield house


@pytest.fixture
def caller(house: House) -> TestClient:
    """A client that brings nothing by itself."""
    return TestClient(house.application, BASE, raise_server_exceptions=False, follow_redirects=False)


@pytest.fixture
def settings(settings: Settings) -> Settings:
    """The settings of the other tests, with the secret."""
    return settings.model_copy(update={"no_secret": False})


@pytest.fixture
def guarded(settings: Settings) -> Iterator[TestClient]:
    """The application, called by somebody who brings nothing."""
    application = create_app(settings)
    with TestClient(
        application, base_url="http://localhost:8080", raise_server_exceptions=False, follow_redirects=False
    ) as caller:
        yield caller
