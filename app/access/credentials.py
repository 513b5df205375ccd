"""What people log in with: the hash of a password, an authenticator, recovery codes, browsers of before."""

import logging
import secrets
from collections.abc import Collection
from dataclasses import dataclass

from sqlalchemy import ColumnElement, delete, func, insert, select, update

from app.access.accounts import AccountStore, Person, normalise_login, note_act
from app.access.hashing import hash_secret
from app.errors import SecretUnreadable
from app.jobs.database.tables import known_browsers, link_uses, people, recovery_codes
from app.jobs.queries import format_now

UNOPENED = "?"
"""In place of an authenticator's secret whose key is not here: no code is right, recovery codes are."""
BROWSER_BYTES = 32
BROWSER_TERM_S = 400 * 24 * 3600
"""As long as browsers keep a cookie at most."""

logger = logging.getLogger(__name__)


def name_second_factor(person_id: str) -> str:
    """Name what the secret of an authenticator is encrypted about: no row opens as another person's."""
    return f"second factor of {person_id}"


@dataclass(frozen=True, slots=True)
class LinkUse:
    """A password was set by a link: ``made_by`` (an id, or ``machine``) made it, ``address`` used it.

    ``is_told``: the person knows.
    """

    made_by: str
    address: str
    used_at: str = ""
    is_told: bool = False


@dataclass(frozen=True, slots=True)
class Credentials:
    """What is kept of one person's ways in.

    ``second_factor``: an authenticator's secret, "" for none, :data:`UNOPENED` where its key is lost.
    """

    person_id: str
    password_hash: str | None
    second_factor: str
    last_step: int


class CredentialStore:
    """Rows of what people log in with."""

    def __init__(self, accounts: AccountStore) -> None:
        self._database, self._clock, self._secrets = accounts.database, accounts.clock, accounts.secrets

    def find(self, login: str) -> Credentials | None:
        """Find what a person may log in with, by the login name; None where nobody may by this name."""
        return self._find(people.c.login == normalise_login(login))

    def find_of(self, person_id: str) -> Credentials | None:
        """Find what a person may log in with."""
        return self._find(people.c.id == person_id)

    def set_password(self, person_id: str, password_hash: str, *, is_new: bool = True) -> None:
        """Keep the hash of a password; ``is_new``: of another one than before."""
        with self._database.write() as connection:
            mine = update(people).where(people.c.id == person_id)
            connection.execute(mine.values(password_hash=password_hash))
            if is_new:
                note_act(connection, "password.changed", person_id)

    def set_password_by_link(self, person: Person, password_hash: str, use: LinkUse) -> None:
        """Keep the hash of a password that was set by a link, and by which one."""
        told_at = None if person.has_password else format_now()  # the first is no news to who was invited
        row = {"made_by": use.made_by, "address": use.address, "used_at": format_now(), "told_at": told_at}
        with self._database.write() as connection:
            mine = update(people).where(people.c.id == person.id)
            connection.execute(mine.values(password_hash=password_hash))
            connection.execute(delete(link_uses).where(link_uses.c.person_id == person.id))
            connection.execute(insert(link_uses).values(row | {"person_id": person.id}))
            by = {"by": "link", "made_by": use.made_by, "address": use.address}
            note_act(connection, "password.changed", person.id, **by)

    def find_link_use(self, person_id: str) -> LinkUse | None:
        """Find the link by which a person's password was last set; None where it was not by one."""
        row = self._database.read_one(select(link_uses).where(link_uses.c.person_id == person_id))
        return LinkUse(row.made_by, row.address, row.used_at, row.told_at is not None) if row else None

    def note_told(self, person_id: str) -> None:
        """Note that a person knows of the link."""
        with self._database.write() as connection:
            mine = update(link_uses).where(link_uses.c.person_id == person_id)
            connection.execute(mine.values(told_at=format_now()))

    def set_second_factor(self, person_id: str, secret: str, step: int, codes: Collection[str]) -> None:
        """Keep an authenticator and its recovery codes in place of those before; "" for none."""
        sealed = self._secrets.encrypt(secret, name_second_factor(person_id)).encode() if secret else None
        values = {"totp_secret": sealed, "totp_step": step}
        with self._database.write() as connection:
            connection.execute(update(people).where(people.c.id == person_id).values(values))
            connection.execute(delete(recovery_codes).where(recovery_codes.c.person_id == person_id))
            rows = [{"person_id": person_id, "hash": hash_secret(code)} for code in codes]
            if rows:
                connection.execute(insert(recovery_codes), rows)
            note_act(connection, "second_factor.changed", person_id, what="on" if secret else "off")

    def use_step(self, person_id: str, step: int) -> bool:
        """Use up the step of a code; False where it, or a later one, was used: of two at once one wins."""
        with self._database.write() as connection:
            unused = (people.c.id == person_id, people.c.totp_step < step)
            used = connection.execute(update(people).where(*unused).values(totp_step=step))
        return used.rowcount == 1

    def use_recovery_code(self, person_id: str, code: str) -> bool:
        """Use up a recovery code; False where there is none such."""
        with self._database.write() as connection:
            mine = (recovery_codes.c.person_id == person_id, recovery_codes.c.hash == hash_secret(code))
            used = connection.execute(delete(recovery_codes).where(*mine))
        return used.rowcount == 1

    def count_recovery_codes(self, person_id: str) -> int:
        """Count the recovery codes that are left."""
        mine = recovery_codes.c.person_id == person_id
        return int(self._database.read_value(select(func.count()).select_from(recovery_codes).where(mine)))

    def knows_browser(self, browser: str, person_id: str) -> bool:
        """Tell whether a person has logged in in this browser before."""
        is_it = (known_browsers.c.hash == hash_secret(browser), known_browsers.c.person_id == person_id)
        recent = known_browsers.c.used_s > self._clock() - BROWSER_TERM_S
        return self._database.read_one(select(known_browsers).where(*is_it, recent)) is not None

    def note_browser(self, browser: str, person_id: str) -> str:
        """Note that a person logged in in a browser; gives its new name, for the one before may be known."""
        name, before, now_s = secrets.token_urlsafe(BROWSER_BYTES), hash_secret(browser), self._clock()
        with self._database.write() as connection:
            old = known_browsers.c.used_s <= now_s - BROWSER_TERM_S
            mine = (known_browsers.c.hash == before, known_browsers.c.person_id == person_id)
            connection.execute(delete(known_browsers).where(old))
            connection.execute(delete(known_browsers).where(*mine))
            others = update(known_browsers).where(known_browsers.c.hash == before)
            connection.execute(others.values(hash=hash_secret(name)))
            row = {"hash": hash_secret(name), "person_id": person_id, "used_s": now_s}
            connection.execute(insert(known_browsers).values(row))
        return name

    def _find(self, is_it: ColumnElement[bool]) -> Credentials | None:
        row = self._database.read_one(select(people).where(is_it, people.c.ended_at.is_(None)))
        if row is None:
            return None
        secret = self._open(row.id, row.totp_secret.decode()) if row.totp_secret else ""
        return Credentials(row.id, row.password_hash, secret, row.totp_step)

    def _open(self, person_id: str, kept: str) -> str:
        try:
            return self._secrets.decrypt(kept, name_second_factor(person_id))
        except SecretUnreadable:
            logger.error(
                "the second factor of %s cannot be read: put server.key back, or "
                "acromion account reset LOGIN --second-factor",
                person_id,
            )
            return UNOPENED
