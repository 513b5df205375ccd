"""Backup, restore, verify, doctor: on both set-ups, as commands."""

import json
import os
import shutil
import stat
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import quote

import pytest
from sqlalchemy import text
from typer.testing import CliRunner

from app.cli import app
from app.jobs.database.connect import connect
from app.jobs.database.tables import REVISION
from app.jobs.job import Job, JobState
from app.jobs.recordings import Description, RecordingStore, UploadStore
from app.jobs.store import JobStore
from app.jobs.webhooks import EVENTS, SECRET_OF_WEBHOOK, WebhookStore
from app.jobs.worker import run_next
from app.report.words.wording import load_wording
from app.settings import Settings
from app.storage.server_secret import ServerSecret
from app.storage.store import Fetched, FolderLock, Storage
from app.upkeep.recover import catch_up
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

    def call(*arguments: object) -> Any:
        return CliRunner().invoke(app, [str(argument) for argument in arguments])

    return call


@contextmanager
def wide_umask(umask: int) -> Iterator[None]:
    """Let new files be readable to others, but for those that say otherwise."""
    before = os.umask(umask)
    try:
        yield
    finally:
        os.umask(before)


def read_faults(backup: Path) -> list[dict[str, str]]:
    """Give the faults that a backup lists."""
    with zipfile.ZipFile(backup) as archive:
        faults: list[dict[str, str]] = json.loads(archive.read("manifest.json"))["faults"]
    return faults


def flip_a_bit(backup: Path, name: str) -> None:
    """Let a byte of a file in the backup rot; what is sealed stands there as it is, for it does not pack."""
    with zipfile.ZipFile(backup) as archive:
        end = archive.read(f"files/{name}")[-12:]
    content = bytearray(backup.read_bytes())
    content[content.index(end)] ^= 1
    backup.write_bytes(content)


@pytest.fixture
def damaged(finished: Job, settings: Settings) -> Path:
    """The recording of the finished analysis, with one byte altered."""
    path = settings.data_dir / "recordings" / finished.recording_id
    path.write_bytes(b"the Recording")
    return path


def purge(store: JobStore, recording_id: str) -> None:
    """Delete the rows of a recording; its files are left to the test."""
    rows = RecordingStore(store.engine, store.reader)
    rows.begin_purge(recording_id)
    rows.end_purge(recording_id)


@pytest.fixture
def finished(store: JobStore, storage: Storage, add_job: AddJob, bench: OpenBench) -> Job:
    """An analysis with its files."""
    job = add_job(b"the recording", file_name="Équipe 1.gt3x")
    run_next(bench(stand_ins.write_report))
    catch_up(store, storage)
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
    store = JobStore(new)
    assert store.get(finished.id) == finished
    store.close()


@pytest.mark.parametrize(("database", "objects"), [("postgresql", "s3")], indirect=True)
@pytest.mark.parametrize(
    ("lang", "told"),
    [
        ("en", "every row restored into {files} (files) and {rows} (rows)."),
        ("fr", "toutes les lignes restaurés dans {files} (fichiers) et {rows} (lignes)."),
    ],
)
def test_a_restore_names_the_bucket_and_the_database_without_its_password(
    *,
    finished: Job,
    settings: Settings,
    acromion: Acromion,
    tmp_path: Path,
    request: pytest.FixtureRequest,
    lang: str,
    told: str,
) -> None:
    acromion("backup", tmp_path / "b.zip")
    new = empty_everything(settings, request)
    with_password = new.database_url.replace("postgres@", "postgres:open-sesame@")
    os.environ.update(new.model_copy(update={"database_url": with_password}).as_environment())

    output = acromion("restore", tmp_path / "b.zip", "--lang", lang).output

    before, _, folder = with_password.replace("open-sesame", "***").partition("host=")
    rows = f"{before}host={quote(folder, safe='')}"
    assert told.format(files=new.object_store, rows=rows) in output


def test_a_restore_into_a_data_folder_names_the_folder_alone(
    finished: Job, acromion: Acromion, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    acromion("backup", tmp_path / "b.zip")
    monkeypatch.delenv("ACROMION_DATABASE_URL", raising=False)

    output = acromion("restore", tmp_path / "b.zip", "--data", tmp_path / "new").output

    assert f"every row restored into {tmp_path / 'new'}. Start the server" in output


def test_the_secret_of_a_webhook_is_read_where_it_was_restored(
    store: JobStore, settings: Settings, acromion: Acromion, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    hook = WebhookStore(store.engine, store.reader).add(
        "https://a.example", EVENTS, ServerSecret(settings.data_dir)
    )
    acromion("backup", tmp_path / "b.zip")
    new = empty_everything(settings, request)
    os.environ.update(new.as_environment())  # put right again by the fixture that set them first

    assert acromion("restore", tmp_path / "b.zip").exit_code == 0

    restored = JobStore(new)
    (found,) = WebhookStore(restored.engine, restored.reader).find_all()
    assert ServerSecret(new.data_dir).decrypt(found.secret, SECRET_OF_WEBHOOK) == hook.secret
    restored.close()


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
    job = store.claim()
    assert job is not None
    assert job.token is not None
    catch_up(store, storage)
    (storage.open_attempt(job.id, job.token) / "results.json").write_text("{}")

    assert acromion("verify").exit_code == 0


def test_verify_reads_a_backup(finished: Job, acromion: Acromion, tmp_path: Path) -> None:
    acromion("backup", tmp_path / "b.zip")

    assert acromion("verify", tmp_path / "b.zip").exit_code == 0


def test_verify_finds_a_flipped_bit_in_a_backup(finished: Job, acromion: Acromion, tmp_path: Path) -> None:
    backup = tmp_path / "b.zip"
    acromion("backup", backup)
    flip_a_bit(backup, f"recordings/{finished.recording_id}")

    result = acromion("verify", backup)

    assert result.exit_code == 1
    assert f"DAMAGED recordings/{finished.recording_id}" in result.output


def test_a_damaged_backup_is_not_restored(
    finished: Job, acromion: Acromion, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    backup = tmp_path / "b.zip"
    acromion("backup", backup)
    backup.write_bytes(backup.read_bytes()[:-100])
    monkeypatch.delenv("ACROMION_DATABASE_URL", raising=False)

    result = acromion("restore", backup, "--data", tmp_path / "new")

    assert (result.exit_code, result.output.split()[0]) == (3, "E-BACKUP")


@on_both_set_ups
def test_a_backup_of_a_store_with_a_missing_file_is_made_and_lists_it(
    finished: Job, storage: Storage, acromion: Acromion, tmp_path: Path
) -> None:
    storage.drop_recording(finished.recording_id)

    result = acromion("backup", tmp_path / "b.zip")

    name = f"recordings/{finished.recording_id}"
    assert result.exit_code == 1
    assert f"MISSING {name}" in result.output
    assert read_faults(tmp_path / "b.zip") == [{"name": name, "finding": "missing"}]


def test_a_damaged_file_is_put_into_the_backup_as_it_is(
    finished: Job, damaged: Path, acromion: Acromion, tmp_path: Path
) -> None:
    result = acromion("backup", tmp_path / "b.zip")

    name = f"recordings/{finished.recording_id}"
    assert result.exit_code == 1
    assert f"DAMAGED {name}" in result.output
    assert read_faults(tmp_path / "b.zip") == [{"name": name, "finding": "damaged"}]
    with zipfile.ZipFile(tmp_path / "b.zip") as archive:
        assert archive.read(f"files/{name}") == b"the Recording"


def test_a_file_that_cannot_be_opened_is_a_fault_of_the_backup(
    finished: Job, settings: Settings, acromion: Acromion, tmp_path: Path
) -> None:
    place = settings.data_dir / "recordings" / finished.recording_id
    place.unlink()
    place.mkdir()

    assert acromion("backup", tmp_path / "b.zip").exit_code == 1
    assert [fault["finding"] for fault in read_faults(tmp_path / "b.zip")] == ["missing"]


def test_a_backup_of_a_good_store_lists_no_fault(finished: Job, acromion: Acromion, tmp_path: Path) -> None:
    assert acromion("backup", tmp_path / "b.zip").exit_code == 0
    assert read_faults(tmp_path / "b.zip") == []


def test_a_recording_purged_during_a_backup_is_no_fault(
    finished: Job,
    *,
    add_job: AddJob,
    store: JobStore,
    acromion: Acromion,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    job, fetch = add_job(b"another"), Storage.fetch
    purged: list[str] = []

    def fetch_after_purge(self: Storage, name: str) -> Fetched:
        if not purged:
            purged.append(job.recording_id)
            purge(store, job.recording_id)
            self.drop_recording(job.recording_id)
        return fetch(self, name)

    monkeypatch.setattr(Storage, "fetch", fetch_after_purge)

    assert acromion("backup", tmp_path / "b.zip").exit_code == 0
    assert acromion("verify", tmp_path / "b.zip").exit_code == 0


def test_a_place_without_a_database_is_not_backed_up(acromion: Acromion, tmp_path: Path) -> None:
    result = acromion("backup", tmp_path / "b.zip")

    assert (result.exit_code, result.output.split()[0]) == (3, "E-NOT-FOUND")
    assert not (tmp_path / "b.zip").exists()


@pytest.mark.parametrize("has_folder", [False, True])
@pytest.mark.parametrize(
    "words",
    [
        ("backup", "{tmp}/b.zip"),
        ("verify",),
        ("recover",),
        ("trail", "show"),
        ("account", "list"),
        ("account", "end", "clara"),
    ],
)
def test_a_command_on_a_mistyped_folder_is_refused_and_makes_nothing(
    tmp_path: Path, words: tuple[str, ...], has_folder: bool
) -> None:
    typo = tmp_path / "typo"
    if has_folder:
        typo.mkdir()
        (typo / "letter.txt").write_text("mine")
    before = sorted(tmp_path.rglob("*"))

    typed = [word.format(tmp=tmp_path) for word in words]
    done = CliRunner().invoke(app, [*typed, "--data", str(typo)])

    assert (done.exit_code, done.output.split()[0]) == (3, "E-NOT-FOUND")
    assert str(typo) in done.output
    assert sorted(tmp_path.rglob("*")) == before


def test_the_doctor_says_that_nothing_is_there_yet_and_makes_nothing(tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["doctor", "--data", str(tmp_path / "typo")])

    assert done.exit_code == 1
    assert f"nothing is there yet: {tmp_path / 'typo'}" in done.output
    assert "ok " not in done.output
    assert list(tmp_path.iterdir()) == []


def test_a_backup_into_a_folder_that_is_not_there_is_refused(
    finished: Job, acromion: Acromion, tmp_path: Path
) -> None:
    assert acromion("backup", tmp_path / "none" / "b.zip").exit_code == 3


def test_verify_names_the_known_faults_of_a_backup_as_known(
    finished: Job, damaged: Path, settings: Settings, acromion: Acromion, tmp_path: Path
) -> None:
    (gone,) = (settings.data_dir / "analyses").rglob("summary.csv")
    gone.unlink()
    acromion("backup", tmp_path / "b.zip")

    result = acromion("verify", tmp_path / "b.zip")

    assert result.exit_code == 1
    assert f"KNOWN DAMAGED recordings/{finished.recording_id}" in result.output
    assert f"KNOWN MISSING {gone.relative_to(settings.data_dir)}" in result.output


def test_further_damage_of_a_known_fault_is_not_called_known(
    finished: Job, damaged: Path, acromion: Acromion, tmp_path: Path
) -> None:
    acromion("backup", tmp_path / "b.zip")
    flip_a_bit(tmp_path / "b.zip", f"recordings/{finished.recording_id}")

    result = acromion("verify", tmp_path / "b.zip")

    assert f"\nDAMAGED recordings/{finished.recording_id}" in f"\n{result.output}"


def test_verify_finds_damaged_rows_in_a_backup(finished: Job, acromion: Acromion, tmp_path: Path) -> None:
    acromion("backup", tmp_path / "b.zip")
    with zipfile.ZipFile(tmp_path / "b.zip") as archive:
        about = archive.getinfo("rows/answers.jsonl")
    content = bytearray((tmp_path / "b.zip").read_bytes())
    content[about.header_offset + 30 + len(about.filename) + 30] ^= 1
    (tmp_path / "b.zip").write_bytes(content)

    assert "DAMAGED rows/answers.jsonl" in acromion("verify", tmp_path / "b.zip").output


@on_both_set_ups
def test_a_backup_with_faults_restores_what_is_whole_and_lists_the_rest(
    finished: Job,
    *,
    storage: Storage,
    settings: Settings,
    acromion: Acromion,
    tmp_path: Path,
    request: pytest.FixtureRequest,
) -> None:
    storage.drop_recording(finished.recording_id)
    acromion("backup", tmp_path / "b.zip")
    new = empty_everything(settings, request)
    os.environ.update(new.as_environment())  # put right again by the fixture that set them first

    restored = acromion("restore", tmp_path / "b.zip")

    assert restored.exit_code == 1
    assert f"MISSING recordings/{finished.recording_id}" in restored.output
    assert f"MISSING recordings/{finished.recording_id}" in acromion("verify").output
    store = JobStore(new)
    assert store.get(finished.id) == finished
    store.close()


def test_a_damaged_file_is_restored_as_it_is(
    finished: Job, damaged: Path, acromion: Acromion, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    acromion("backup", tmp_path / "b.zip")
    monkeypatch.delenv("ACROMION_DATABASE_URL", raising=False)

    result = acromion("restore", tmp_path / "b.zip", "--data", tmp_path / "new")

    assert result.exit_code == 1
    restored = tmp_path / "new" / "recordings" / finished.recording_id
    assert restored.read_bytes() == b"the Recording"


def test_a_bit_that_flipped_in_the_backup_spoils_one_file_of_it(
    finished: Job, settings: Settings, acromion: Acromion, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    acromion("backup", tmp_path / "b.zip")
    flip_a_bit(tmp_path / "b.zip", f"recordings/{finished.recording_id}")
    monkeypatch.delenv("ACROMION_DATABASE_URL", raising=False)

    result = acromion("restore", tmp_path / "b.zip", "--data", tmp_path / "new")

    assert result.output.splitlines()[0] == f"DAMAGED recordings/{finished.recording_id}"
    restored = (tmp_path / "new" / "recordings" / finished.recording_id).read_bytes()
    kept = (settings.data_dir / "recordings" / finished.recording_id).read_bytes()
    assert [n for n, (one, other) in enumerate(zip(restored, kept, strict=True)) if one != other] == [
        len(kept) - 12
    ]


def test_a_restore_that_was_cut_short_is_done_again(
    finished: Job, acromion: Acromion, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    acromion("backup", tmp_path / "b.zip")
    monkeypatch.delenv("ACROMION_DATABASE_URL", raising=False)
    new = tmp_path / "new"
    (new / "recordings").mkdir(parents=True)
    (new / "recordings" / finished.recording_id).write_bytes(b"the recording")

    assert acromion("restore", tmp_path / "b.zip", "--data", new).exit_code == 0
    assert acromion("verify", "--data", new).exit_code == 0


def test_a_damaged_file_of_a_backup_does_not_replace_a_good_one(
    finished: Job, damaged: Path, acromion: Acromion, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    acromion("backup", tmp_path / "b.zip")
    monkeypatch.delenv("ACROMION_DATABASE_URL", raising=False)
    new = tmp_path / "new"
    (new / "recordings").mkdir(parents=True)
    (new / "recordings" / finished.recording_id).write_bytes(b"the recording")

    assert acromion("restore", tmp_path / "b.zip", "--data", new).exit_code == 0
    assert (new / "recordings" / finished.recording_id).read_bytes() == b"the recording"


def test_a_backup_is_not_restored_among_files_that_it_does_not_know(
    finished: Job, acromion: Acromion, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    acromion("backup", tmp_path / "b.zip")
    monkeypatch.delenv("ACROMION_DATABASE_URL", raising=False)
    stranger = tmp_path / "new" / "recordings" / "rec_of_another_database"
    stranger.parent.mkdir(parents=True)
    stranger.write_bytes(b"whose row is lost")

    result = acromion("restore", tmp_path / "b.zip", "--data", tmp_path / "new")

    assert (result.exit_code, result.output.split()[0]) == (3, "E-NOT-EMPTY")
    assert "recordings/rec_of_another_database" in result.output
    assert [path.name for path in stranger.parent.iterdir()] == [stranger.name]


@pytest.mark.parametrize("database", ["sqlite", "postgresql"], indirect=True)
def test_a_backup_is_not_restored_over_rows_of_any_kind(
    finished: Job, store: JobStore, acromion: Acromion, tmp_path: Path
) -> None:
    acromion("backup", tmp_path / "b.zip")
    purge(store, finished.recording_id)
    WebhookStore(store.engine, store.reader).add("https://example.org/", EVENTS, ServerSecret(tmp_path))

    result = acromion("restore", tmp_path / "b.zip")

    assert (result.exit_code, result.output.split()[0]) == (3, "E-NOT-EMPTY")
    assert "1 in webhooks" in result.output
    assert len(WebhookStore(store.engine, store.reader).find_all()) == 1


@pytest.mark.parametrize("database", ["sqlite", "postgresql"], indirect=True)
def test_a_restore_leaves_tables_of_somebody_else_alone(
    finished: Job, store: JobStore, acromion: Acromion, tmp_path: Path, settings: Settings
) -> None:
    acromion("backup", tmp_path / "b.zip")
    purge(store, finished.recording_id)
    shutil.rmtree(settings.data_dir / "recordings")
    shutil.rmtree(settings.data_dir / "analyses")
    with store.engine.begin() as connection:
        connection.execute(text("CREATE TABLE patients (name TEXT)"))
        connection.execute(text("INSERT INTO patients VALUES ('kept')"))

    assert acromion("restore", tmp_path / "b.zip").exit_code == 0
    with store.reader.connect() as connection:
        assert connection.execute(text("SELECT name FROM patients")).scalar_one() == "kept"


def test_an_upload_under_way_is_not_restored_for_its_bytes_are_not_in_the_backup(
    store: JobStore, acromion: Acromion, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    uploads = UploadStore(store.engine, store.reader)
    uploads.advance(uploads.open(100, "", Description("half.gt3x")), 50)
    acromion("backup", tmp_path / "b.zip")
    monkeypatch.delenv("ACROMION_DATABASE_URL", raising=False)

    acromion("restore", tmp_path / "b.zip", "--data", tmp_path / "new")

    restored = JobStore(Settings(data_dir=tmp_path / "new"))
    assert UploadStore(restored.engine, restored.reader).find_growing() == frozenset()
    restored.close()


def drop_fact(backup: Path, old: Path, fact: str) -> None:
    """Write a backup as it was before its manifest stated a fact."""
    with zipfile.ZipFile(backup) as new, zipfile.ZipFile(old, "w") as written:
        for name in new.namelist():
            content = new.read(name)
            if name == "manifest.json":
                manifest = json.loads(content)
                del manifest[fact]
                content = json.dumps(manifest).encode()
            written.writestr(name, content)


def test_a_backup_of_before_faults_were_listed_is_restored(
    finished: Job, acromion: Acromion, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    acromion("backup", tmp_path / "b.zip")
    drop_fact(tmp_path / "b.zip", tmp_path / "old.zip", "faults")
    monkeypatch.delenv("ACROMION_DATABASE_URL", raising=False)

    assert acromion("verify", tmp_path / "old.zip").exit_code == 0
    assert acromion("restore", tmp_path / "old.zip", "--data", tmp_path / "new").exit_code == 0


@pytest.mark.parametrize("umask", [0o000, 0o022])
def test_a_backup_is_for_its_owner_alone_whatever_the_umask(
    finished: Job, acromion: Acromion, tmp_path: Path, umask: int
) -> None:
    with wide_umask(umask):
        acromion("backup", tmp_path / "b.zip")

    assert stat.S_IMODE((tmp_path / "b.zip").stat().st_mode) == 0o600


def test_a_restored_place_is_for_its_owner_alone(
    finished: Job, acromion: Acromion, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    acromion("backup", tmp_path / "b.zip")
    monkeypatch.delenv("ACROMION_DATABASE_URL", raising=False)
    with wide_umask(0o000):
        acromion("restore", tmp_path / "b.zip", "--data", tmp_path / "above" / "new")

    above = tmp_path / "above"
    folders = [above, *(path for path in above.rglob("*") if path.is_dir())]
    assert {stat.S_IMODE(folder.stat().st_mode) for folder in folders} == {0o700}
    assert stat.S_IMODE((above / "new" / "acromion.sqlite3").stat().st_mode) == 0o600


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

    assert (manifest["format"], manifest["revision"]) == ("acromion.backup/3", REVISION)


def test_an_analysis_that_ran_waits_again_after_a_restore(
    store: JobStore, add_job: AddJob, acromion: Acromion, tmp_path: Path
) -> None:
    job = add_job()
    store.claim()
    acromion("backup", tmp_path / "b.zip")
    os.environ.pop("ACROMION_DATABASE_URL", None)  # put right again by the fixture that set it

    acromion("restore", tmp_path / "b.zip", "--data", tmp_path / "new")

    restored = JobStore(Settings(data_dir=tmp_path / "new"))
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


def test_the_doctor_names_a_database_of_another_version(
    store: JobStore, acromion: Acromion, settings: Settings
) -> None:
    engine = connect(settings.database_url)
    with engine.begin() as connection:
        connection.execute(text("UPDATE alembic_version SET version_num = '9999'"))
    engine.dispose()

    assert "E-SCHEMA" in acromion("doctor").output


def test_the_doctor_speaks_both_languages() -> None:
    english, french = (load_wording(language, "operations") for language in ("en", "fr"))

    assert {name: sorted(entry) for name, entry in english["check"].items()} == {
        name: sorted(entry) for name, entry in french["check"].items()
    }
