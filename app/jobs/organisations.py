"""Which organisations have a place of their own: folders beside the data, or schemas of the database."""

from sqlalchemy import Engine, text

from app.organisation import PREFIX
from app.settings import Settings

_SCHEMAS = text("SELECT nspname FROM pg_namespace WHERE starts_with(nspname, 'org_')")


def find_organisations(settings: Settings, reader: Engine) -> tuple[str, ...]:
    """Give every organisation but "own"; ``reader`` reads the database of "own"."""
    if reader.dialect.name == "sqlite":
        return find_folders(settings)
    with reader.connect() as connection:
        return tuple(sorted(connection.execute(_SCHEMAS).scalars()))


def find_folders(settings: Settings) -> tuple[str, ...]:
    """Give every organisation that has a folder with a database in it."""
    files = (settings.data_dir / "organisations").glob(f"{PREFIX}*/acromion.sqlite3")
    return tuple(sorted(path.parent.name for path in files))
