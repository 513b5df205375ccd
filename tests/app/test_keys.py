"""The keys of recordings, in a folder and in a table of PostgreSQL."""

import stat
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from sqlalchemy import inspect, text

from app.errors import KeyFileMissing, KeyGone, KeyMismatch
from app.jobs.database.connect import connect, open_database
from app.jobs.database.dump import reflect_tables
from app.settings import Settings
from app.storage.erasures import Erasure, FolderLedger, is_chained
from app.storage.keys import KeyStore, OrganisationKey, open_keys
from app.storage.store import BrokenSeal

CANARY = b"a canary of thirty-two bytes, so"


@pytest.fixture
def objects() -> str:
    """Keys never lie in a bucket."""
    return ""


@pytest.fixture(params=["sqlite", "postgresql"])
def database(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[str]:
    if request.param == "sqlite":
        yield f"sqlite:///{tmp_path / 'data' / 'acromion.sqlite3'}"
    else:
        server = request.getfixturevalue("postgres")
        server.empty()
        yield server.url


@pytest.fixture
def keys(settings: Settings) -> KeyStore:
    return open_keys(settings)


def test_a_key_opens_what_it_sealed(keys: KeyStore) -> None:
    sealed = keys.create("rec_1").seal(CANARY, "side file")
    assert CANARY not in sealed
    assert keys.get("rec_1").open(sealed, "side file") == CANARY


def test_a_key_is_found_by_another_process(keys: KeyStore, settings: Settings) -> None:
    sealed = keys.create("rec_1").seal(CANARY, "note")
    assert open_keys(settings).get("rec_1").open(sealed, "note") == CANARY


def test_a_destroyed_key_opens_nothing(keys: KeyStore, settings: Settings) -> None:
    sealed = keys.create("rec_1").seal(CANARY, "note")
    keys.destroy("rec_1")
    with pytest.raises(KeyGone):
        keys.get("rec_1")
    assert open_keys(settings).find("rec_1") is None
    with pytest.raises(BrokenSeal):
        keys.create("rec_1").open(sealed, "note")


def test_the_bytes_of_a_destroyed_key_are_nowhere_in_the_folder(keys: KeyStore, settings: Settings) -> None:
    keys.create("rec_1")
    wrapped = dict(keys.export())["rec_1"]
    keys.destroy("rec_1")
    for path in settings.data_dir.rglob("*"):
        assert path.is_dir() or wrapped not in path.read_bytes()


def test_destroying_one_key_leaves_the_others(keys: KeyStore) -> None:
    sealed = keys.create("rec_2").seal(CANARY, "note")
    keys.create("rec_1")
    keys.destroy("rec_1", "rec_of_nobody")
    assert keys.get("rec_2").open(sealed, "note") == CANARY


def test_a_recording_keeps_its_first_key(keys: KeyStore) -> None:
    first = keys.create("rec_1")
    assert keys.create("rec_1").secret == first.secret
    assert keys.keep(keys.new("rec_1")).secret == first.secret


@pytest.mark.parametrize("other", ["subject", "note "])
def test_what_was_sealed_about_one_thing_does_not_open_as_another(keys: KeyStore, other: str) -> None:
    key = keys.create("rec_1")
    with pytest.raises(BrokenSeal):
        key.open(key.seal(CANARY, "note"), other)


def test_one_altered_byte_breaks_a_seal(keys: KeyStore) -> None:
    key = keys.create("rec_1")
    sealed = key.seal(CANARY, "note")
    for place in range(len(sealed)):
        altered = sealed[:place] + bytes([sealed[place] ^ 1]) + sealed[place + 1 :]
        with pytest.raises(BrokenSeal):
            key.open(altered, "note")


def test_a_wrapped_key_is_of_no_use_to_another_recording(keys: KeyStore) -> None:
    keys.create("rec_1")
    keys.wrapped.add("rec_2", dict(keys.export())["rec_1"])
    assert keys.find("rec_2") is None


def test_exported_keys_hold_no_key_in_the_clear(keys: KeyStore) -> None:
    secret = keys.create("rec_1").secret
    assert secret not in b"".join(wrapped for _, wrapped in keys.export())


def test_imported_keys_open_what_they_sealed_elsewhere(keys: KeyStore, tmp_path: Path) -> None:
    sealed = keys.create("rec_1").seal(CANARY, "note")
    elsewhere = open_keys(Settings(data_dir=tmp_path / "elsewhere"))
    assert elsewhere.import_wrapped(dict(keys.export()), keys.organisation) == 1
    assert elsewhere.get("rec_1").open(sealed, "note") == CANARY
    assert elsewhere.import_wrapped(dict(keys.export()), keys.organisation) == 0


def test_keys_of_an_unknown_organisation_are_not_imported(keys: KeyStore, tmp_path: Path) -> None:
    keys.create("rec_1")
    elsewhere = open_keys(Settings(data_dir=tmp_path / "elsewhere"))
    with pytest.raises(BrokenSeal):
        elsewhere.import_wrapped(dict(keys.export()))
    assert dict(elsewhere.export()) == {}


def test_all_keys_are_found_at_once(keys: KeyStore) -> None:
    made = {name: keys.create(name).secret for name in ("rec_1", "rec_2")}
    assert {name: key.secret for name, key in keys.find_all().items()} == made


def test_only_we_can_read_keys(keys: KeyStore, settings: Settings) -> None:
    keys.create("rec_1")
    files = [settings.data_dir / "organisation.key", *(settings.data_dir / "keys").glob("*")]
    assert {stat.S_IMODE(path.stat().st_mode) for path in files} == {0o600}


def test_no_new_key_takes_the_place_of_a_lost_one(keys: KeyStore, settings: Settings) -> None:
    keys.create("rec_1")
    (settings.data_dir / "organisation.key").unlink()
    with pytest.raises(KeyFileMissing):
        open_keys(settings).find("rec_1")
    assert not (settings.data_dir / "organisation.key").exists()


def test_another_organisations_key_is_refused(keys: KeyStore, settings: Settings) -> None:
    keys.create("rec_1")
    other = OrganisationKey(bytes(32))
    (settings.data_dir / "organisation.key").write_text(other.write_text())
    with pytest.raises(KeyMismatch):
        open_keys(settings).create("rec_2")


def test_a_file_that_is_no_key_is_refused(settings: Settings) -> None:
    settings.data_dir.mkdir()
    (settings.data_dir / "organisation.key").write_text("not a key")
    with pytest.raises(KeyFileMissing):
        open_keys(settings).create("rec_1")


def test_a_named_key_file_must_exist(settings: Settings, tmp_path: Path) -> None:
    named = settings.model_copy(update={"key_file": tmp_path / "k"})
    with pytest.raises(KeyFileMissing):
        open_keys(named).create("rec_1")
    (tmp_path / "k").write_text(OrganisationKey(bytes(range(32))).write_text())
    open_keys(named).create("rec_1")
    assert not (settings.data_dir / "organisation.key").exists()


def test_what_a_key_prints_is_no_secret(keys: KeyStore) -> None:
    key = keys.create("rec_1")
    for shown in (repr(key), repr(keys), repr(keys.organisation)):
        assert repr(key.secret) not in shown
        assert repr(keys.organisation.secret) not in shown


# --- the ledger of erasures -----------------------------------------------------------------------------


def test_an_erasure_is_entered_once_with_its_time_and_nothing_else(keys: KeyStore) -> None:
    keys.create("rec_1")
    keys.erase("rec_1", "rec_2")
    keys.erase("rec_1")

    entries = keys.ledger.read()
    assert [entry.id for entry in entries] == ["rec_1", "rec_2"]
    assert {entry.at[:2] for entry in entries} == {"20"}
    assert keys.find("rec_1") is None
    assert keys.find_erased() == {"rec_1", "rec_2"}


@pytest.mark.parametrize(
    ("alter", "whole"),
    [
        (lambda entries: entries, True),
        (lambda entries: entries[1:], False),
        (lambda entries: (entries[0], entries[2]), False),
        (lambda entries: (entries[0], replace(entries[1], id="rec_9"), entries[2]), False),
        (lambda entries: (entries[1], entries[0], entries[2]), False),
    ],
    ids=["as written", "first out", "one out", "altered", "exchanged"],
)
def test_an_entry_that_is_altered_or_taken_out_is_noticed(
    keys: KeyStore, alter: Callable[[tuple[Erasure, ...]], tuple[Erasure, ...]], whole: bool
) -> None:
    for name in ("rec_1", "rec_2", "rec_3"):
        keys.erase(name)

    assert is_chained(alter(keys.ledger.read())) is whole


def test_a_line_that_a_power_cut_has_torn_does_not_spoil_the_next(tmp_path: Path) -> None:
    ledger = FolderLedger(tmp_path / "erasures.jsonl")
    ledger.append(("rec_1",))
    with ledger.path.open("ab") as file:
        file.write(b'{"id": "rec_')

    ledger.append(("rec_2",))

    assert [entry.id for entry in ledger.read()] == ["rec_1", "rec_2"]
    assert is_chained(ledger.read())


class TestTable:
    """Of PostgreSQL only."""

    @pytest.fixture
    def database(self, request: pytest.FixtureRequest) -> str:
        server = request.getfixturevalue("postgres")
        server.empty()
        return str(server.url)

    def test_no_copy_of_our_tables_holds_keys(self, keys: KeyStore, database: str) -> None:
        keys.create("rec_1")
        engine = open_database(database)
        with engine.connect() as connection:
            assert "recording_keys" in inspect(connection).get_table_names()
            assert "recording_keys" not in {table.name for table in reflect_tables(connection)}
        engine.dispose()

    def test_a_deleted_row_is_not_left_in_the_table(self, keys: KeyStore, database: str) -> None:
        keys.create("rec_1")
        keys.create("rec_2")
        keys.destroy("rec_1")
        engine = connect(database)
        with engine.connect() as connection:
            pages = "SELECT pg_relation_size('recording_keys') / 8192"
            assert connection.execute(text(pages)).scalar_one() == 1
            one = dict(keys.export())
            raw = connection.execute(
                text("SELECT pg_read_binary_file(pg_relation_filepath('recording_keys'))")
            ).scalar_one()
        engine.dispose()
        assert set(one) == {"rec_2"}
        assert b"rec_1" not in bytes(raw)
