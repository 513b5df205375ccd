"""Old tables become new ones, with a copy made before; tables of a later release are left alone."""

import time
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory
from fastapi.testclient import TestClient
from sqlalchemy import Engine, inspect, text

from app.errors import DatabaseTooNew, DatabaseTooOld
from app.jobs.batches import BatchStore
from app.jobs.database.connect import connect, open_database, read_revision
from app.jobs.database.dump import read_rows
from app.jobs.database.migrate import configure, migrate, upgrade
from app.jobs.database.seal_rows import drop_open_copies, seal_row
from app.jobs.database.tables import REVISION, metadata
from app.jobs.store import JobStore
from app.main import create_app
from app.request import ReportRequest
from app.settings import Settings
from app.storage.keys import open_keys
from app.storage.labels import LabelSealer

pytestmark = pytest.mark.parametrize("database", ["sqlite", "postgresql"], indirect=True)


@pytest.fixture
def engine(database: str) -> Iterator[Engine]:
    opened = connect(database)
    yield opened
    opened.dispose()


def set_revision(engine: Engine, revision: str) -> None:
    with engine.begin() as connection:
        connection.execute(text("UPDATE alembic_version SET version_num = :found"), {"found": revision})


def test_the_migrations_end_with_the_tables_of_the_code(engine: Engine) -> None:
    with engine.begin() as connection:
        upgrade(connection)

        assert compare_metadata(MigrationContext.configure(connection), metadata) == []
        assert read_revision(connection) == REVISION


def test_the_last_migration_is_the_one_the_code_asks_for(engine: Engine) -> None:
    with engine.connect() as connection:
        assert ScriptDirectory.from_config(configure(connection)).get_current_head() == REVISION


def test_a_new_database_gets_its_tables_and_its_revision(engine: Engine, database: str) -> None:
    open_database(database).dispose()

    with engine.connect() as connection:
        assert read_revision(connection) == REVISION
        assert set(metadata.tables) <= set(inspect(connection).get_table_names())


def test_a_later_release_s_database_is_refused(engine: Engine, database: str, settings: Settings) -> None:
    open_database(database).dispose()
    set_revision(engine, "9999")

    assert migrate(settings) is None
    with pytest.raises(DatabaseTooNew) as refusal:
        open_database(database)

    assert refusal.value.facts == {"found": "9999", "needed": REVISION}


def test_an_earlier_release_s_database_is_not_touched_by_a_worker(engine: Engine, database: str) -> None:
    open_database(database).dispose()
    set_revision(engine, "0000")

    with pytest.raises(DatabaseTooOld):
        open_database(database)


def make_earlier(engine: Engine) -> None:
    """Make the tables of the first release, with one recording that waits for its analysis."""
    with engine.begin() as connection:
        upgrade(connection, "0001")
        connection.execute(
            text(
                "INSERT INTO recordings (id, sha256, size_bytes, file_name, state, created_at)"
                " VALUES ('rec_1', 'aa', 9, 'Équipe.gt3x', 'stored', '2026-03-02T07:00:00+00:00')"
            )
        )
        connection.execute(
            text(
                "INSERT INTO analyses (id, recording_id, request, way_in, state, progress, attempts, beats,"
                " created_at) VALUES ('an_1', 'rec_1', :asked, 'api', 'queued', 0, 0, 0,"
                " '2026-03-02T07:00:00+00:00')"
            ),
            {"asked": ReportRequest("Équipe.gt3x").to_json()},
        )


def test_an_earlier_release_s_rows_are_copied_and_kept(engine: Engine, settings: Settings) -> None:
    make_earlier(engine)

    copy = migrate(settings)

    store = JobStore(settings)
    assert store.get("an_1").file_name == "Équipe.gt3x"
    store.close()
    assert open_words(copy, settings) == ["Équipe.gt3x"]


def open_words(copy: Path | None, settings: Settings) -> list[str]:
    """Open the names of recordings in a copy of rows; "gone" where the key is destroyed."""
    assert copy is not None
    with zipfile.ZipFile(copy) as archive:
        rows = list(read_rows(archive, "recordings"))
    return [LabelSealer(open_keys(settings)).open(row["file_name"], gone="gone") for row in rows]


def test_the_copy_of_the_rows_holds_no_word_in_clear(engine: Engine, settings: Settings) -> None:
    make_earlier(engine)
    with engine.begin() as connection:
        upgrade(connection, "0009")
        connection.exec_driver_sql(
            "INSERT INTO webhooks (id, url, events, secret, created_at)"
            " VALUES ('wh_1', 'https://quipe', '[]', 'quipe', '2026')"
        )

    copy = migrate(settings)

    assert copy is not None
    with zipfile.ZipFile(copy) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    assert len(members["rows/webhooks.jsonl"]) > 0
    assert [name for name, content in members.items() if b"quipe" in content] == []


def test_an_erasure_reaches_the_copy_of_the_rows(engine: Engine, settings: Settings) -> None:
    make_earlier(engine)
    copy = migrate(settings)

    open_keys(settings).erase("rec_1")

    assert open_words(copy, settings) == ["gone"]


def test_a_kept_answer_is_sealed_in_the_copy_once(engine: Engine, settings: Settings) -> None:
    sealer = LabelSealer(open_keys(settings))
    row = {"key": "k", "headers": "[]", "body": b"the subject W-17"}

    once = seal_row(sealer, "kept_answers", row)

    assert b"W-17" not in once["body"]
    assert sealer.open_bytes(once["body"]) == b"the subject W-17"
    assert seal_row(sealer, "kept_answers", once) == once


def test_a_copy_that_a_crash_has_cut_short_is_removed(settings: Settings, engine: Engine) -> None:
    folder = settings.data_dir / "backups"
    folder.mkdir(parents=True)
    (folder / "rows-before-0009-1.zip").write_bytes(b"PK\x03\x04 and no end")

    assert drop_open_copies(folder) == ("rows-before-0009-1.zip",)
    assert list(folder.iterdir()) == []


def test_the_server_removes_a_copy_in_clear_once_all_is_sealed(settings: Settings, engine: Engine) -> None:
    copy = settings.data_dir / "backups" / "rows-before-0009-1.zip"
    copy.parent.mkdir(parents=True)
    with zipfile.ZipFile(copy, "w") as archive:
        archive.writestr("rows/recordings.jsonl", '{"id": "rec_1", "file_name": "Équipe.gt3x"}\n')

    with TestClient(create_app(settings)):
        for _ in range(200):
            if not copy.exists():
                break
            time.sleep(0.05)

    assert not copy.exists()


def test_a_copy_that_an_earlier_release_left_in_clear_is_removed_and_no_other(
    engine: Engine, settings: Settings
) -> None:
    make_earlier(engine)
    copy = migrate(settings)
    assert copy is not None
    with zipfile.ZipFile(copy.with_name("rows-before-0009-1.zip"), "w") as archive:
        archive.writestr("rows/recordings.jsonl", '{"id": "rec_1", "file_name": "Équipe.gt3x"}\n')

    assert drop_open_copies(copy.parent) == ("rows-before-0009-1.zip",)

    assert [path.name for path in copy.parent.iterdir()] == [copy.name]


def test_the_batches_of_an_earlier_release_hold_what_they_asked_for(
    engine: Engine, database: str, tmp_path: Path
) -> None:
    asked = ReportRequest("a.gt3x").to_json()
    common = f"'rec_1', '{asked}', 'api', 'queued', 0, 0, 0"
    columns = "id, recording_id, request, way_in, state, progress, attempts, beats, created_at, batch_id"
    make_earlier(engine)
    with engine.begin() as connection:
        upgrade(connection, "0003")
        connection.exec_driver_sql("INSERT INTO batches VALUES ('ba_1', 'spring', 2, '2026')")
        for name, moment in (("an_b", "2026-02"), ("an_a", "2026-03")):
            row = f"'{name}', {common}, '{moment}-02T07:00:00+00:00', 'ba_1'"
            connection.exec_driver_sql(f"INSERT INTO analyses ({columns}) VALUES ({row})")
        upgrade(connection)

    store = JobStore(Settings(data_dir=tmp_path, database_url=database))
    batches = BatchStore(store.engine, store.reader)
    assert [job.id for job in batches.find_jobs("ba_1")] == ["an_b", "an_a"]
    assert (batches.get("ba_1").item_count, batches.get("ba_1").duplicate_count) == (2, 0)
    store.close()


def test_a_webhook_keeps_its_secret(engine: Engine) -> None:
    with engine.begin() as connection:
        upgrade(connection, "0009")
        connection.exec_driver_sql(
            "INSERT INTO webhooks (id, url, events, secret, created_at)"
            " VALUES ('wh_1', 'https://a.example', '[]', 'whsec_aa', '2026')"
        )
        connection.exec_driver_sql(
            "INSERT INTO deliveries VALUES ('msg_1', 'wh_1', 'batch.finished', '{}', 0, 0)"
        )
        upgrade(connection)

        assert connection.exec_driver_sql("SELECT url, secret FROM webhooks").one() == (
            "https://a.example",
            "whsec_aa",
        )
        assert connection.exec_driver_sql("SELECT webhook_id FROM deliveries").scalar() == "wh_1"


def test_a_migration_that_fails_leaves_the_tables_as_they_were(engine: Engine) -> None:
    make_earlier(engine)

    with engine.connect() as connection, connection.begin() as change:
        upgrade(connection)
        change.rollback()

    with engine.connect() as connection:
        assert not inspect(connection).has_table("uploads")
