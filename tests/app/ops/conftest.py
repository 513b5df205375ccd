"""The commands of an installation, called with the settings of the test."""

import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from app.cli import app
from app.settings import Settings

Acromion = Callable[..., Any]


@pytest.fixture
def acromion(settings: Settings, monkeypatch: pytest.MonkeyPatch) -> Acromion:
    """Call a command with the settings of the test."""
    for name, value in settings.as_environment().items():
        monkeypatch.setenv(name, value)

    def call(*arguments: object) -> Any:
        return CliRunner().invoke(app, [str(argument) for argument in arguments])

    return call


def lose_sqlite(settings: Settings) -> None:
    """Delete the database file."""
    for path in settings.data_dir.glob("acromion.sqlite3*"):
        path.unlink()


def read_subjects(path: Path) -> list[str]:
    connection = sqlite3.connect(path)
    found = [subject for (subject,) in connection.execute("SELECT subject FROM recordings")]
    connection.close()
    return found
