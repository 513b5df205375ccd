"""Secrets of authenticators: a dump of the accounts shows none, and they open with server.key alone."""

import json
from pathlib import Path

import pytest
from sqlalchemy import select, update

from acromion.app.accounts.accounts import AccountStore, Person
from acromion.app.accounts.sign_in import Caller, SignIn
from acromion.app.errors import SecondFactorLost, SecretUnreadable
from acromion.app.library.database.tables import people, tickets
from acromion.app.library.jobs import JobStore
from acromion.app.library.webhooks import WebhookStore
from acromion.app.main import create_app
from acromion.app.settings import Settings
from acromion.app.store.server_secret import LENGTH_BYTES, ServerSecret
from tests.app.accounts.conftest import PASSWORD, SECRET, AddPerson, Clock, Visit, make_code, read_ticket

HERE = Caller("192.0.2.1", "")


def dump(accounts: AccountStore) -> str:
    """Return every row of every table of the accounts, as bytes are."""
    found = []
    for table in (people, tickets):
        found += [
            bytes(value).decode() if isinstance(value, bytes | memoryview) else str(value)
            for row in accounts.database.read_all(table.select())
            for value in row
        ]
    return "\n".join(found)


def log_in(sign_in: SignIn, clock: Clock) -> str:
    step = sign_in.submit_password("clara", PASSWORD, HERE)
    return sign_in.submit_code(step.ticket, make_code(clock), HERE).session


def test_no_secret_of_an_authenticator_stands_open_in_the_accounts(
    person: Person, accounts: AccountStore, sign_in: SignIn, clock: Clock
) -> None:
    assert SECRET not in dump(accounts)
    assert log_in(sign_in, clock)


def test_a_secret_that_is_being_set_up_does_not_either(
    accounts: AccountStore, sign_in: SignIn, add_person: AddPerson
) -> None:
    ticket = sign_in.begin_enrolment(add_person().id)

    shown, _ = sign_in.show_enrolment(ticket)

    assert len(shown) == 32
    assert shown not in dump(accounts)
    assert json.loads(accounts.database.read_value(select(tickets.c.told)))["secret"].startswith("gAAAA")


def test_without_the_key_no_code_is_compared_and_the_log_names_the_cure(
    person: Person, settings: Settings, sign_in: SignIn, clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    ServerSecret(settings.data_dir).file.unlink()

    with pytest.raises(SecondFactorLost):
        log_in(sign_in, clock)

    assert f"the second factor of {person.id} cannot be read" in caplog.text
    assert "--second-factor" in caplog.text


def test_without_the_key_the_page_says_that_the_second_step_cannot_be_read(
    person: Person, settings: Settings, visit: Visit
) -> None:
    visitor = visit()
    ticket = read_ticket(visitor.submit_password("clara"))
    ServerSecret(settings.data_dir).file.unlink()

    page = visitor.post("/login/code", ticket=ticket, code="123456", next="/")

    assert page.status_code == 503
    assert "E-SECOND-FACTOR" in page.text
    assert "server.key" in page.text


def test_a_code_that_cannot_be_compared_is_no_guess_and_a_recovery_code_lets_in(
    settings: Settings, sign_in: SignIn, add_person: AddPerson, clock: Clock
) -> None:
    sign_in.credentials.set_second_factor(add_person().id, SECRET, 0, ["aaaa-bbbb"])
    ServerSecret(settings.data_dir).file.unlink()
    step = sign_in.submit_password("clara", PASSWORD, HERE)
    for _ in range(20):
        with pytest.raises(SecondFactorLost):
            sign_in.submit_code(step.ticket, make_code(clock), HERE)

    assert sign_in.submit_code(step.ticket, "aaaa-bbbb", HERE).session


def test_a_secret_does_not_open_as_another_persons(
    accounts: AccountStore, sign_in: SignIn, add_person: AddPerson, clock: Clock
) -> None:
    clara, dora = add_person("clara"), add_person("dora")
    hers = select(people.c.totp_secret).where(people.c.id == dora.id).scalar_subquery()
    with accounts.database.write() as connection:
        connection.execute(update(people).where(people.c.id == clara.id).values(totp_secret=hers))

    with pytest.raises(SecondFactorLost):
        log_in(sign_in, clock)


def test_a_start_warns_of_a_lost_key_and_names_the_cure(
    person: Person, settings: Settings, store: JobStore, caplog: pytest.LogCaptureFixture
) -> None:
    secret = ServerSecret(settings.data_dir)
    WebhookStore(store.engine, store.reader).add("https://a.example", ("batch.finished",), secret)
    create_app(settings)
    is_quiet_with_its_key = "E-SECRET" not in caplog.text
    secret.file.unlink()

    create_app(settings)

    assert is_quiet_with_its_key
    assert f"E-SECRET The server key is missing or wrong. {secret.file}" in caplog.text
    assert "Second factors: 1; webhooks: 1. Restore server.key from a backup" in caplog.text


def test_the_warning_comes_again_with_a_key_that_a_login_has_made(
    person: Person, settings: Settings, sign_in: SignIn, caplog: pytest.LogCaptureFixture
) -> None:
    ServerSecret(settings.data_dir).file.unlink()
    sign_in.submit_password("clara", PASSWORD, HERE)

    create_app(settings)

    assert ServerSecret(settings.data_dir).file.exists()
    assert "E-SECRET" in caplog.text


# The secret of a server: what it encrypted is read with it alone, and a lost one costs nothing else.


def test_what_was_encrypted_is_read_again_for_its_own_purpose_alone(tmp_path: Path) -> None:
    token = ServerSecret(tmp_path).encrypt("whsec_é", "webhook")
    again = ServerSecret(tmp_path)

    assert "whsec" not in token
    assert again.decrypt(token, "webhook") == "whsec_é"
    with pytest.raises(SecretUnreadable):
        again.decrypt(token, "second factor of clara")
    assert again.derive("logins") == again.derive("logins") != again.derive("others")


def test_only_its_user_reads_the_file(tmp_path: Path) -> None:
    ServerSecret(tmp_path / "data").encrypt("a", "b")

    file = tmp_path / "data" / "server.key"
    assert (file.stat().st_mode & 0o777, file.parent.stat().st_mode & 0o777) == (0o600, 0o700)
    assert file.stat().st_size == LENGTH_BYTES
    assert list(file.parent.iterdir()) == [file]


@pytest.mark.parametrize("content", [None, b"", b"garbage", b"x" * 45])
def test_a_lost_or_damaged_file_is_named_and_made_anew_for_what_comes(
    tmp_path: Path, content: bytes | None
) -> None:
    secret = ServerSecret(tmp_path)
    token = secret.encrypt("a", "webhook")
    secret.file.unlink() if content is None else secret.file.write_bytes(content)

    with pytest.raises(SecretUnreadable) as refused:
        secret.decrypt(token, "webhook")
    assert refused.value.facts == {"file": str(tmp_path / "server.key")}

    assert secret.decrypt(secret.encrypt("b", "webhook"), "webhook") == "b"
