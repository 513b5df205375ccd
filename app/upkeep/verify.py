"""Compare every file with what its row says, and find those of which no row speaks."""

from collections.abc import Iterator

from sqlalchemy import Connection, Table, select

from app.jobs.database import READ_ONLY, connect
from app.jobs.job import JobState
from app.jobs.tables import analyses, recordings, result_files
from app.settings import Settings
from app.storage import Storage, hash_file
from app.stores import open_storage
from app.upkeep.files import Fault, KeptFile, list_files


def list_kept(settings: Settings) -> tuple[KeptFile, ...]:
    """Give every file that the rows promise just now."""
    engine = connect(settings.database_url).execution_options(**READ_ONLY)
    try:
        with engine.connect() as connection:
            tables = (recordings, analyses, result_files)
            return tuple(list_files(*(_read(connection, table) for table in tables)))
    finally:
        engine.dispose()


def find_faults(settings: Settings, files: tuple[KeptFile, ...]) -> Iterator[Fault]:
    """Read every file and compare it with its row, and name the files without one.

    The server may run meanwhile: a file whose row went is no fault, nor is one whose row came, or that an
    attempt under way is making.
    """
    storage = open_storage(settings)
    storage.prepare()
    strangers = set(storage.list_names()) - {file.name for file in files}
    suspects = [fault for file in files if (fault := _check(storage, file))]
    still = {file.name for file in list_kept(settings)} if suspects or strangers else set()
    yield from (fault for fault in suspects if fault.name in still)
    at_work = _list_attempts_under_way(settings) if strangers else ()
    gone = strangers - set(storage.list_names()) if strangers else set()
    for name in sorted(strangers - still - gone):
        if not name.startswith(at_work):
            yield Fault(name, "orphan")


def _list_attempts_under_way(settings: Settings) -> tuple[str, ...]:
    engine = connect(settings.database_url).execution_options(**READ_ONLY)
    asked = select(analyses.c.id, analyses.c.token).where(analyses.c.state == JobState.RUNNING)
    try:
        with engine.connect() as connection:
            return tuple(f"analyses/{row.id}/{row.token}/" for row in connection.execute(asked))
    finally:
        engine.dispose()


def _read(connection: Connection, table: Table) -> tuple[dict[str, object], ...]:
    return tuple(row._asdict() for row in connection.execute(select(table)))


def _check(storage: Storage, file: KeptFile) -> Fault | None:
    try:
        path = file.fetch(storage)
        damaged = hash_file(path) != file.sha256
    except FileNotFoundError:
        return Fault(file.name, "missing")
    storage.give_back(path)
    return Fault(file.name, "damaged") if damaged else None
