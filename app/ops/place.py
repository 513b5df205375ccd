"""The state of an installation: whether it was ever used, its accounts, and whether its secret fits."""

import json
import logging
from contextlib import suppress
from dataclasses import dataclass

from sqlalchemy import Engine, select
from sqlalchemy.exc import SQLAlchemyError

from acromion.app.accounts.accounts import MARKER
from acromion.app.accounts.sign_in import name_second_factor
from acromion.app.errors import NotHere, SecretUnreadable
from acromion.app.library.audit_log import AT_MACHINE, Act, record
from acromion.app.library.database.connect import connect, read_revision
from acromion.app.library.database.tables import REVISION, people, tokens, webhooks
from acromion.app.library.webhooks import SECRET_OF_WEBHOOK
from acromion.app.report.words.messages import describe_problem
from acromion.app.settings import Settings
from acromion.app.store.folder import open_storage
from acromion.app.store.server_secret import ServerSecret

logger = logging.getLogger(__name__)

_KEPT = ("acromion.sqlite3", MARKER, "recordings")
"""A used folder contains at least one of these."""


def check_used(settings: Settings) -> None:
    """Check that this installation was ever used, without creating anything. Raises NotHere."""
    if not is_used(settings):
        raise NotHere(id=str(settings.data_dir))


def check_recoverable(settings: Settings) -> None:
    """Check that data is left here, even if the database is lost.

    Raises NotHere if folder, database and bucket are empty.
    """
    is_there = _is_folder_used(settings) or is_used(settings)
    if not is_there and not (settings.object_store and open_storage(settings).find_recordings()):
        raise NotHere(id=str(settings.data_dir))


def is_used(settings: Settings) -> bool:
    """Return whether this installation was ever used, without creating anything."""
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
    return folder.is_file() or any((folder / name).exists() for name in _KEPT)


def record_command(settings: Settings, act: Act) -> None:
    """Add the audit entry of a command that changes no row.

    If the database cannot be written, backup and verification continue without the entry.
    """
    engine = connect(settings.database_url)
    try:
        with suppress(SQLAlchemyError), engine.begin() as connection:
            if read_revision(connection) == REVISION:
                record(connection, act, who=AT_MACHINE)
    finally:
        engine.dispose()


# Accounts, and the secret that they need.


@dataclass(frozen=True, slots=True)
class Accounts:
    """Accounts as sign-in name and roles; tokens as name, owner's sign-in name, permissions and end (s)."""

    people: tuple[tuple[str, str], ...] = ()
    tokens: tuple[tuple[str, str, str, float], ...] = ()


NO_ACCOUNTS = Accounts()


def find_accounts(reader: Engine) -> Accounts:
    """Return all active accounts, and every token that is not revoked."""
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
    """Numbers of second factors and webhook secrets that this server's secret cannot decrypt."""

    second_factors: int
    webhooks: int


def find_unreadable(reader: Engine, secret: ServerSecret) -> Unreadable:
    """Count values that were encrypted with another server secret."""
    factors = select(people.c.id, people.c.totp_secret)
    with reader.connect() as connection:
        of_people = connection.execute(
            factors.where(people.c.totp_secret.is_not(None), people.c.ended_at.is_(None))
        )
        sealed = [(row.totp_secret.decode(), name_second_factor(row.id)) for row in of_people]
        hooks = [(one, SECRET_OF_WEBHOOK) for one in connection.execute(select(webhooks.c.secret)).scalars()]
    return Unreadable(*(sum(not secret.can_decrypt(*one) for one in some) for some in (sealed, hooks)))


def warn_of_lost_secret(reader: Engine, secret: ServerSecret) -> None:
    """Log a warning if second factors or webhooks must be set up again because their secret is lost."""
    lost = find_unreadable(reader, secret)
    if lost.second_factors or lost.webhooks:
        words = describe_problem(SecretUnreadable.code, {"file": str(secret.file)}, "en")
        counts = f"Second factors: {lost.second_factors}; webhooks: {lost.webhooks}."
        logger.warning("%s %s. %s %s %s", SecretUnreadable.code, words.title, words.detail, counts, words.fix)
