"""Backup, restore, verify, doctor: on both set-ups, as commands."""

import json
import os
import re
import shutil
import stat
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any
from urllib.parse import quote

import pytest
from sqlalchemy import text
from typer.testing import CliRunner

from acromion.app.cli import app
from acromion.app.library.database.tables import REVISION
from acromion.app.library.jobs import JobStore
from acromion.app.library.recordings import Description, RecordingStore, UploadStore
from acromion.app.library.rows import Job, JobState
from acromion.app.library.webhooks import EVENTS, SECRET_OF_WEBHOOK, WebhookStore
from acromion.app.ops.recover import update_side_files
from acromion.app.settings import Settings
from acromion.app.store.folder import Fetched, FolderLock, Storage
from acromion.app.store.server_secret import ServerSecret
from tests.app import stand_ins
from tests.app.conftest import AddJob, on_both_set_ups
from tests.app.ops.conftest import Acromion

Backup = Callable[[], Path]
Restore = Callable[[Path], Any]
Move = Callable[..., Settings]


@contextmanager
def wide_umask(umask: int) -> Iterator[None]:
    """Let new files be readable to others, but for those that say otherwise."""
    before = os.umask(umask)
    try:
        yield
    finally:
        os.umask(before)


def read_faults(backup: Path) -> list[dict[str, str]]:
    """Return the faults that a backup lists."""
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
def backup(acromion: Acromion, tmp_path: Path) -> Backup:
    """Make a backup; return its path."""

    def make() -> Path:
        acromion("backup", tmp_path / "b.zip")
        return tmp_path / "b.zip"

    return make


@pytest.fixture
def restore(acromion: Acromion, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Restore:
    """Restore a backup into another data folder, ``new``."""

    def call(path: Path) -> Any:
        monkeypatch.delenv("ACROMION_DATABASE_URL", raising=False)
        return acromion("restore", path, "--data", tmp_path / "new")

    return call


@pytest.fixture
def move(settings: Settings, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> Move:
    """Lead the commands to an empty place of the same kind; give its settings."""

    def empty(**changes: object) -> Settings:
        folder = settings.data_dir.with_name("restored")
        changed: dict[str, object] = {"database_url": f"sqlite:///{folder / 'acromion.sqlite3'}"}
        if settings.object_store:
            request.getfixturevalue("postgres").empty()
            changed = {"object_store": request.getfixturevalue("swift").make_bucket()}
        new = settings.model_copy(update={"data_dir": folder} | changed | changes)
        for name, value in new.as_environment().items():
            monkeypatch.setenv(name, value)
        return new

    return empty


@on_both_set_ups
def test_a_restored_backup_holds_every_row_every_byte_and_the_secret_of_a_webhook(
    finished: Job, store: JobStore, settings: Settings, acromion: Acromion, backup: Backup, move: Move
) -> None:
    hooks = WebhookStore(store.engine, store.reader)
    hook = hooks.add("https://a.example", EVENTS, ServerSecret(settings.data_dir))
    path = backup()
    assert read_faults(path) == []
    assert acromion("verify", path).exit_code == 0
    new = move()

    restored = acromion("restore", path)

    assert restored.exit_code == 0, restored.output
    assert acromion("verify").exit_code == 0
    restored_store = JobStore(new)
    assert restored_store.get(finished.id) == finished
    (found,) = WebhookStore(restored_store.engine, restored_store.reader).find_all()
    assert ServerSecret(new.data_dir).decrypt(found.secret, SECRET_OF_WEBHOOK) == hook.secret
    restored_store.close()


@pytest.mark.parametrize(("database", "objects"), [("postgresql", "s3")], indirect=True)
def test_a_restore_names_the_bucket_and_the_database_without_its_password(
    finished: Job, settings: Settings, acromion: Acromion, backup: Backup, move: Move
) -> None:
    path = backup()
    with_password = settings.database_url.replace("postgres@", "postgres:open-sesame@")
    new = move(database_url=with_password)

    output = acromion("restore", path).output

    before, _, folder = with_password.replace("open-sesame", "***").partition("host=")
    rows = f"{before}host={quote(folder, safe='')}"
    assert f"all database rows restored into {new.object_store} (files) and {rows} (rows)." in output


def test_verify_counts_what_it_read(finished: Job, acromion: Acromion) -> None:
    result = acromion("verify")

    assert (result.exit_code, result.output.split()[0]) == (0, str(1 + 2 + len(stand_ins.EXPORTS) + 6))


@on_both_set_ups
def test_verify_names_a_missing_recording_and_a_backup_is_made_and_lists_it(
    finished: Job, storage: Storage, acromion: Acromion, tmp_path: Path
) -> None:
    storage.drop_recording(finished.recording_id)
    name = f"recordings/{finished.recording_id}"

    for command in (("verify",), ("backup", tmp_path / "b.zip")):
        result = acromion(*command)
        assert (result.exit_code, f"MISSING {name}" in result.output) == (1, True)

    assert read_faults(tmp_path / "b.zip") == [{"name": name, "finding": "missing"}]


def test_verify_names_a_damaged_recording_and_a_backup_holds_it_as_it_is(
    finished: Job, damaged: Path, acromion: Acromion, tmp_path: Path
) -> None:
    name = f"recordings/{finished.recording_id}"

    verified, made = acromion("verify", "--lang", "fr"), acromion("backup", tmp_path / "b.zip")

    assert (verified.exit_code, f"ENDOMMAGÉ {name}" in verified.output) == (1, True)
    assert (made.exit_code, f"DAMAGED {name}" in made.output) == (1, True)
    assert read_faults(tmp_path / "b.zip") == [{"name": name, "finding": "damaged"}]
    with zipfile.ZipFile(tmp_path / "b.zip") as archive:
        assert archive.read(f"files/{name}") == b"the Recording"


@on_both_set_ups
def test_verify_names_files_without_a_row(
    finished: Job, storage: Storage, acromion: Acromion, tmp_path: Path
) -> None:
    names = ("recordings/rec_stray", "analyses/an_gone/t1/results.json")
    for name in names:
        (tmp_path / "stray").write_bytes(b"left over")
        storage.put(tmp_path / "stray", name)

    result = acromion("verify")

    assert result.exit_code == 1
    assert [f"ORPHAN {name}" in result.stdout for name in names] == [True, True]


def test_verify_leaves_alone_what_an_attempt_under_way_is_making(
    store: JobStore, storage: Storage, add_job: AddJob, acromion: Acromion
) -> None:
    add_job(b"the recording")
    job = store.claim()
    assert job is not None
    assert job.token is not None
    update_side_files(store, storage)
    (storage.open_attempt(job.id, job.token) / "results.json").write_text("{}")

    assert acromion("verify").exit_code == 0


def test_a_flipped_bit_in_a_backup_is_found_and_spoils_one_file_of_it(
    finished: Job, settings: Settings, acromion: Acromion, backup: Backup, restore: Restore
) -> None:
    path, name = backup(), f"recordings/{finished.recording_id}"
    flip_a_bit(path, name)

    verified, result = acromion("verify", path), restore(path)

    assert verified.exit_code == 1
    assert f"DAMAGED {name}" in verified.output
    assert result.output.splitlines()[0] == f"DAMAGED {name}"
    restored = (settings.data_dir.with_name("new") / name).read_bytes()
    kept = (settings.data_dir / name).read_bytes()
    changed = [n for n, (one, other) in enumerate(zip(restored, kept, strict=True)) if one != other]
    assert changed == [len(kept) - 12]


def test_damaged_rows_of_a_backup_are_found(finished: Job, acromion: Acromion, backup: Backup) -> None:
    path = backup()
    with zipfile.ZipFile(path) as archive:
        about = archive.getinfo("rows/answers.jsonl")
    content = bytearray(path.read_bytes())
    content[about.header_offset + 30 + len(about.filename) + 30] ^= 1
    path.write_bytes(content)

    assert "DAMAGED rows/answers.jsonl" in acromion("verify", path).output


def test_a_backup_that_was_cut_short_is_not_restored(finished: Job, backup: Backup, restore: Restore) -> None:
    path = backup()
    path.write_bytes(path.read_bytes()[:-100])

    result = restore(path)

    assert (result.exit_code, result.output.split()[0]) == (3, "E-BACKUP")


def test_a_file_that_cannot_be_opened_is_a_fault_of_the_backup(
    finished: Job, settings: Settings, backup: Backup
) -> None:
    place = settings.data_dir / "recordings" / finished.recording_id
    place.unlink()
    place.mkdir()

    assert [fault["finding"] for fault in read_faults(backup())] == ["missing"]


def test_a_recording_purged_during_a_backup_is_no_fault(
    finished: Job,
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


def test_a_backup_is_refused_without_its_folder_and_over_another(
    add_job: AddJob, acromion: Acromion, tmp_path: Path
) -> None:
    add_job()
    (tmp_path / "older.zip").write_bytes(b"older")

    assert [acromion("backup", tmp_path / name).exit_code for name in ("none/b.zip", "older.zip")] == [3, 3]
    assert (tmp_path / "older.zip").read_bytes() == b"older"


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
    assert f"the folder has no data yet: {tmp_path / 'typo'}" in done.output
    assert "ok " not in done.output
    assert list(tmp_path.iterdir()) == []


def test_known_faults_of_a_backup_are_called_known_until_they_are_damaged_further(
    finished: Job, damaged: Path, settings: Settings, acromion: Acromion, backup: Backup
) -> None:
    (gone,) = (settings.data_dir / "analyses").rglob("summary.csv")
    gone.unlink()
    path, name = backup(), f"recordings/{finished.recording_id}"

    known = acromion("verify", path)
    flip_a_bit(path, name)
    further = acromion("verify", path)

    assert known.exit_code == 1
    assert f"KNOWN DAMAGED {name}" in known.output
    assert f"KNOWN MISSING {gone.relative_to(settings.data_dir)}" in known.output
    assert f"\nDAMAGED {name}" in f"\n{further.output}"


def test_a_backup_with_faults_restores_what_is_whole_and_lists_the_rest(
    finished: Job, storage: Storage, acromion: Acromion, backup: Backup, move: Move
) -> None:
    storage.drop_recording(finished.recording_id)
    path, new = backup(), move()

    restored = acromion("restore", path)

    assert restored.exit_code == 4
    assert f"MISSING recordings/{finished.recording_id}" in restored.output
    assert f"MISSING recordings/{finished.recording_id}" in acromion("verify").output
    store = JobStore(new)
    assert store.get(finished.id) == finished
    store.close()


def test_a_damaged_file_is_restored_as_it_is_and_does_not_replace_a_good_one(
    finished: Job, damaged: Path, backup: Backup, restore: Restore, tmp_path: Path
) -> None:
    path, place = backup(), tmp_path / "new" / "recordings" / finished.recording_id
    first, restored = restore(path), place.read_bytes()
    shutil.rmtree(tmp_path / "new")
    place.parent.mkdir(parents=True)
    place.write_bytes(b"the recording")  # as after a restore that was cut short

    again = restore(path)

    assert (first.exit_code, restored) == (4, b"the Recording")
    assert (again.exit_code, place.read_bytes()) == (0, b"the recording")


def test_a_restore_that_was_cut_short_is_done_again(
    finished: Job, acromion: Acromion, backup: Backup, restore: Restore, tmp_path: Path
) -> None:
    (tmp_path / "new" / "recordings").mkdir(parents=True)
    (tmp_path / "new" / "recordings" / finished.recording_id).write_bytes(b"the recording")

    result = restore(backup())

    assert result.exit_code == 0
    assert f"all database rows restored into {tmp_path / 'new'}. Start the server" in result.output
    assert acromion("verify", "--data", tmp_path / "new").exit_code == 0


def test_a_backup_is_not_restored_among_files_that_it_does_not_know(
    finished: Job, backup: Backup, restore: Restore, tmp_path: Path
) -> None:
    stranger = tmp_path / "new" / "recordings" / "rec_of_another_database"
    stranger.parent.mkdir(parents=True)
    stranger.write_bytes(b"whose row is lost")

    result = restore(backup())

    assert (result.exit_code, result.output.split()[0]) == (3, "E-NOT-EMPTY")
    assert "recordings/rec_of_another_database" in result.output
    assert [path.name for path in stranger.parent.iterdir()] == [stranger.name]


def test_a_backup_is_not_restored_over_recordings_nor_under_a_running_server(
    finished: Job, acromion: Acromion, settings: Settings, backup: Backup
) -> None:
    path = backup()

    over = acromion("restore", path)
    lock = FolderLock(settings.data_dir)
    under = acromion("restore", path)
    lock.release()

    assert (over.exit_code, over.output.split()[0]) == (3, "E-NOT-EMPTY")
    assert under.output.split()[0] == "E-FOLDER-IN-USE"


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
    finished: Job, store: JobStore, acromion: Acromion, backup: Backup, settings: Settings
) -> None:
    path = backup()
    purge(store, finished.recording_id)
    for folder in ("recordings", "analyses"):
        shutil.rmtree(settings.data_dir / folder)
    with store.engine.begin() as connection:
        connection.execute(text("CREATE TABLE patients (name TEXT)"))
        connection.execute(text("INSERT INTO patients VALUES ('kept')"))

    assert acromion("restore", path).exit_code == 0
    with store.reader.connect() as connection:
        assert connection.execute(text("SELECT name FROM patients")).scalar_one() == "kept"


def test_after_a_restore_an_analysis_that_ran_waits_again_and_an_upload_under_way_is_gone(
    store: JobStore, add_job: AddJob, backup: Backup, restore: Restore, tmp_path: Path
) -> None:
    uploads = UploadStore(store.engine, store.reader)
    uploads.advance(uploads.open(100, "", Description("half.gt3x")), 50)  # whose bytes are in no backup
    job = add_job()
    store.claim()

    restore(backup())

    restored = JobStore(Settings(data_dir=tmp_path / "new"))
    assert (restored.get(job.id).state, restored.get(job.id).attempts) == (JobState.QUEUED, 0)
    assert UploadStore(restored.engine, restored.reader).find_growing() == frozenset()
    restored.close()


@pytest.mark.parametrize("umask", [0o000, 0o022])
def test_a_backup_and_a_restored_place_are_for_their_owner_alone_whatever_the_umask(
    finished: Job, backup: Backup, restore: Restore, tmp_path: Path, umask: int
) -> None:
    with wide_umask(umask):
        path = backup()
        restore(path)

    new = tmp_path / "new"
    folders = [new, *(folder for folder in new.rglob("*") if folder.is_dir())]
    assert {stat.S_IMODE(folder.stat().st_mode) for folder in folders} == {0o700}
    assert {stat.S_IMODE(file.stat().st_mode) for file in (path, new / "acromion.sqlite3")} == {0o600}


def test_a_backup_states_its_format_and_revision_and_may_lack_the_list_of_faults(
    finished: Job, acromion: Acromion, backup: Backup, restore: Restore, tmp_path: Path
) -> None:
    with zipfile.ZipFile(backup()) as new, zipfile.ZipFile(tmp_path / "old.zip", "w") as old:
        manifest = json.loads(new.read("manifest.json"))
        for name in new.namelist():
            without = {key: value for key, value in manifest.items() if key != "faults"}
            old.writestr(name, json.dumps(without) if name == "manifest.json" else new.read(name))

    assert (manifest["format"], manifest["revision"]) == ("acromion.backup/3", REVISION)
    assert acromion("verify", tmp_path / "old.zip").exit_code == 0
    assert restore(tmp_path / "old.zip").exit_code == 0


@on_both_set_ups
def test_the_doctor_finds_a_good_installation_good(store: JobStore, acromion: Acromion) -> None:
    result = acromion("doctor")

    assert result.exit_code == 0, result.output


def test_the_doctor_names_what_is_wrong_and_its_cure(
    store: JobStore, acromion: Acromion, settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ACROMION_MIN_FREE_BYTES", str(1 << 60))
    settings.data_dir.chmod(0o755)
    with store.engine.begin() as connection:
        connection.execute(text("UPDATE alembic_version SET version_num = '9999'"))

    result = acromion("doctor")

    assert result.exit_code == 1
    for told in ("FAIL  free disk space", "Free some space", f"chmod 700 {settings.data_dir}", "E-SCHEMA"):
        assert told in result.output


def find_line(output: str, part: str) -> str:
    return next(line for line in output.splitlines() if part in line)


@on_both_set_ups
def test_the_doctor_warns_if_the_newest_backup_is_older_than_two_days(
    finished: Job, acromion: Acromion, storage: Storage, tmp_path: Path
) -> None:
    before = find_line(acromion("doctor").output, "backup is known")
    acromion("backup", tmp_path / "b.zip")
    fresh = find_line(acromion("doctor").output, "newest backup")
    warned = list[str]()
    for age in (timedelta(days=2, hours=1), timedelta(days=-3)):  # of a clock that was ahead: unknown
        made_at = (datetime.now(UTC) - age).isoformat()
        storage.write_small("backups.json", json.dumps({"keep": None, "made_at": [made_at]}).encode())
        result = acromion("doctor")
        warned.append(find_line(result.output, "newest backup"))

    assert [line[:4] for line in (before, fresh, *warned)] == ["warn", "ok  ", "warn", "warn"]
    assert result.exit_code == 0


def test_the_doctor_warns_of_a_check_that_it_did_not_make(
    finished: Job, acromion: Acromion, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("acromion.app.ops.doctor.MOST_READ_BYTES", 0)

    assert find_line(acromion("doctor").output, "were not read").startswith("warn")


@pytest.mark.parametrize("content", [b"[]", b'{"made_at": [1]}', b"\xff"])
def test_a_list_of_backups_that_is_not_ours_counts_as_none(
    finished: Job, acromion: Acromion, storage: Storage, content: bytes
) -> None:
    storage.write_small("backups.json", content)

    assert find_line(acromion("doctor").output, "backup is known").startswith("warn")


def test_a_backup_into_a_folder_is_named_by_its_date_and_older_ones_go(
    finished: Job, acromion: Acromion, tmp_path: Path
) -> None:
    for number in (1, 2):
        (tmp_path / f"acromion-2026-03-0{number}-023000.zip").touch()
        os.utime(tmp_path / f"acromion-2026-03-0{number}-023000.zip", (number, number))

    done = acromion("backup", tmp_path, "--keep", "2")

    names = sorted(path.name for path in tmp_path.glob("acromion-*.zip"))
    assert done.exit_code == 0
    assert names[0] == "acromion-2026-03-02-023000.zip"
    assert re.fullmatch(r"acromion-\d{4}-\d\d-\d\d-\d{6}\.zip", names[1])
