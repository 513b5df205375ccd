"""The state of an installation: whether it was ever used, its accounts, and whether its secret fits them."""

import json
import logging
from contextlib import suppress
from dataclasses import dataclass

from sqlalchemy import Engine, select
from sqlalchemy.exc import SQLAlchemyError

from app.accounts.accounts import MARKER
from app.accounts.logins import name_second_factor
from app.errors import NotHere, SecretUnreadable
from app.library.audit_log import AT_MACHINE, Act, record
from app.library.database.connect import connect, read_revision
from app.library.database.tables import REVISION, people, tokens, webhooks
from app.library.webhooks import SECRET_OF_WEBHOOK
from app.report.words.messages import describe_problem
from app.settings import Settings
from app.store.folder import open_storage
from app.store.server_secret import ServerSecret

logger = logging.getLogger(__name__)

_KEPT = ("acromion.sqlite3", MARKER, "recordings")
"""What a folder that was ever used has one of."""


def check_used(settings: Settings) -> None:
    """Check that something was ever kept here. To look makes nothing. Raises NotHere."""
    if not is_used(settings):
        raise NotHere(id=str(settings.data_dir))


def check_recoverable(settings: Settings) -> None:
    """Check that something is left here, even if the database is lost.

    Raises NotHere: nothing is in the folder, the database or the bucket.
    """
    is_there = _is_folder_used(settings) or is_used(settings)
    if not is_there and not (settings.object_store and open_storage(settings).find_recordings()):
        raise NotHere(id=str(settings.data_dir))


def is_used(settings: Settings) -> bool:
    """Return whether anything was ever kept here; to look makes nothing."""
    if settings.database_url.startswith("sqlite"):
        return _is_folder_used(settings)
    engine = connect(settings.database_url)
    try:
        with engine.connect() as connection:
            has_tables = read_revision(connection) is not None
    finally:
        engine.dispose()
    return has_tables and (bool(settings.object_store) or _is_folder_used(settings))


def _is_folder_used(settings: Settings) -> bool:
    folder = settings.data_dir
    return folder.is_file() or any((folder / name).exists() for name in _KEPT)  # a file is named as one later


def record_command(settings: Settings, act: Act) -> None:
    """Write the line of a command that changes no row.

    A store that cannot be written is backed up and verified all the same.
    """
    engine = connect(settings.database_url)
    try:
        with suppress(SQLAlchemyError), engine.begin() as connection:
            if read_revision(connection) == REVISION:
                record(connection, act, who=AT_MACHINE)
    finally:
        engine.dispose()


# ------------------------------------------------------------------ who may sign in, and with which secret


@dataclass(frozen=True, slots=True)
class Accounts:
    """Accounts as login and roles; tokens as name, login of the person, permissions and end (seconds)."""

    people: tuple[tuple[str, str], ...] = ()
    tokens: tuple[tuple[str, str, str, float], ...] = ()


NO_ACCOUNTS = Accounts()


def find_accounts(reader: Engine) -> Accounts:
    """Find everybody who may sign in, and every token that is not revoked."""
    named = select(tokens, people.c.login).join(people, tokens.c.person_id == people.c.id)
    open_ones = named.where(tokens.c.ended_at.is_(None), people.c.ended_at.is_(None))
    with reader.connect() as connection:
        found = connection.execute(select(people).where(people.c.ended_at.is_(None)).order_by(people.c.login))
        here = tuple((row.login, _join(row.roles)) for row in found)
        given = connection.execute(open_ones.order_by(people.c.login, tokens.c.name))
        return Accounts(
            here, tuple((row.name, row.login, _join(row.permissions), row.expires_s) for row in given)
        )


def _join(names: str) -> str:
    return ", ".join(json.loads(names))


@dataclass(frozen=True, slots=True)
class Unreadable:
    """How many second factors and secrets of webhooks the secret of this server cannot read."""

    second_factors: int
    webhooks: int


def find_unreadable(reader: Engine, secret: ServerSecret) -> Unreadable:
    """Count what was encrypted by another secret than that of this server."""
    factors = select(people.c.id, people.c.totp_secret)
    with reader.connect() as connection:
        of_people = connection.execute(
            factors.where(people.c.totp_secret.is_not(None), people.c.ended_at.is_(None))
        )
        sealed = [(row.totp_secret.decode(), name_second_factor(row.id)) for row in of_people]
        hooks = [(one, SECRET_OF_WEBHOOK) for one in connection.execute(select(webhooks.c.secret)).scalars()]
    return Unreadable(*(sum(not secret.can_decrypt(*one) for one in some) for some in (sealed, hooks)))


def warn_of_lost_secret(reader: Engine, secret: ServerSecret) -> None:
    """Log a warning if second factors or webhooks have to be set up again: their secret is lost."""
    lost = find_unreadable(reader, secret)
    if lost.second_factors or lost.webhooks:
        words = describe_problem(SecretUnreadable.code, {"file": str(secret.file)}, "en")
        counts = f"Second factors: {lost.second_factors}; webhooks: {lost.webhooks}."
        logger.warning("%s %s. %s %s %s", SecretUnreadable.code, words.title, words.detail, counts, words.fix)
