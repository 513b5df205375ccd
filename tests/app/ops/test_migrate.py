"""A new database gets its tables; tables of another version are refused by name and left as they are."""

from collections.abc import Iterator

import pytest
from alembic import command
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import Engine, inspect, text

from acromion.app.errors import WrongSchema
from acromion.app.library import migrations
from acromion.app.library.database.connect import bring_up_to_date, connect, open_database, read_revision
from acromion.app.library.database.tables import REVISION, metadata
from acromion.app.settings import Settings

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
        command.upgrade(migrations.configure(connection), "head")

        assert compare_metadata(MigrationContext.configure(connection), metadata) == []
        assert read_revision(connection) == REVISION


def test_the_last_migration_is_the_one_the_code_asks_for(engine: Engine) -> None:
    with engine.connect() as connection:
        script = ScriptDirectory.from_config(migrations.configure(connection))
        assert script.get_current_head() == REVISION


def test_a_new_database_gets_its_tables_and_its_revision(engine: Engine, database: str) -> None:
    open_database(database).dispose()

    with engine.connect() as connection:
        assert read_revision(connection) == REVISION
        assert set(metadata.tables) <= set(inspect(connection).get_table_names())


@pytest.mark.parametrize("found", ["0012", "b9"])
def test_a_database_of_another_version_is_refused_and_left_as_it_is(
    engine: Engine, database: str, settings: Settings, found: str
) -> None:
    open_database(database).dispose()
    set_revision(engine, found)

    with pytest.raises(WrongSchema) as of_the_server:
        bring_up_to_date(settings)
    with pytest.raises(WrongSchema):
        open_database(database)

    assert of_the_server.value.facts == {"found": found, "needed": REVISION}
    with engine.connect() as connection:
        assert read_revision(connection) == found


def test_tables_without_a_revision_are_refused(engine: Engine, database: str) -> None:
    open_database(database).dispose()
    with engine.begin() as connection:
        connection.execute(text("DROP TABLE alembic_version"))

    with pytest.raises(WrongSchema):
        open_database(database)
