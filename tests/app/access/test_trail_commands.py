"""The trail, terms and holds by command, and what the doctor says."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from sqlalchemy import delete, update
from typer.testing import CliRunner

from app.access.accounts import AccountStore
from app.cli import app
from app.jobs.database.tables import trail
from app.jobs.organisations import find_organisations
from app.jobs.store import JobStore
from app.jobs.trail import TrailQuestion, find_lines, read_head
from app.settings import Settings
from app.upkeep.doctor import examine
from tests.app.conftest import AddJob


def run(settings: Settings, *words: str) -> tuple[int, str]:
    """Run a command over the folder; gives its exit code and what it prints."""
    done = CliRunner().invoke(app, [*words, "--data", str(settings.data_dir)])
    return done.exit_code, done.output


@pytest.fixture
def anchored(settings: Settings, store: JobStore, add_job: AddJob, tmp_path: Path) -> Settings:
    """A trail whose head is written down."""
    add_job()
    head = read_head(store.reader)
    line = {"organisation": "own", "at": head.at, "seq": head.seq, "hash": head.hash}
    (tmp_path / "anchor").write_text(json.dumps(line) + "\n")
    return settings.model_copy(update={"trail_anchor": str(tmp_path / "anchor")})


def test_a_whole_trail_is_said_to_be_whole(settings: Settings, store: JobStore, add_job: AddJob) -> None:
    add_job()

    code, told = run(settings, "trail", "verify")

    assert code == 0
    assert "3 lines: none altered, none removed." in told
    assert "ACROMION_TRAIL_ANCHOR" in told


def test_the_command_names_a_line_that_was_altered(
    settings: Settings, store: JobStore, add_job: AddJob
) -> None:
    add_job()
    store.run(update(trail).where(trail.c.seq == 2).values(who="per_x"))

    code, told = run(settings, "trail", "verify")

    assert code == 1
    assert "ALTERED line 2" in told


def test_the_command_names_an_end_that_was_cut_off(
    anchored: Settings, settings: Settings, store: JobStore
) -> None:
    store.run(delete(trail).where(trail.c.seq == 3))

    code, told = run(settings, "trail", "verify", "--anchor", anchored.trail_anchor)

    assert code == 1
    assert "CUT OFF lines 3 to 3" in told


def test_the_doctor_says_that_a_cut_end_cannot_be_seen_without_an_anchor(
    settings: Settings, store: JobStore
) -> None:
    found = {one.name: one.healthy for one in examine(settings)}

    assert found["trail"]
    assert found["trail_unanchored"]
    assert "trail_anchor" not in found


def test_the_doctor_names_an_end_that_was_cut_off(anchored: Settings, store: JobStore) -> None:
    store.run(delete(trail).where(trail.c.seq == 3))

    found = {one.name: one for one in examine(anchored)}

    assert not found["trail"].healthy
    assert (found["trail"].facts["finding"], found["trail_anchor"].healthy) == ("cut", True)


def test_the_command_answers_who_touched_a_subject(
    settings: Settings, store: JobStore, add_job: AddJob
) -> None:
    job = add_job(subject="W-1")
    add_job(b"another", subject="W-2")

    _, told = run(settings, "trail", "show", "--subject", "W-1", "--form", "jsonl")

    lines = [json.loads(line) for line in told.splitlines()]
    assert [line["act"] for line in lines] == ["analysis.asked", "recording.stored"]
    assert {line["recording_id"] for line in lines} == {job.recording_id}


def test_a_hold_by_command_is_of_the_machine(settings: Settings, store: JobStore, add_job: AddJob) -> None:
    job = add_job()

    assert run(settings, "hold", "begin", job.recording_id)[0] == 0
    assert run(settings, "hold", "end", job.recording_id)[0] == 0

    held = list(find_lines(store.reader, TrailQuestion(who="machine")))
    assert [line.act for line in held] == ["recording.let_go", "recording.held"]


def test_a_term_is_changed_by_command(settings: Settings, store: JobStore) -> None:
    assert "Lines of the trail: kept for good" in run(settings, "retention")[1]
    assert "Lines of the trail: 400 days" in run(settings, "retention", "trail", "400")[1]
    assert "Lines of the trail: kept for good" in run(settings, "retention", "trail", "never")[1]


def test_backup_verify_and_restore_leave_a_line(
    settings: Settings, store: JobStore, add_job: AddJob, tmp_path: Path
) -> None:
    add_job()
    store.close()
    run(settings, "verify")
    run(settings, "backup", str(tmp_path / "copy.zip"))
    there = settings.model_copy(
        update={
            "data_dir": tmp_path / "there",
            "database_url": f"sqlite:///{tmp_path / 'there' / 'acromion.sqlite3'}",
        }
    )

    run(there, "restore", str(tmp_path / "copy.zip"))

    restored = JobStore(there)
    lines = [(line.who, line.act) for line in find_lines(restored.reader, TrailQuestion(who="machine"))]
    restored.close()
    assert lines == [
        ("machine", "store.restored"),
        ("machine", "store.backed_up"),
        ("machine", "store.verified"),
    ]


OF_ANOTHER = '{"organisation": "org_0123456789abcdef", "at": "2026-11-24", "seq": 1, "hash": "00"}\n'


@pytest.fixture(params=[None, "", "x{\n", OF_ANOTHER], ids=["missing", "empty", "damaged", "of another"])
def headless(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A file that is named as the anchor, and holds no head of this trail."""
    file = tmp_path / "heads.jsonl"
    if request.param is not None:
        file.write_text(request.param)
    return file


def test_a_named_file_without_a_head_proves_nothing(
    settings: Settings, store: JobStore, add_job: AddJob, headless: Path
) -> None:
    add_job()

    code, told = run(settings, "trail", "verify", "--anchor", str(headless))

    assert (code, told.split()[0]) == (3, "E-TRAIL-ANCHOR")
    assert str(headless) in told
    assert "none altered" not in told


def test_nor_does_one_that_the_settings_name(
    settings: Settings, store: JobStore, add_job: AddJob, headless: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    add_job()
    monkeypatch.setenv("ACROMION_TRAIL_ANCHOR", str(headless))

    code, told = run(settings, "trail", "verify")

    assert (code, told.split()[0]) == (3, "E-TRAIL-ANCHOR")


def test_the_doctor_fails_over_an_anchor_without_a_head(
    settings: Settings, store: JobStore, add_job: AddJob, headless: Path
) -> None:
    add_job()

    found = examine(settings.model_copy(update={"trail_anchor": str(headless)}))

    assert [one.name for one in found if not one.healthy] == ["trail_anchor_lost"]


def test_a_place_without_a_database_is_refused_and_gets_none(settings: Settings, tmp_path: Path) -> None:
    nowhere = settings.model_copy(
        update={
            "data_dir": tmp_path / "no",
            "database_url": f"sqlite:///{tmp_path / 'no' / 'acromion.sqlite3'}",
        }
    )

    code, told = run(nowhere, "trail", "verify")

    assert code != 0
    assert "E-NOT-FOUND" in told
    assert not (tmp_path / "no").exists()


@pytest.mark.parametrize("moment", ["0001-01-01T00:00:00+14:00", "9999-12-31T23:59:59-14:00"])
def test_a_moment_beyond_the_calendar_is_refused(settings: Settings, store: JobStore, moment: str) -> None:
    code, told = run(settings, "trail", "show", "--from", moment)

    assert code != 0
    assert "E-PARAMETER" in told


@pytest.mark.parametrize("database", ["sqlite", "postgresql"], indirect=True)
@pytest.mark.parametrize(
    "words", [("trail", "verify"), ("trail", "show"), ("retention",), ("hold", "end", "rec_00000000000000ff")]
)
@pytest.mark.parametrize("organisation", ["org_none", "../elsewhere"])
def test_an_organisation_that_is_not_there_is_refused_by_name_and_gets_no_place(
    settings: Settings,
    store: JobStore,
    monkeypatch: pytest.MonkeyPatch,
    words: tuple[str, ...],
    organisation: str,
) -> None:
    for name, value in settings.as_environment().items():
        monkeypatch.setenv(name, value)

    code, told = run(settings, *words, "--organisation", organisation)

    assert code == 3
    assert "E-NOT-FOUND" in told
    assert organisation in told
    assert find_organisations(settings, store.reader) == ()


@pytest.mark.parametrize(
    "words", [("account", "list"), ("trail", "show"), ("retention",), ("version",), ("--help",)]
)
def test_a_command_whose_output_nobody_reads_any_more_ends_and_says_nothing(
    settings: Settings, accounts: AccountStore, store: JobStore, words: tuple[str, ...]
) -> None:
    accounts.add_organisation("own", "Own")

    done = run_unread(settings, *words)

    assert (done.returncode, done.stderr) == (141, b"")


def test_an_account_is_added_though_nobody_reads_on(settings: Settings, accounts: AccountStore) -> None:
    done = run_unread(settings, "account", "add", "boss", "--role", "manager")

    assert (done.returncode, done.stderr) == (141, b"")
    assert [person.login for person in accounts.find_people()] == ["boss"]


def run_unread(settings: Settings, *words: str) -> "subprocess.CompletedProcess[bytes]":
    """Run a command in a process of its own, into a pipe whose reader has left."""
    read_end, write_end = os.pipe()
    os.close(read_end)
    typed = [sys.executable, "-m", "app", *words]
    told = dict(os.environ) | settings.as_environment()
    try:
        return subprocess.run(typed, stdout=write_end, stderr=subprocess.PIPE, env=told, check=False)
    finally:
        os.close(write_end)


def test_a_broken_byte_in_a_question_is_a_usage_error() -> None:
    result = CliRunner().invoke(app, ["trail", "show", "--who", "\udcff"])

    assert result.exit_code == 2
    assert "--who" in result.output
