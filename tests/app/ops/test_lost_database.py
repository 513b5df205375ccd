"""What a start does with recordings that the database does not know, and how they come back."""

import json
import os
import shutil
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import text

from acromion.app.errors import UnknownRecordings
from acromion.app.library.database.connect import connect
from acromion.app.library.jobs import JobStore
from acromion.app.library.side_files import decode_side_file
from acromion.app.ops.recover import read_side_file
from acromion.app.queue.worker import open_worker_context, run_next
from acromion.app.settings import Settings
from acromion.app.store.folder import Storage, format_side_file_name, read_recording
from tests.app import stand_ins
from tests.app.conftest import on_both_set_ups, serving
from tests.app.ops.conftest import Acromion, lose_sqlite


def upload(client: TestClient, content: bytes, **said: str) -> str:
    answer = client.post("/api/v1/recordings", params={"file_name": "shift.gt3x"} | said, content=content)
    return str(answer.json()["id"])


def analyse(settings: Settings, client: TestClient, recording_id: str) -> str:
    """Have a stored recording analysed by a stand-in for the science."""
    asked = client.post("/api/v1/analyses", json={"recording_ids": [recording_id]})
    worker = open_worker_context(settings, stand_ins.write_report)
    assert run_next(worker)
    worker.store.close()
    return str(asked.json()["items"][0]["id"])


def lose_database(settings: Settings) -> None:
    """Delete every table."""
    if settings.database_url.startswith("sqlite"):
        lose_sqlite(settings)
        return
    engine = connect(settings.database_url)
    with engine.begin() as connection:
        connection.execute(text("DROP SCHEMA public CASCADE"))
        connection.execute(text("CREATE SCHEMA public"))
    engine.dispose()


def keep_older_copy(settings: Settings) -> Callable[[], None]:
    """Copy the database; return what puts the copy in place of a later one."""
    database, older = settings.data_dir / "acromion.sqlite3", settings.data_dir.with_name("older")
    shutil.copy(database, older)

    def put_back() -> None:
        lose_sqlite(settings)
        shutil.copy(older, database)

    return put_back


def read_every_byte(storage: Storage) -> dict[str, bytes]:
    """Return what is kept, by name, without the side files."""
    names = [
        name for name in storage.find_names() if not name.endswith(".json") or name.startswith("analyses/")
    ]
    return {name: storage.read_small(name) or b"" for name in names}


# --- the side file --------------------------------------------------------------------------------------


@on_both_set_ups
def test_a_recording_and_every_change_of_it_are_in_its_side_file(
    settings: Settings, storage: Storage
) -> None:
    tea = {"start": "2026-03-02T09:00:00", "end": "2026-03-02T09:15:00", "kind": "break", "label": "tea"}
    with serving(settings) as client:
        place = f"/api/v1/recordings/{upload(client, b'one', subject='S012', side='left')}"
        client.patch(place, json={"subject": "S013"})
        client.put(f"{place}/periods", json=[tea])
        client.delete(place)
    side = read_side_file(storage, place.rpartition("/")[2])

    assert side is not None
    told = [side.recording[name] for name in ("file_name", "subject", "side", "state")]
    assert told == ["shift.gt3x", "S013", "left", "trashed"]
    assert [entry["label"] for entry in json.loads(side.recording["diary"])] == ["tea"]


def test_a_side_file_with_an_altered_digit_or_of_another_recording_is_not_valid(
    settings: Settings, storage: Storage
) -> None:
    with serving(settings) as client:
        first, second = upload(client, b"one", subject="S012"), upload(client, b"two")
    content = storage.read_small(format_side_file_name(first))

    assert content is not None
    assert decode_side_file(content, first) is not None
    assert decode_side_file(content.replace(b"S012", b"S013"), first) is None
    assert decode_side_file(content, second) is None


def test_the_first_start_of_a_folder_without_side_files_writes_them_all(
    settings: Settings, storage: Storage
) -> None:
    with serving(settings) as client:
        kept = [upload(client, content) for content in (b"one", b"two", b"three")]
    for recording_id in kept:
        (storage.root / format_side_file_name(recording_id)).unlink()

    with serving(settings):
        assert all(read_side_file(storage, recording_id) is not None for recording_id in kept)


def test_a_side_file_that_was_not_written_is_written_by_the_next_start(
    settings: Settings, storage: Storage, store: JobStore
) -> None:
    with serving(settings) as client:
        recording_id = upload(client, b"one", subject="S012")
        with store.engine.begin() as connection:  # as a change whose writer was killed after the commit
            connection.execute(text("UPDATE recordings SET subject = 'S013', revision = revision + 1"))

    with serving(settings):
        side = read_side_file(storage, recording_id)

    assert side is not None
    assert side.recording["subject"] == "S013"


# --- the start ------------------------------------------------------------------------------------------


@on_both_set_ups
def test_a_start_with_a_lost_database_is_refused_and_removes_nothing(
    settings: Settings, storage: Storage
) -> None:
    with serving(settings) as client:
        analyse(settings, client, upload(client, b"one"))
        upload(client, b"two")
    before = read_every_byte(storage)
    lose_database(settings)

    with pytest.raises(UnknownRecordings) as refusal, serving(settings):
        pass

    assert refusal.value.facts["number"] == 2
    assert read_every_byte(storage) == before


def test_a_start_with_an_older_database_is_refused_with_its_cure_and_removes_nothing(
    settings: Settings, storage: Storage, acromion: Acromion
) -> None:
    with serving(settings) as client:
        upload(client, b"one")
    put_back = keep_older_copy(settings)
    with serving(settings) as client:
        upload(client, b"two")
        upload(client, b"three")
    before = read_every_byte(storage)
    put_back()

    with pytest.raises(UnknownRecordings) as refusal, serving(settings):
        pass
    done = acromion("serve", "--port", "0", "--data", settings.data_dir)

    assert refusal.value.facts["number"] == 2
    assert done.exit_code == 2
    assert "E-UNKNOWN-RECORDINGS" in done.stderr
    assert "acromion recover" in done.stderr
    assert read_every_byte(storage) == before


def test_a_stranger_s_files_go_to_quarantine_of_which_page_and_doctor_tell(
    settings: Settings, storage: Storage, acromion: Acromion
) -> None:
    names = ("holiday.jpg", "rec_0123456789abcdef", "notes.json", "mine/file")
    (storage.root / "recordings" / "mine").mkdir()
    for name in names:
        (storage.root / "recordings" / name).write_bytes(b"mine")
    os.mkfifo(storage.root / "recordings" / "x.json")  # which holds up no start

    with serving(settings) as client:
        page = client.get("/", headers={"Accept-Language": "en"}).text
    doctor = acromion("doctor")

    for name in names:
        assert (storage.root / "quarantine" / name).read_bytes() == b"mine"
        assert not (storage.root / "recordings" / name).exists()
    assert "x.json" in storage.find_quarantined()
    assert "moved to a separate folder: 5" in page
    assert (doctor.exit_code, "holiday.jpg" in doctor.output) == (1, True)


def test_an_unknown_file_in_a_bucket_stays_where_it_is(
    tmp_path: Path, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    swift = request.getfixturevalue("swift")
    for name, value in swift.environment.items():
        monkeypatch.setenv(name, value)
    settings = Settings(data_dir=tmp_path / "data", object_store=swift.make_bucket(), min_free_bytes=0)
    with serving(settings) as client:
        storage: Storage = client.app.state.services.storage  # type: ignore[attr-defined]
        storage.write_small("recordings/rec_0123456789abcdef", b"another machine's, its row is on the way")

    with serving(settings):
        assert storage.read_small("recordings/rec_0123456789abcdef") is not None


def test_a_recording_in_quarantine_comes_back_with_its_row(settings: Settings, storage: Storage) -> None:
    with serving(settings) as client:
        recording_id = upload(client, b"one")
    put_back = keep_older_copy(settings)
    (storage.root / format_side_file_name(recording_id)).unlink()
    lose_database(settings)
    with serving(settings):
        assert (storage.root / "quarantine" / recording_id).exists()
    put_back()

    with serving(settings):
        assert read_recording(storage, recording_id, 0, 10) == b"one"


def test_a_start_removes_an_attempt_of_a_known_analysis_that_does_not_count_and_no_other(
    settings: Settings, storage: Storage
) -> None:
    with serving(settings) as client:
        analysis_id = analyse(settings, client, upload(client, b"one"))
    unknown = ("an_0123456789abcdef", "token")
    for attempt in ((analysis_id, "dead"), unknown):
        (storage.open_attempt(*attempt) / "results.json").write_bytes(b"{}")

    with serving(settings):
        (counts,) = set(storage.find_attempts()) - {unknown}

    assert counts[0] == analysis_id
    assert counts[1] != "dead"


# --- a purge that is interrupted ------------------------------------------------------------------------


@contextmanager
def interrupted(storage: Storage, step: str) -> Iterator[None]:
    """Fail at a step of a purge, as a kill does."""

    def fail(*_: object) -> None:
        raise OSError("killed here")

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(type(storage), step, fail)
        yield


@pytest.mark.parametrize("loses", [False, True], ids=["database there", "database lost"])
@pytest.mark.parametrize("step", ["drop_analysis", "drop_recording"])
def test_an_interrupted_purge_goes_on_at_the_next_start_and_does_not_come_back(
    settings: Settings, storage: Storage, acromion: Acromion, step: str, loses: bool
) -> None:
    with serving(settings) as client:
        analyse(settings, client, recording_id := upload(client, b"one", subject="S012"))
        with interrupted(storage, step), pytest.raises(OSError, match="killed"):
            client.delete(f"/api/v1/recordings/{recording_id}?purge=now")
    assert " MISSING" not in acromion("verify").output
    if loses:
        lose_database(settings)
        acromion("recover")

    with serving(settings) as client:
        assert client.get(f"/api/v1/recordings/{recording_id}").status_code == 404
        assert list(storage.find_names()) == []


def test_what_a_killed_worker_left_of_an_erased_analysis_is_removed_at_the_next_start(
    settings: Settings, storage: Storage
) -> None:
    with serving(settings) as client:
        analysis_id = analyse(settings, client, recording_id := upload(client, b"one"))
        client.delete(f"/api/v1/recordings/{recording_id}?purge=now")
    (storage.open_attempt(analysis_id, "late") / "results.json").write_bytes(b"{}")

    with serving(settings):
        assert list(storage.find_names()) == []


def test_a_purge_reaches_the_reports_of_two_and_moves_what_lies_in_place_of_a_recording_to_quarantine(
    settings: Settings, storage: Storage
) -> None:
    pair = settings.data_dir / "cache" / "pairs" / "0123"
    with serving(settings) as client:
        recording_id = upload(client, b"one", subject="S012")
        pair.mkdir(parents=True)
        (pair / "answer.en.txt").write_text("S012")
        place = storage.root / "recordings" / recording_id
        place.unlink()
        place.mkdir()
        (place / "file").write_bytes(b"a stranger's")
        answer = client.delete(f"/api/v1/recordings/{recording_id}?purge=now")

    assert answer.status_code == 200
    assert not pair.exists()
    assert (storage.root / "quarantine" / recording_id / "file").read_bytes() == b"a stranger's"


# --- recover --------------------------------------------------------------------------------------------


@on_both_set_ups
def test_recover_brings_back_recordings_with_all_that_was_known_of_them(
    settings: Settings, storage: Storage, acromion: Acromion
) -> None:
    with serving(settings) as client:
        first = upload(client, b"one", subject="S012", side="left", external_id="study-7", note="left-handed")
        trashed = upload(client, b"two")
        client.delete(f"/api/v1/recordings/{trashed}")
    lose_database(settings)

    done = acromion("recover")

    assert done.exit_code == 0, done.output
    assert "recovered: 2 (in the trash: 1" in done.output
    with serving(settings) as client:
        row = client.get(f"/api/v1/recordings/{first}").json()
        in_trash = client.get("/api/v1/recordings", params={"trashed": True}).json()["items"]
    told = (row["subject"], row["side"], row["external_id"], row["note"])
    assert told == ("S012", "left", "study-7", "left-handed")
    assert [entry["id"] for entry in in_trash] == [trashed]


@on_both_set_ups
def test_recover_brings_back_the_reports(settings: Settings, acromion: Acromion) -> None:
    with serving(settings) as client:
        analysis_id = analyse(settings, client, upload(client, b"one"))
        before = client.get(f"/api/v1/analyses/{analysis_id}/results.json").content
    lose_database(settings)

    done = acromion("recover")

    assert "reports: 1" in done.output
    with serving(settings) as client:
        after = client.get(f"/api/v1/analyses/{analysis_id}/results.json")
    assert (after.status_code, after.content) == (200, before)


def test_recover_queues_again_what_was_queued_with_its_batch_and_done_twice_changes_nothing_more(
    settings: Settings, acromion: Acromion
) -> None:
    with serving(settings) as client:
        items = [{"recording_id": upload(client, b"one")}]
        batch = client.post("/api/v1/batches", json={"name": "wave 1", "items": items}).json()
        (asked,) = client.get("/api/v1/analyses").json()["items"]
    lose_database(settings)

    acromion("recover")
    again = acromion("recover")

    with serving(settings) as client:
        assert client.get(f"/api/v1/analyses/{asked['id']}").json()["state"] == "queued"
        assert client.get(f"/api/v1/batches/{batch['id']}").json()["name"] == "wave 1"
    assert (again.exit_code, "recovered: 0" in again.output) == (0, True)


def test_recover_adds_to_an_older_database_and_keeps_its_rows(
    settings: Settings, storage: Storage, acromion: Acromion, tmp_path: Path
) -> None:
    with serving(settings) as client:
        old = upload(client, b"one", subject="old")
    put_back = keep_older_copy(settings)
    with serving(settings) as client:
        new = upload(client, b"two", subject="new")
        client.patch(f"/api/v1/recordings/{old}", json={"subject": "changed since"})
    put_back()

    made, done = acromion("backup", tmp_path / "b.zip"), acromion("recover")

    assert (made.exit_code, f"NOT IN THE DATABASE recordings/{new}" in made.output) == (1, True)
    assert (done.exit_code, f"DATABASE OLDER {old}" in done.output) == (4, True)
    kept = [storage.read_small(f"quarantine/{name}") or b"" for name in storage.find_quarantined()]
    assert [b"changed since" in text for text in kept] == [True]
    with serving(settings) as client:
        subjects = [client.get(f"/api/v1/recordings/{one}").json()["subject"] for one in (old, new)]
    assert subjects == ["old", "new"]


def test_a_report_that_an_older_database_does_not_know_stays_and_recover_brings_it_back(
    settings: Settings, storage: Storage, acromion: Acromion
) -> None:
    with serving(settings) as client:
        asked = client.post("/api/v1/analyses", json={"recording_ids": [upload(client, b"one")]}).json()
    put_back = keep_older_copy(settings)
    with serving(settings):
        worker = open_worker_context(settings, stand_ins.write_report)
        run_next(worker)
        worker.store.close()
    before = read_every_byte(storage)
    put_back()

    with serving(settings):
        assert read_every_byte(storage) == before
    put_back()
    done = acromion("recover")

    assert "reports: 1" in done.output
    assert "REPORT MISSING" not in done.output
    with serving(settings) as client:
        assert client.get(f"/api/v1/analyses/{asked['id']}/results.json").status_code == 200
        assert client.get(f"/api/v1/analyses/{asked['id']}").json()["state"] == "succeeded"


@pytest.mark.parametrize("recovers", [False, True], ids=["start", "recover"])
def test_over_an_older_database_what_was_erased_is_erased_again_and_what_was_trashed_is_told(
    settings: Settings, acromion: Acromion, recovers: bool
) -> None:
    with serving(settings) as client:
        trashed, purged = upload(client, b"one"), upload(client, b"two")
    put_back = keep_older_copy(settings)
    with serving(settings) as client:
        client.delete(f"/api/v1/recordings/{trashed}")
        client.delete(f"/api/v1/recordings/{purged}?purge=now")
    put_back()

    told = f"IN THE TRASH SINCE {trashed} Erased recordings skipped: 1."
    told = acromion("recover").output if recovers else told

    assert "Erased recordings skipped: 1." in told
    assert f"IN THE TRASH SINCE {trashed}" in told
    assert purged not in told
    with serving(settings) as client:
        assert client.get(f"/api/v1/recordings/{purged}").status_code == 404
        assert [one["id"] for one in client.get("/api/v1/recordings").json()["items"]] == [trashed]
    store = JobStore(settings)
    assert store.find_recordings() == {trashed}
    store.close()


@pytest.mark.parametrize("content", [None, b"onE"], ids=["gone", "altered"])
def test_the_api_and_the_doctor_name_a_recording_whose_bytes_are_not_its_own(
    settings: Settings, storage: Storage, acromion: Acromion, content: bytes | None
) -> None:
    with serving(settings) as client:
        recording_id = upload(client, b"one")
        place = storage.root / "recordings" / recording_id
        place.unlink()
        if content is not None:
            place.write_bytes(content)
        view = client.get(f"/api/v1/recordings/{recording_id}").json()
    doctor = acromion("doctor")

    assert view["damage"] == "E-STORE-DAMAGED"
    assert doctor.exit_code == 1
    assert f"recordings/{recording_id}" in doctor.output


def test_recover_names_a_recording_whose_bytes_are_gone(
    settings: Settings, storage: Storage, acromion: Acromion
) -> None:
    with serving(settings) as client:
        recording_id = upload(client, b"one")
    lose_database(settings)
    (storage.root / "recordings" / recording_id).unlink()

    done = acromion("recover")

    assert done.exit_code == 4
    assert f"BYTES MISSING {recording_id}" in done.output
    verified = acromion("verify")
    assert verified.exit_code == 1
    assert f"MISSING recordings/{recording_id}" in verified.output


def test_recover_is_refused_while_a_server_runs(settings: Settings, acromion: Acromion) -> None:
    with serving(settings):
        refused = acromion("recover")

    assert refused.exit_code == 3
    assert "E-FOLDER-IN-USE" in refused.stderr


# --- verify ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "finding"),
    [
        ("revision = revision + 1", "SIDE FILE NOT YET WRITTEN"),
        ("revision = revision + 1, side_revision = revision + 1", "SIDE FILE BEHIND ITS ROW"),
        ("revision = revision - 1", "SIDE FILE AHEAD OF ITS ROW"),
        (None, "NO SIDE FILE"),
        (b"", "SIDE FILE DAMAGED"),
        (b"{}", "SIDE FILE DAMAGED"),
    ],
)
def test_verify_names_a_side_file_that_is_absent_damaged_or_not_of_its_row(
    settings: Settings, storage: Storage, acromion: Acromion, change: str | bytes | None, finding: str
) -> None:
    with serving(settings) as client:
        recording_id = upload(client, b"one")
    side = storage.root / format_side_file_name(recording_id)
    if isinstance(change, str):
        with sqlite3.connect(settings.data_dir / "acromion.sqlite3") as rows:
            rows.execute(f"UPDATE recordings SET {change}")
    else:
        side.unlink() if change is None else side.write_bytes(change)

    verified = acromion("verify")

    assert verified.exit_code == 1
    assert f"{finding} recordings/{recording_id}.json" in verified.output


def test_recover_writes_a_damaged_side_file_again(
    settings: Settings, storage: Storage, acromion: Acromion
) -> None:
    with serving(settings) as client:
        recording_id = upload(client, b"one", subject="S012")
    (storage.root / format_side_file_name(recording_id)).write_bytes(b"{}")

    acromion("recover")

    side = read_side_file(storage, recording_id)
    assert side is not None
    assert side.recording["subject"] == "S012"
    assert acromion("verify").exit_code == 0
