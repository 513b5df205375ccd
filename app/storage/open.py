"""Open the store of the settings, behind seals; modules for many machines are loaded only on demand."""

import importlib
from types import ModuleType

from app.errors import NotInstalled
from app.settings import Settings
from app.storage.byte_store import ByteStore
from app.storage.folder import FolderStorage
from app.storage.keys import open_keys
from app.storage.sealing import SealedStorage


def open_storage(settings: Settings) -> SealedStorage:
    """Open the folder or the bucket, with the keys of what is in it.

    Raises
    ------
    NotInstalled, StoreAway
    """
    return SealedStorage(_open_bytes(settings), open_keys(settings))


def _open_bytes(settings: Settings) -> ByteStore:
    if not settings.object_store:
        return FolderStorage(settings.data_dir)
    bucket: ByteStore = load_extra("app.storage.bucket").open_bucket(settings)
    return bucket


def load_extra(module: str, extra: str = "many") -> ModuleType:
    """Load a module of ours that needs the libraries of an extra.

    Raises
    ------
    NotInstalled
    """
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        raise NotInstalled(name=error.name or "", extra=extra) from error
