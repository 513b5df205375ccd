"""Servers that ask who comes, as every server does."""

from collections.abc import Iterator

import pytest
from fastapi.testclient import TestClient

from app.main import create_app
from app.settings import Settings


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
