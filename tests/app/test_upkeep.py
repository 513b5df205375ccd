"""Backup, restore, verify, doctor: on both set-ups, as commands."""

import json
import os
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import text
from typer.testing import CliRunner

from app.cli import app
from app.jobs.database import connect
from app.jobs.job import Job, JobState
from app.jobs.lease import identify_self
from app.jobs.store import JobStore
from app.jobs.tables import REVISION
from app.jobs.worker import run_next
from app.report.wording import load_wording
from app.settings import Settings
from app.storage import FolderLock, Storage
from tests.app import stand_ins
from tests.app.conftest import AddJob, OpenBench, on_both_set_ups
from tests.postgres import PostgresServer
from tests.swift import SwiftServer

Acromion = Callable[..., Any]


@pytest.fixture
def acromion(settings: Settings, monkeypatch: pytest.MonkeyPatch) -> Acromion:
    """Call a command with the settings of the test."""
    for name, value in settings.as_environment().items():
        monkeypatch.setenv(name, value)
    return lambda *arguments: CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.fixture
def finished(store: JobStore, add_job: AddJob, bench: OpenBench) -> Job:
    """An analysis with its files."""
    job = add_job(b"the recording", file_name="Équipe 1.gt3x")
    run_next(bench(stand_ins.write_report))
    return store.get(job.id)


def empty_everything(settings: Settings, request: pytest.FixtureRequest) -> Settings:
    """Give settings of an empty place of the same kind."""
    changes: dict[str, object] = {"data_dir": settings.data_dir.with_name("restored")}
    if settings.object_store:
        swift: SwiftServer = request.getfixturevalue("swift")
        postgres: PostgresServer = request.getfixturevalue("postgres")
        postgres.empty()
        return settings.model_copy(update=changes | {"object_store": swift.make_bucket()})
    address = f"sqlite:///{settings.data_dir.with_name('restored') / 'acromion.sqlite3'}"
    return settings.model_copy(update=changes | {"database_url": address})


@on_both_set_ups
def test_a_restored_backup_holds_every_row_and_every_byte(
    finished: Job, settings: Settings, acromion: Acromion, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    assert acromion("backup", tmp_path / "b.zip").exit_code == 0
    new = empty_everything(settings, request)
    os.environ.update(new.as_environment())  # put right again by the fixture that set them first

    restored = acromion("restore", tmp_path / "b.zip")

    assert restored.exit_code == 0, restored.output
    assert acromion("verify").exit_code == 0
    store = JobStore(new.database_url)
    assert store.get(finished.id) == finished
    store.close()


@on_both_set_ups
def test_verify_counts_what_it_read(finished: Job, acromion: Acromion) -> None:
    result = acromion("verify")

    assert (result.exit_code, result.output.split()[0]) == (0, str(1 + 2 + len(stand_ins.EXPORTS) + 6))


@on_both_set_ups
def test_verify_names_a_missing_recording(finished: Job, storage: Storage, acromion: Acromion) -> None:
    storage.drop_recording(finished.recording_id)

    result = acromion("verify")

    assert result.exit_code == 1
    assert f"MISSING recordings/{finished.recording_id}" in result.output


def test_verify_names_a_damaged_recording(finished: Job, settings: Settings, acromion: Acromion) -> None:
    (settings.data_dir / "recordings" / finished.recording_id).write_bytes(b"the Recording")

    result = acromion("verify", "--lang", "fr")

    assert result.exit_code == 1
    assert f"ENDOMMAGÉ recordings/{finished.recording_id}" in result.output


@on_both_set_ups
@pytest.mark.parametrize("name", ["recordings/rec_stray", "analyses/an_gone/t1/results.json"])
def test_verify_names_a_file_without_a_row(
    finished: Job, storage: Storage, acromion: Acromion, tmp_path: Path, name: str
) -> None:
    (tmp_path / "stray").write_bytes(b"left over")
    storage.put(tmp_path / "stray", name)

    result = acromion("verify")

    assert result.exit_code == 1
    assert f"ORPHAN {name}" in result.stdout


def test_verify_leaves_alone_what_an_attempt_under_way_is_making(
    store: JobStore, storage: Storage, add_job: AddJob, acromion: Acromion
) -> None:
    add_job(b"the recording")
    job = store.claim(identify_self())
    assert job is not None
    assert job.token is not None
    (storage.open_attempt(job.id, job.token) / "results.json").write_text("{}")

    assert acromion("verify").exit_code == 0


def test_verify_reads_a_backup(finished: Job, acromion: Acromion, tmp_path: Path) -> None:
    acromion("backup", tmp_path / "b.zip")

    assert acromion("verify", tmp_path / "b.zip").exit_code == 0


def test_verify_finds_a_flipped_bit_in_a_backup(finished: Job, acromion: Acromion, tmp_path: Path) -> None:
    backup = tmp_path / "b.zip"
    acromion("backup", backup)
    content = bytearray(backup.read_bytes())
    content[content.index(b"the recording")] ^= 1
    backup.write_bytes(content)

    assert acromion("verify", backup).exit_code == 1


def test_a_damaged_backup_is_not_restored(
    finished: Job, acromion: Acromion, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    backup = tmp_path / "b.zip"
    acromion("backup", backup)
    backup.write_bytes(backup.read_bytes()[:-100])
    monkeypatch.delenv("ACROMION_DATABASE_URL")

    result = acromion("restore", backup, "--data", tmp_path / "new")

    assert (result.exit_code, result.output.split()[0]) == (3, "E-BACKUP")


def test_a_backup_is_not_restored_over_recordings(finished: Job, acromion: Acromion, tmp_path: Path) -> None:
    acromion("backup", tmp_path / "b.zip")

    result = acromion("restore", tmp_path / "b.zip")

    assert (result.exit_code, result.output.split()[0]) == (3, "E-NOT-EMPTY")


def test_a_backup_is_not_restored_under_a_running_server(
    finished: Job, acromion: Acromion, settings: Settings, tmp_path: Path
) -> None:
    acromion("backup", tmp_path / "b.zip")
    lock = FolderLock(settings.data_dir)

    result = acromion("restore", tmp_path / "b.zip")

    lock.release()
    assert result.output.split()[0] == "E-FOLDER-IN-USE"


def test_a_backup_does_not_replace_another(finished: Job, acromion: Acromion, tmp_path: Path) -> None:
    (tmp_path / "b.zip").write_bytes(b"older")

    assert acromion("backup", tmp_path / "b.zip").exit_code == 3
    assert (tmp_path / "b.zip").read_bytes() == b"older"


def test_a_backup_says_its_format_and_its_revision(finished: Job, acromion: Acromion, tmp_path: Path) -> None:
    acromion("backup", tmp_path / "b.zip")

    with zipfile.ZipFile(tmp_path / "b.zip") as archive:
        manifest = json.loads(archive.read("manifest.json"))

    assert (manifest["format"], manifest["revision"]) == ("acromion.backup/1", REVISION)


def test_an_analysis_that_ran_waits_again_after_a_restore(
    store: JobStore, add_job: AddJob, acromion: Acromion, tmp_path: Path
) -> None:
    job = add_job()
    store.claim(identify_self())
    acromion("backup", tmp_path / "b.zip")
    del os.environ["ACROMION_DATABASE_URL"]  # put right again by the fixture that set it

    acromion("restore", tmp_path / "b.zip", "--data", tmp_path / "new")

    restored = JobStore(Settings(data_dir=tmp_path / "new").database_url)
    assert (restored.get(job.id).state, restored.get(job.id).attempts) == (JobState.QUEUED, 0)
    restored.close()


@on_both_set_ups
def test_the_doctor_finds_a_good_installation_good(store: JobStore, acromion: Acromion) -> None:
    result = acromion("doctor")

    assert result.exit_code == 0, result.output


def test_the_doctor_names_a_full_disk_and_its_cure(
    store: JobStore, acromion: Acromion, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ACROMION_MIN_FREE_BYTES", str(1 << 60))

    result = acromion("doctor")

    assert result.exit_code == 1
    assert "FAIL  free disk space" in result.output
    assert "Make room" in result.output


def test_the_doctor_names_a_folder_that_others_may_read(
    store: JobStore, acromion: Acromion, settings: Settings
) -> None:
    settings.data_dir.chmod(0o755)

    result = acromion("doctor")

    assert f"chmod 700 {settings.data_dir}" in result.output


def test_the_doctor_names_a_database_of_a_later_release(
    store: JobStore, acromion: Acromion, settings: Settings
) -> None:
    engine = connect(settings.database_url)
    with engine.begin() as connection:
        connection.execute(text("UPDATE alembic_version SET version_num = '9999'"))
    engine.dispose()

    assert "E-DATABASE-NEW" in acromion("doctor").output


def test_the_doctor_speaks_both_languages() -> None:
    english, french = (load_wording(language, "operations") for language in ("en", "fr"))

    assert {name: sorted(entry) for name, entry in english["check"].items()} == {
        name: sorted(entry) for name, entry in french["check"].items()
    }
