"""The commands of an installation, called with the settings of the test."""

import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from acromion.app.cli import app
from acromion.app.library.jobs import JobStore
from acromion.app.library.rows import Job
from acromion.app.ops.recover import update_side_files
from acromion.app.queue.worker import run_next
from acromion.app.settings import Settings
from acromion.app.store.folder import Storage
from tests.app import stand_ins
from tests.app.conftest import AddJob, OpenWorker

Acromion = Callable[..., Any]


@pytest.fixture
def acromion(settings: Settings, monkeypatch: pytest.MonkeyPatch) -> Acromion:
    """Call a command with the settings of the test."""
    for name, value in settings.as_environment().items():
        monkeypatch.setenv(name, value)

    def call(*arguments: object) -> Any:
        return CliRunner().invoke(app, [str(argument) for argument in arguments])

    return call


@pytest.fixture
def finished(store: JobStore, storage: Storage, add_job: AddJob, open_worker: OpenWorker) -> Job:
    """An analysis with its files."""
    job = add_job(b"the recording", file_name="Équipe 1.gt3x")
    run_next(open_worker(stand_ins.write_report))
    update_side_files(store, storage)
    return store.get(job.id)


def lose_sqlite(settings: Settings) -> None:
    """Delete the database file."""
    for path in settings.data_dir.glob("acromion.sqlite3*"):
        path.unlink()


def read_subjects(path: Path) -> list[str]:
    connection = sqlite3.connect(path)
    found = [subject for (subject,) in connection.execute("SELECT subject FROM recordings")]
    connection.close()
    return found
