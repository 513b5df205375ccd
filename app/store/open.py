"""Open the store of the settings; modules for many machines are loaded only on demand."""

import importlib
from types import ModuleType

from app.errors import NotInstalled
from app.settings import Settings
from app.store.folder import Storage


def open_storage(settings: Settings) -> Storage:
    """Open the folder or the bucket. Raises NotInstalled, StoreAway."""
    if not settings.object_store:
        return Storage(settings.data_dir)
    bucket: Storage = load_extra("app.store.bucket").open_bucket(settings)
    return bucket


def load_extra(module: str, extra: str = "many") -> ModuleType:
    """Load a module of ours that needs the libraries of an extra. Raises NotInstalled."""
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        raise NotInstalled(name=error.name or "", extra=extra) from error
