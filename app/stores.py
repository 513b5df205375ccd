"""Which store the settings name."""

import importlib

from app.errors import NotInstalled
from app.folder import FolderStorage
from app.settings import Settings
from app.storage import Storage


def open_storage(settings: Settings) -> Storage:
    """Open the folder or the bucket; the library for buckets is loaded only for a bucket.

    Raises
    ------
    NotInstalled
    """
    if not settings.object_store:
        return FolderStorage(settings.data_dir)
    try:
        opener = importlib.import_module("app.objects").open_bucket
    except ModuleNotFoundError as error:
        raise NotInstalled(name=error.name or "") from error
    storage: Storage = opener(settings)
    return storage
