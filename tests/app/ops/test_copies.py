"""The daily copies of the rows, what recover makes of them, and how an erasure reaches them."""

import os
import shutil
import sqlite3
import time
from collections.abc import Callable
from contextlib import closing
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from fastapi.testclient import TestClient

from acromion.app.accounts.accounts import AccountStore
from acromion.app.http.api.housekeeping import apply_retention
from acromion.app.library.jobs import JobStore
from acromion.app.library.recordings import RecordingFilter, RecordingStore
from acromion.app.main import create_app
from acromion.app.ops import copies
from acromion.app.ops.copies import find_copies, keep_daily_copy, renew_copies, restore_copy
from acromion.app.settings import Settings
from tests.app.conftest import AddJob
from tests.app.ops.conftest import Acromion, lose_sqlite, read_subjects

CANARY = "canary-5f2c71d09ab84e36c1f7a2d8e"


Copy = Callable[[], None]


def make_old(path: Path, age_s: float) -> None:
    then_s = time.time() - age_s
    os.utime(path, (then_s, then_s))


@pytest.fixture
def copy(store: JobStore, settings: Settings) -> Copy:
    return lambda: keep_daily_copy(settings, store.engine)


def test_a_copy_is_a_whole_database_that_only_its_user_reads(
    settings: Settings, add_job: AddJob, copy: Copy
) -> None:
    add_job(subject="S012")

    copy()

    (made,) = find_copies(settings)
    assert read_subjects(made) == ["S012"]
    assert (made.stat().st_mode & 0o777, made.parent.stat().st_mode & 0o777) == (0o600, 0o700)
    assert [path.name for path in made.parent.iterdir()] == [made.name]


def test_there_is_one_copy_a_day_and_seven_are_kept(settings: Settings, copy: Copy) -> None:
    copy()
    copy()
    assert len(find_copies(settings)) == 1

    for _ in range(9):
        make_old(find_copies(settings)[-1], 25 * 3600)
        copy()

    assert [path.name for path in find_copies(settings)] == [f"rows-{n:06d}.sqlite3" for n in range(4, 11)]


def test_a_clock_that_was_set_back_drops_no_newer_copy_and_one_that_a_crash_cut_short_is_none(
    settings: Settings, copy: Copy
) -> None:
    (settings.data_dir / "copies").mkdir()
    (settings.data_dir / "copies" / "rows-new.part").write_bytes(b"half")
    copy()
    make_old(find_copies(settings)[0], -30 * 3600)

    copy()

    names = sorted(path.name for path in (settings.data_dir / "copies").iterdir())
    assert names == ["rows-000001.sqlite3", "rows-000002.sqlite3"]


def test_a_copy_holds_no_session(settings: Settings, copy: Copy) -> None:
    accounts = AccountStore(settings)
    accounts.begin_session(accounts.add_person("clara", "Clara", ["clinician"]).id)
    accounts.database.close()

    copy()

    with closing(sqlite3.connect(find_copies(settings)[0])) as rows:
        kept = [rows.execute(f"SELECT count(*) FROM {table}").fetchone() for table in ("people", "sessions")]
    assert kept == [(1,), (0,)]


def damage(path: Path) -> None:
    whole = path.read_bytes()
    path.write_bytes(whole[:8192] + b"x" * (len(whole) - 8192))


def change_revision(path: Path) -> None:
    with sqlite3.connect(path) as connection:
        connection.execute("UPDATE alembic_version SET version_num = '0012'")


@pytest.mark.parametrize("spoil", [damage, change_revision, lambda path: path.write_bytes(b"")])
def test_a_copy_that_is_spoilt_or_of_another_version_leaves_the_turn_to_the_one_before(
    store: JobStore, settings: Settings, add_job: AddJob, copy: Copy, spoil: Callable[[Path], None]
) -> None:
    add_job(subject="S012")
    copy()
    make_old(find_copies(settings)[-1], 25 * 3600)
    copy()
    spoil(find_copies(settings)[-1])
    store.close()
    lose_sqlite(settings)

    restore_copy(settings)

    assert read_subjects(settings.data_dir / "acromion.sqlite3") == ["S012"]


def test_postgresql_has_no_copies(settings: Settings, store: JobStore) -> None:
    class Elsewhere:
        class dialect:  # noqa: N801
            name = "postgresql"

    keep_daily_copy(settings, Elsewhere())  # type: ignore[arg-type]
    renew_copies(settings, Elsewhere())  # type: ignore[arg-type]

    assert find_copies(settings) == ()


# --- an erasure -----------------------------------------------------------------------------------------


def test_an_erasure_deletes_every_copy_and_writes_one_without_the_person(
    client: TestClient, settings: Settings, copy: Copy
) -> None:
    gone = client.post("/api/v1/recordings", content=b"one", params={"subject": CANARY}).json()["id"]
    client.post("/api/v1/recordings", content=b"two", params={"subject": "S2"})
    for _ in range(3):
        copy()
        make_old(find_copies(settings)[-1], 25 * 3600)

    assert client.delete(f"/api/v1/recordings/{gone}", params={"purge": "now"}).status_code == 200

    (left,) = find_copies(settings)
    assert read_subjects(left) == ["S2"]
    assert CANARY.encode() not in left.read_bytes()


def test_a_copy_leaves_out_what_another_erasure_is_deleting(
    store: JobStore, settings: Settings, add_job: AddJob, copy: Copy
) -> None:
    add_job(subject="S2")
    RecordingStore(store.engine, store.reader).begin_purge(add_job(b"gone", subject=CANARY).recording_id)

    copy()

    (kept,) = find_copies(settings)
    assert read_subjects(kept) == ["S2"]
    assert CANARY.encode() not in kept.read_bytes()


def test_an_erasure_whose_copy_cannot_be_written_is_unfinished_and_goes_on(
    client: TestClient, settings: Settings, monkeypatch: pytest.MonkeyPatch, copy: Copy
) -> None:
    gone = client.post("/api/v1/recordings", content=b"one", params={"subject": CANARY}).json()["id"]
    copy()

    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(copies, "_write", fail)
        answer = client.delete(f"/api/v1/recordings/{gone}", params={"purge": "now"})
    assert (answer.status_code, answer.json()["code"]) == (503, "E-PURGE-UNFINISHED")
    assert find_copies(settings) == ()
    assert client.app.state.services.recordings.find_purging() == (gone,)  # type: ignore[attr-defined]

    apply_retention(client.app.state.services, 60.0)  # type: ignore[attr-defined]

    assert client.app.state.services.recordings.find_purging() == ()  # type: ignore[attr-defined]
    assert read_subjects(find_copies(settings)[0]) == []


def test_the_answer_to_an_erasure_says_until_when_backups_can_hold_the_person(
    client: TestClient, acromion: Acromion, tmp_path: Path
) -> None:
    def erase(content: bytes) -> dict[str, str]:
        kept = client.post("/api/v1/recordings", content=content).json()["id"]
        return dict(client.delete(f"/api/v1/recordings/{kept}", params={"purge": "now"}).json())

    before, began = erase(b"1"), datetime.now(UTC)
    for number in (1, 2):
        acromion("backup", tmp_path / f"b-{number}.zip", "--keep", "3")
    kept = erase(b"2")
    acromion("backup", tmp_path / "b.zip")
    acromion("backup", tmp_path / "b-3.zip", "--keep", "3")
    unlimited = erase(b"3")

    assert (before["backups"], kept["backups"], unlimited["backups"]) == ("none", "until", "unlimited")
    days = {(moment + timedelta(days=4)).strftime("%Y-%m-%d") for moment in (began, datetime.now(UTC))}
    assert kept["backups_until"] in days  # three further backups, one a day, and a day


def test_keep_deletes_older_backups_of_the_name_and_no_other_file(
    add_job: AddJob, acromion: Acromion, tmp_path: Path
) -> None:
    add_job()
    folder = tmp_path / "backups"
    folder.mkdir()
    (folder / "thesis-1.zip").touch()
    (folder / "acromion-1.zip.age").touch()

    for day in (1, 2, 3):
        done = acromion("backup", folder / f"acromion-{day}.zip", "--keep", "2")
        assert done.exit_code == 0, done.output

    kept = ["acromion-2.zip", "acromion-3.zip", "thesis-1.zip"]
    assert sorted(path.name for path in folder.iterdir()) == kept
    assert "acromion-1.zip" in done.output
    without_date = acromion("backup", tmp_path / "b.zip", "--keep", "2")
    assert (without_date.exit_code, (tmp_path / "b.zip").exists()) == (2, False)


# --- recover --------------------------------------------------------------------------------------------


def test_recover_begins_with_the_copy_and_takes_newer_rows_from_the_side_files(
    settings: Settings, acromion: Acromion
) -> None:
    with TestClient(create_app(settings), base_url="http://localhost") as client:
        first = client.post("/api/v1/recordings", content=b"one", params={"subject": "S1"}).json()["id"]
        client.post("/api/v1/webhooks", json={"url": "https://example.org/"})
        services = client.app.state.services  # type: ignore[attr-defined]
        services.mappings.put("00aa", "ours", "{}", is_confirmed=False)
        keep_daily_copy(settings, services.store.engine)
        client.patch(f"/api/v1/recordings/{first}", json={"subject": "S1 corrected"})
        client.post("/api/v1/recordings", content=b"two", params={"subject": "S2"})
    lose_sqlite(settings)
    JobStore(settings).close()  # as after a refused start

    done = acromion("recover")
    again = acromion("recover")

    assert (done.exit_code, "daily copy" in done.output) == (0, True)
    assert "daily copy" not in again.output  # which never replaces a database that holds recordings
    application = create_app(settings)
    with TestClient(application):
        services = application.state.services
        rows = services.recordings.find_page(RecordingFilter(), 10)
        assert sorted(row.about.subject for row in rows) == ["S1 corrected", "S2"]
        assert [one.name for one in services.mappings.find_all()] == ["ours"]


def test_a_folder_copied_while_the_server_runs_starts_elsewhere_with_no_further_file(
    client: TestClient, settings: Settings, tmp_path: Path
) -> None:
    kept = client.post("/api/v1/recordings", content=b"one", params={"subject": "S1"}).json()["id"]
    shutil.copytree(settings.data_dir, tmp_path / "elsewhere")

    there = Settings(data_dir=tmp_path / "elsewhere", min_free_bytes=0)
    with TestClient(create_app(there), base_url="http://localhost") as other:
        assert other.get(f"/api/v1/recordings/{kept}").json()["subject"] == "S1"
        assert other.get(f"/api/v1/recordings/{kept}/file").content == b"one"
