"""The server's fixtures, for live sessions too."""

from tests.app.conftest import client, database, objects, settings, storage, store

__all__ = ["client", "database", "objects", "settings", "storage", "store"]
