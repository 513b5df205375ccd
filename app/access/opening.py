"""Opens what knows who may come in: the secret of the start, and the accounts."""

from app.access.accounts import AccountStore
from app.access.gate import Gate
from app.access.secret import read_or_create_secret
from app.settings import Settings
from app.storage.permissions import make_folder


def open_gate(settings: Settings, accounts: AccountStore) -> Gate:
    """Open the gate of a server."""
    if settings.no_secret:
        return Gate(None, accounts)
    make_folder(settings.data_dir)
    return Gate(read_or_create_secret(settings.data_dir), accounts)
