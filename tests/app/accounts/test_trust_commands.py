"""The audit log, terms and holds by command."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from app.access.accounts import AccountStore
from app.cli import app
from app.jobs.audit_log import AuditQuestion, find_lines
from app.jobs.store import JobStore
from app.settings import Settings
from tests.app.conftest import AddJob


def run(settings: Settings, *words: str) -> tuple[int, str]:
    """Run a command over the folder; return its exit code and what it prints."""
    done = CliRunner().invoke(app, [*words, "--data", str(settings.data_dir)])
    return done.exit_code, done.output


def test_the_command_answers_who_touched_a_subject(
    settings: Settings, store: JobStore, add_job: AddJob
) -> None:
    job = add_job(subject="W-1")
    add_job(b"another", subject="W-2")

    _, told = run(settings, "trail", "show", "--subject", "W-1", "--form", "jsonl")

    lines = [json.loads(line) for line in told.splitlines()]
    assert [line["act"] for line in lines] == ["analysis.asked", "recording.stored"]
    assert {line["recording_id"] for line in lines} == {job.recording_id}


def test_terms_and_holds_are_changed_by_command(settings: Settings, store: JobStore, add_job: AddJob) -> None:
    recording_id = add_job().recording_id

    assert "Lines of the audit log: kept for good" in run(settings, "retention")[1]
    assert "Lines of the audit log: 400 days" in run(settings, "retention", "trail", "400")[1]
    assert "Lines of the audit log: kept for good" in run(settings, "retention", "trail", "never")[1]
    assert run(settings, "hold", "begin", recording_id)[0] == 0
    assert run(settings, "hold", "end", recording_id)[0] == 0

    lines = find_lines(store.reader, AuditQuestion(who="machine"))
    assert [line.act for line in lines][:2] == ["recording.let_go", "recording.held"]


def test_backup_verify_and_restore_leave_a_line(
    settings: Settings, store: JobStore, add_job: AddJob, tmp_path: Path
) -> None:
    add_job()
    store.close()
    run(settings, "verify")
    run(settings, "backup", str(tmp_path / "copy.zip"))
    there = Settings(data_dir=tmp_path / "there")

    run(there, "restore", str(tmp_path / "copy.zip"))

    restored = JobStore(there)
    lines = [(line.who, line.act) for line in find_lines(restored.reader, AuditQuestion(who="machine"))]
    restored.close()
    assert lines == [
        ("machine", "store.restored"),
        ("machine", "store.backed_up"),
        ("machine", "store.verified"),
    ]


@pytest.mark.parametrize("moment", ["0001-01-01T00:00:00+14:00", "9999-12-31T23:59:59-14:00"])
def test_a_moment_beyond_the_calendar_is_refused(settings: Settings, store: JobStore, moment: str) -> None:
    code, told = run(settings, "trail", "show", "--from", moment)

    assert code != 0
    assert "E-PARAMETER" in told


@pytest.mark.parametrize("words", [("account", "add", "dora", "--role", "manager"), ("--help",)])
def test_a_command_whose_output_nobody_reads_any_more_does_its_work_and_says_nothing(
    settings: Settings, accounts: AccountStore, store: JobStore, words: tuple[str, ...]
) -> None:
    accounts.add_person("boss", "Boss", ["manager"])

    done = run_unread(settings, *words)

    assert (done.returncode, done.stderr) == (141, b"")
    assert ("dora" in words) == (accounts.find_person("dora") is not None)


def run_unread(settings: Settings, *words: str) -> "subprocess.CompletedProcess[bytes]":
    """Run a command in a process of its own, into a pipe whose reader has left."""
    read_end, write_end = os.pipe()
    os.close(read_end)
    typed, told = [sys.executable, "-m", "app", *words], os.environ | settings.as_environment()
    with os.fdopen(write_end) as pipe:
        return subprocess.run(typed, stdout=pipe, stderr=subprocess.PIPE, env=told, check=False)


def test_a_broken_byte_in_a_question_is_a_usage_error() -> None:
    result = CliRunner().invoke(app, ["trail", "show", "--who", "\udcff"])

    assert result.exit_code == 2
    assert "--who" in result.output
