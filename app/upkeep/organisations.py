"""The organisations that a command of upkeep may name."""

import re

from app.access.accounts import AccountStore, Organisation
from app.errors import NotHere
from app.jobs.database.connect import connect
from app.jobs.organisations import find_folders, find_organisations
from app.organisation import OWN_ORGANISATION, PREFIX
from app.settings import Settings

_ID = re.compile(rf"{PREFIX}[0-9a-z]{{1,28}}")


def find_place(settings: Settings, organisation: str, *, is_new: bool = False) -> Settings:
    """Give the settings of an organisation; ``is_new``: it may have no place yet.

    Raises
    ------
    NotHere
        No organisation is called so, or it has no folder and no schema.
    """
    if organisation != OWN_ORGANISATION:
        is_known = bool(_ID.fullmatch(organisation)) and (is_new or organisation in _find_ids(settings))
        if not is_known:
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
