"""Changes of the tables, one file each; see ``docs/decisions/0018-two-databases.md``.

This package imports Alembic: the server loads it only if there is something to migrate.
"""

from pathlib import Path

from alembic import command
from alembic.config import Config
from alembic.script import ScriptDirectory
from sqlalchemy import Connection

from acromion.app.errors import WrongSchema
from acromion.app.library.database.tables import REVISION


def upgrade(connection: Connection, found: str) -> None:
    """Run the missing migrations in the transaction of the connection, all or none.

    Raises WrongSchema, without any change, if our migrations do not include the revision.
    """
    config = configure(connection)
    if found not in {script.revision for script in ScriptDirectory.from_config(config).walk_revisions()}:
        raise WrongSchema(found=found, needed=REVISION)
    command.upgrade(config, "head")


def configure(connection: Connection) -> Config:
    """Return an Alembic configuration with our migrations and a connection."""
    config = Config()
    config.set_main_option("script_location", str(Path(__file__).parent))
    config.attributes["connection"] = connection
    return config
