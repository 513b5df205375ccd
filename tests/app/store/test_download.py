"""The original file of a recording comes back: by the API, in a ZIP, by command."""

import hashlib
import io
import os
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import pytest
from fastapi.testclient import TestClient
from typer.testing import CliRunner

from acromion.app.cli import app
from acromion.app.http.api.library.files import format_disposition
from acromion.app.library.audit_log import AuditFilter, AuditLine, find_lines
from acromion.app.library.jobs import JobStore
from acromion.app.library.recordings import RecordingStore
from acromion.app.library.rows import Job
from acromion.app.request import ReportRequest, clean_file_name
from acromion.app.settings import Settings
from acromion.app.store.folder import Storage
from tests.app.conftest import AddJob, on_both_set_ups
from tests.app.http.test_recordings import keep

CONTENT = bytes(range(256)) * 20_000  # more than one piece of a download
SHA256 = hashlib.sha256(CONTENT).hexdigest()


@pytest.fixture
def settings(settings: Settings) -> Settings:
    return settings.model_copy(update={"max_upload_bytes": 10_000_000})


def build_address(recording_id: str) -> str:
    return f"/api/v1/recordings/{recording_id}/file"


def find_exports(store: JobStore) -> list[AuditLine]:
    return list(find_lines(store.reader, AuditFilter(act="file.exported")))


def add_large(store: JobStore, storage: Storage, file_name: str) -> Job:
    upload = storage.open_upload(10_000_000)
    upload.write(CONTENT)
    return store.add(upload.keep(), ReportRequest(file_name))


# By the API.


@on_both_set_ups
def test_the_bytes_are_those_that_came_and_leave_a_line(client: TestClient, store: JobStore) -> None:
    kept = keep(client, CONTENT, file_name="shift.gt3x")

    answer = client.get(kept["links"]["file"])
    lines = find_exports(store)
    head = client.head(kept["links"]["file"])

    assert (answer.status_code, answer.content == CONTENT) == (200, True)
    assert (head.status_code, head.content) == (200, b"")
    for one in (answer, head):
        assert one.headers["content-type"] == "application/octet-stream"
        assert one.headers["content-length"] == str(len(CONTENT))
        assert one.headers["content-disposition"] == 'attachment; filename="shift.gt3x"'
        assert one.headers["x-content-type-options"] == "nosniff"
        assert one.headers["etag"] == f'"{SHA256}"'
    assert [(line.recording_id, '"name": "file"' in line.other) for line in lines] == [(kept["id"], True)]


WHOLE = {"if-range": f'"{SHA256}"'}
OTHER = {"if-range": '"other"'}
DIGITS = {"range": f"bytes={'9' * 6000}-"}


def test_a_range_gives_that_part_of_the_bytes_that_were_meant(client: TestClient) -> None:
    address = build_address(keep(client, CONTENT)["id"])

    for headers, status, content in (
        ({"range": "bytes=0-3"}, 206, CONTENT[:4]),
        ({"range": "bytes=70000-70009"}, 206, CONTENT[70000:70010]),
        ({"range": "bytes=-5"}, 206, CONTENT[-5:]),
        ({"range": "bytes=4-"} | WHOLE, 206, CONTENT[4:]),
        ({"range": "bytes=4-"} | OTHER, 200, CONTENT),
        (DIGITS, 200, CONTENT),
        (DIGITS | WHOLE, 200, CONTENT),
        (DIGITS | OTHER, 200, CONTENT),
        ({"if-none-match": f'"{SHA256}"'}, 304, b""),
        ({"if-none-match": f'"other", W/"{SHA256}"'}, 304, b""),
    ):
        answer = client.get(address, headers=headers)
        assert (answer.status_code, answer.content == content) == (status, True), str(headers)[:60]
        assert answer.headers["etag"] == f'"{SHA256}"'


def test_several_ranges_come_as_parts_of_one_answer_and_one_behind_the_end_is_refused(
    client: TestClient,
) -> None:
    address, whole = (
        build_address(keep(client, b"abcdefghij")["id"]),
        hashlib.sha256(b"abcdefghij").hexdigest(),
    )

    answer = client.get(address, headers={"range": "bytes=0-1,8-9"})

    assert answer.status_code == 206
    assert b"\r\n\r\nab\r\n" in answer.content
    assert b"\r\n\r\nij\r\n" in answer.content
    for condition in ({}, {"if-range": f'"{whole}"'}):
        refused = client.get(address, headers={"range": "bytes=10-"} | condition)
        assert (refused.status_code, refused.json()["code"]) == (416, "E-RANGE")
        assert refused.headers["content-range"] == "bytes */10"


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("épaule été.csv", "filename=\"epaule ete.csv\"; filename*=UTF-8''%C3%A9paule%20%C3%A9t%C3%A9.csv"),
        ('a"b.csv', "filename=\"a_b.csv\"; filename*=UTF-8''a%22b.csv"),
        ("100%25.csv", "filename=\"100_25.csv\"; filename*=UTF-8''100%2525.csv"),
        ("肩.csv", "filename=\"_.csv\"; filename*=UTF-8''%E8%82%A9.csv"),
        ("a; b.csv", 'filename="a; b.csv"'),
        ("a\r\nSet-Cookie: b.csv", 'filename="aSet-Cookie: b.csv"'),
        ("../../etc/passwd", 'filename="passwd"'),
    ],
)
def test_a_name_stays_what_it_is(name: str, told: str) -> None:
    assert format_disposition(clean_file_name(name)) == f"attachment; {told}"


def test_no_name_ends_the_header() -> None:
    told = format_disposition('a\r\nb\\"/\x00\x7f.csv')

    assert told.startswith('attachment; filename="a__b_____.csv"; ')
    assert told.isascii()
    assert told.isprintable()


def test_a_recording_that_is_not_there_is_not_found(client: TestClient) -> None:
    trashed, erased = (keep(client, content)["id"] for content in (b"1", b"2"))
    client.delete(f"/api/v1/recordings/{trashed}")
    client.delete(f"/api/v1/recordings/{erased}?purge=now")

    for recording_id in (trashed, erased, "rec_00000000000000ff"):
        answer = client.get(build_address(recording_id))
        assert (answer.status_code, answer.json()["code"]) == (404, "E-NOT-FOUND")


@pytest.mark.parametrize("how", ["altered", "missing"])
def test_damaged_bytes_are_not_given(client: TestClient, settings: Settings, how: str) -> None:
    kept = keep(client, CONTENT)
    damage(settings, kept["id"], how)

    answer = client.get(build_address(kept["id"]))

    assert (answer.status_code, answer.json()["code"]) == (410, "E-STORE-DAMAGED")


def damage(settings: Settings, recording_id: str, how: str) -> None:
    path = settings.data_dir / "recordings" / recording_id
    if how == "missing":
        path.unlink()
    else:
        octets = bytearray(path.read_bytes())
        octets[-1] ^= 1
        path.write_bytes(octets)


def test_the_document_says_that_the_answer_is_a_file(client: TestClient) -> None:
    paths = client.get("/api/v1/openapi.json").json()["paths"]

    answer = paths["/api/v1/recordings/{recording_id}/file"]["get"]["responses"]["200"]
    assert answer["content"] == {
        "application/octet-stream": {"schema": {"type": "string", "format": "binary"}}
    }


# In a ZIP.


def read_zip(client: TestClient, name: str = "recordings.zip", **query: str) -> dict[str, bytes]:
    answer = client.get("/library/recordings.zip", params=query)
    assert answer.headers["content-disposition"] == f'attachment; filename="{name}"'
    with ZipFile(io.BytesIO(answer.content)) as packed:
        assert packed.testzip() is None
        return {name: packed.read(name) for name in packed.namelist()}


def join_study(store: JobStore, *jobs: Job) -> str:
    return {store.join_study("spring", job.id) for job in jobs}.pop()


def test_the_zip_of_a_study_holds_the_originals_of_the_study(
    client: TestClient, store: JobStore, storage: Storage, add_job: AddJob
) -> None:
    first, second = add_large(store, storage, "one.csv"), add_job(b"22", "two.csv")
    add_job(b"333", "elsewhere.csv")
    study = join_study(store, first, second)

    assert read_zip(client, "spring_recordings.zip", batch=study) == {"one.csv": CONTENT, "two.csv": b"22"}


def test_two_of_one_name_are_both_in_the_zip(client: TestClient, add_job: AddJob) -> None:
    first, second = add_job(b"1", "CWA-DATA.CWA"), add_job(b"2", "cwa-data.cwa")

    assert read_zip(client) == {"cwa-data.cwa": b"2", f"CWA-DATA_{first.recording_id}.CWA": b"1"}
    assert second.recording_id != first.recording_id


def test_a_recording_of_two_analyses_is_in_the_zip_once(
    client: TestClient, store: JobStore, add_job: AddJob
) -> None:
    job = add_job(b"1", "one.csv")
    items = [{"recording_id": job.recording_id, "settings": {"side": side}} for side in ("left", "right")]
    batch = client.post("/api/v1/batches", json={"items": items}).json()

    assert read_zip(client, batch=batch["id"]) == {"one.csv": b"1"}


@pytest.mark.parametrize(
    ("name", "packed"),
    [("..", "recording"), ('a<b>:"c|d?.csv', "a-b---c-d-.csv"), ("épaule.csv", "épaule.csv")],
)
def test_a_name_in_the_zip_can_be_unpacked_anywhere(
    client: TestClient, add_job: AddJob, name: str, packed: str
) -> None:
    add_job(b"1", name)

    assert list(read_zip(client)) == [packed]


@pytest.mark.parametrize("how", ["altered", "missing"])
def test_what_the_zip_lacks_is_named_in_it(
    client: TestClient, settings: Settings, add_job: AddJob, how: str
) -> None:
    lost = add_job(b"lost", "lost.csv")
    add_job(b"kept", "kept.csv")
    damage(settings, lost.recording_id, how)

    found = read_zip(client)

    told = found.pop("without-recording.txt").decode()
    assert found == {"kept.csv": b"kept"}
    assert told == f"lost.csv ({lost.recording_id}): The stored recording is damaged or missing\n"


def test_a_recording_that_is_called_like_the_note_is_not_taken_for_it(
    client: TestClient, add_job: AddJob
) -> None:
    job = add_job(b"1", "without-recording.txt")

    assert read_zip(client) == {f"without-recording_{job.recording_id}.txt": b"1"}


def test_each_recording_of_a_zip_has_a_line(client: TestClient, store: JobStore, add_job: AddJob) -> None:
    ids = {add_job(b"1").recording_id, add_job(b"2").recording_id}

    read_zip(client)

    assert {line.recording_id for line in find_exports(store)} == ids


# By command.


def get(settings: Settings, *words: str) -> Any:
    return CliRunner().invoke(app, ["get", *words, "--data", str(settings.data_dir)])


def test_the_command_writes_the_original(
    settings: Settings, store: JobStore, storage: Storage, tmp_path: Path
) -> None:
    job = add_large(store, storage, "shift.gt3x")

    done = get(settings, job.recording_id, "-o", str(tmp_path / "out.gt3x"))

    assert done.exit_code == 0, done.output
    assert (tmp_path / "out.gt3x").read_bytes() == CONTENT
    assert f"SHA-256 {SHA256}" in done.output
    lines = find_exports(store)
    assert [(line.who, line.recording_id, line.other) for line in lines] == [
        ("machine", job.recording_id, '{"command": "get"}')
    ]


def test_a_file_that_is_there_is_kept_unless_forced_and_only_its_owner_may_read_it(
    settings: Settings, add_job: AddJob, tmp_path: Path
) -> None:
    job, out = add_job(b"recording"), tmp_path / "out"
    out.write_bytes(b"mine")

    refused = get(settings, job.recording_id, "-o", str(out))
    left = out.read_bytes()
    forced = get(settings, job.id, "-o", str(out), "--force")  # an analysis names its recording

    assert (refused.exit_code, left) == (2, b"mine")
    assert (forced.exit_code, out.read_bytes()) == (0, b"recording")
    assert out.stat().st_mode & 0o777 == 0o600


@pytest.mark.parametrize("out", [os.devnull, "."])
def test_what_is_no_file_is_never_replaced(settings: Settings, add_job: AddJob, out: str) -> None:
    assert get(settings, add_job().recording_id, "-o", out, "--force").exit_code == 2


def test_an_unknown_recording_is_refused_by_the_command(
    settings: Settings, store: JobStore, add_job: AddJob, tmp_path: Path
) -> None:
    trashed, out = add_job().recording_id, ("-o", str(tmp_path / "out"))
    RecordingStore(store.engine, store.reader).trash(trashed)
    no_place = settings.model_copy(update={"data_dir": tmp_path / "no"})

    for recording_id in ("rec_00000000000000ff", "shift.gt3x", "", trashed):
        done = get(settings, recording_id, *out)
        assert (done.exit_code, "E-NOT-FOUND" in done.output) == (3, True), done.output
    assert get(settings, "rec_\udcff", *out).exit_code == 2  # a broken byte of the terminal
    empty = get(no_place, "rec_x", *out)
    assert (empty.exit_code, "E-NOT-FOUND" in empty.output) == (3, True)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("how", ["altered", "missing"])
def test_the_command_writes_no_damaged_recording(
    settings: Settings, store: JobStore, add_job: AddJob, tmp_path: Path, how: str
) -> None:
    job = add_job()
    damage(settings, job.recording_id, how)

    done = get(settings, job.recording_id, "-o", str(tmp_path / "out"))

    assert (done.exit_code, "E-STORE-DAMAGED" in done.output) == (3, True)
    assert [path.name for path in tmp_path.iterdir()] == ["data"]
    assert find_exports(store) == []


def test_a_place_that_cannot_be_written_is_told(settings: Settings, add_job: AddJob, tmp_path: Path) -> None:
    done = get(settings, add_job().recording_id, "-o", str(tmp_path / "no" / "folder"))

    assert (done.exit_code, "E-FILE" in done.output) == (3, True)
    assert str(tmp_path / "no") in done.output
