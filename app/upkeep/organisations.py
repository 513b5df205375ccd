"""The organisations that a command of upkeep may name."""

from app.access.accounts import AccountStore, Organisation
from app.access.database import AccountDatabase
from app.errors import NotHere
from app.jobs.database.connect import connect, read_revision
from app.jobs.organisations import find_folders, find_organisations
from app.organisation import OWN_ORGANISATION, is_organisation
from app.settings import Settings
from app.storage.open import open_storage

_KEPT = ("acromion.sqlite3", "accounts.sqlite3", "recordings")
"""What a folder that was ever used has one of."""


def find_place(settings: Settings, organisation: str, *, is_new: bool = False) -> Settings:
    """Give the settings of an organisation; ``is_new``: it may have no place yet. To look makes nothing.

    Raises
    ------
    NotHere
        No organisation is called so, or it has no folder and no schema; of "own": nothing was ever kept.
    """
    place = _build_place(settings, organisation)
    if is_new:
        return place
    if organisation == OWN_ORGANISATION:
        if not is_used(settings):
            raise NotHere(id=str(settings.data_dir))
    elif organisation not in _find_ids(settings):
        raise NotHere(id=organisation)
    return place


def find_lost_place(settings: Settings, organisation: str) -> Settings:
    """Give the settings of an organisation whose rows, or whose database, may be lost.

    Raises
    ------
    NotHere
        Nothing of it is in a folder, a schema or the bucket.
    """
    place = _build_place(settings, organisation)
    if organisation == OWN_ORGANISATION:
        is_there = _is_folder_used(place) or is_used(place)
    else:
        is_there = _is_folder_used(place) or organisation in _find_ids(settings)
    if not is_there and not (place.object_store and open_storage(place).find_recordings()):
        raise NotHere(id=str(place.data_dir) if organisation == OWN_ORGANISATION else organisation)
    return place


def is_used(place: Settings) -> bool:
    """Tell whether anything was ever kept in a place; to look makes nothing."""
    if place.database_url.startswith("sqlite"):
        return _is_folder_used(place)
    return _has_tables(place) and (bool(place.object_store) or _is_folder_used(place))


def _is_folder_used(place: Settings) -> bool:
    folder = place.data_dir
    return folder.is_file() or any((folder / name).exists() for name in _KEPT)  # a file is named as one later


def _has_tables(place: Settings) -> bool:
    """Tell whether there are tables, those of rows or those of accounts."""
    engine = connect(place.database_url)
    try:
        with engine.connect() as connection:
            return read_revision(connection) is not None or AccountDatabase.is_in(connection)
    finally:
        engine.dispose()


def _build_place(settings: Settings, organisation: str) -> Settings:
    if organisation != OWN_ORGANISATION and not is_organisation(organisation):
        raise NotHere(id=organisation[:40])
    return settings.for_organisation(organisation)


def find_further(settings: Settings) -> tuple[Organisation, ...]:
    """Give the organisations with a place of their own, beside "own", by name where they have one."""
    ids, accounts = _find_ids(settings), AccountStore(settings)
    try:
        known = accounts.find_organisations() if accounts.database.is_there else ()
    finally:
        accounts.database.close()
    named = {one.id: one.name for one in known}
    return tuple(Organisation(one, named.get(one, one)) for one in ids)


def _find_ids(settings: Settings) -> tuple[str, ...]:
    if settings.database_url.startswith("sqlite"):
        return find_folders(settings)
    engine = connect(settings.database_url)
    try:
        return find_organisations(settings, engine)
    finally:
        engine.dispose()
