"""The audit log, terms, holds and accounts by command."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from acromion.app.accounts.accounts import AccountStore, Person
from acromion.app.accounts.sign_in import Caller, SignIn
from acromion.app.cli import app
from acromion.app.library.audit_log import AuditFilter, find_lines
from acromion.app.library.jobs import JobStore
from acromion.app.settings import Settings
from tests.app.accounts.conftest import AddPerson
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


def test_without_a_term_of_its_own_the_trash_shows_the_days_of_the_settings(
    settings: Settings, store: JobStore
) -> None:
    for days in ((), ("trash", "never")):
        told = run(settings, "retention", *days)[1]

        assert "Recordings in the trash: 30 days, as set on the server" in told


def test_terms_and_holds_are_changed_by_command(settings: Settings, store: JobStore, add_job: AddJob) -> None:
    recording_id = add_job().recording_id

    assert "Entries of the audit log: kept without limit" in run(settings, "retention")[1]
    assert "Recordings in the trash: 30 days" in run(settings, "retention")[1]
    assert "Entries of the audit log: 400 days" in run(settings, "retention", "trail", "400")[1]
    assert "Entries of the audit log: kept without limit" in run(settings, "retention", "trail", "never")[1]
    assert run(settings, "hold", "begin", recording_id)[0] == 0
    assert run(settings, "hold", "end", recording_id)[0] == 0

    lines = find_lines(store.reader, AuditFilter(who="machine"))
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
    lines = [(line.who, line.act) for line in find_lines(restored.reader, AuditFilter(who="machine"))]
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
    typed, told = [sys.executable, "-m", "acromion", *words], os.environ | settings.as_environment()
    with os.fdopen(write_end) as pipe:
        return subprocess.run(typed, stdout=pipe, stderr=subprocess.PIPE, env=told, check=False)


def test_a_broken_byte_in_a_question_is_a_usage_error() -> None:
    result = CliRunner().invoke(app, ["trail", "show", "--who", "\udcff"])

    assert result.exit_code == 2
    assert "--who" in result.output


# ``acromion account``: first manager, forgotten passwords and tokens.


HERE = Caller("192.0.2.1", "")


def run_account(data: Path, *arguments: str, typed: str = "") -> tuple[int, str]:
    result = CliRunner().invoke(app, ["account", *arguments, "--data", str(data)], input=typed)
    return result.exit_code, result.output


@pytest.fixture
def data(tmp_path: Path) -> Path:
    return tmp_path / "data"


def test_the_first_manager_gets_an_address_that_works_once(data: Path, sign_in: SignIn) -> None:
    code, told = run_account(data, "add", "boss", "--role", "manager")
    link = re.search(r"/login/link/([\w-]+)", told)
    assert link is not None

    person = sign_in.set_password_by_link(link[1], "five yellow umbrellas", "192.0.2.1")

    assert (code, person.login) == (0, "boss")
    assert person.roles == {"manager"}


def test_a_password_may_be_typed_instead(data: Path, sign_in: SignIn) -> None:
    code, _ = run_account(
        data, "add", "boss", "--role", "manager", "--password", typed="five yellow umbrellas\n"
    )

    assert code == 0
    assert sign_in.submit_password("boss", "five yellow umbrellas", HERE).next == "enrol"


def test_a_token_made_by_command_asks_for_its_person(
    person: Person, data: Path, accounts: AccountStore
) -> None:
    _, told = run_account(data, "token", "clara", "--name", "nightly", "--may", "read")

    subject = accounts.find_by_token(told.splitlines()[0])
    assert subject is not None
    assert subject.permissions == {"own", "read"}


def test_the_list_tells_who_may_log_in(
    person: Person, data: Path, add_person: AddPerson, accounts: AccountStore
) -> None:
    accounts.end_person(add_person("dora").id)

    _, told = run_account(data, "list")

    assert re.search(r"clara .* can sign in", told)
    assert re.search(r"dora .* cannot sign in", told)


@pytest.mark.parametrize(
    ("words", "typed", "told"),
    [
        (("add", "boss", "--role", "manager", "--password"), "short\n", "E-PASSWORD"),
        (("token", "clara", "--name", "nightly", "--may", "erase"), "", "E-PERMISSION"),
        (("end", "nobody"), "", "E-NOT-FOUND"),
        *(
            (("add", "dora", "--role", "clinician", "--name", name), "", "E-PARAMETER")
            for name in (" ", "x" * 201, "Dora\nManager")
        ),
    ],
)
def test_what_cannot_be_is_refused_by_its_code(
    data: Path, accounts: AccountStore, add_person: AddPerson, words: tuple[str, ...], typed: str, told: str
) -> None:
    add_person("clara", "assistant")

    code, output = run_account(data, *words, typed=typed)

    assert (code, told in output) == (3, True)
    assert "dora" not in {person.login for person in accounts.find_people()}


def test_roles_second_factor_and_end_are_changed_by_command(
    person: Person, data: Path, accounts: AccountStore
) -> None:
    run_account(data, "roles", "clara", "--role", "auditor", "--role", "manager")
    run_account(data, "reset", "clara", "--second-factor")
    changed = accounts.get_person(person.id)
    session = accounts.begin_session(person.id)
    run_account(data, "end", "clara")

    assert changed.roles == {"auditor", "manager"}
    assert not changed.has_second_factor
    assert accounts.find_by_session(session) is None
