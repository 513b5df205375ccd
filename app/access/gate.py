"""Finds who asks by what a request brings: the secret of the start, a session or a token."""

from dataclasses import dataclass

from app.access.accounts import AccountStore
from app.access.secret import StartSecret, read_or_create_secret
from app.access.subjects import AT_THE_MACHINE, MACHINE, Subject
from app.settings import Settings
from app.storage.permissions import make_folder


@dataclass(frozen=True, slots=True)
class Credentials:
    """What a request brings: ``Authorization: Bearer`` and the session's cookie, each "" where absent.

    ``is_attended``: false for what a page asks by itself, which keeps no session alive.
    """

    bearer: str
    cookie: str
    is_attended: bool = True


@dataclass(frozen=True, slots=True)
class Gate:
    """Who may come in. ``secret`` is None where the person who started the server chose to have none."""

    secret: StartSecret | None
    accounts: AccountStore

    @property
    def needs_accounts(self) -> bool:
        """Whether people log in, instead of holding the secret."""
        return self.accounts.exist()

    def find_subject(self, credentials: Credentials) -> Subject | None:
        """Give who asks; None for somebody unknown."""
        if self.needs_accounts:
            if credentials.bearer:
                return self.accounts.find_by_token(credentials.bearer)
            if not credentials.cookie:
                return None
            return self.accounts.find_by_session(credentials.cookie, is_use=credentials.is_attended)
        if self.secret is None or self.secret.matches(credentials.bearer, credentials.cookie):
            return AT_THE_MACHINE
        return None

    def is_alive(self, subject: Subject) -> bool:
        """Tell whether a subject may still go on with what it began."""
        if subject.id == MACHINE:
            return not self.needs_accounts
        return self.accounts.is_alive(subject)

    def is_confirmed(self, subject: Subject) -> bool:
        """Tell whether what cannot be undone may be done now; of scripts nobody can ask a password again."""
        return subject.kind != "person" or self.accounts.is_confirmed(subject)


def open_gate(settings: Settings, accounts: AccountStore) -> Gate:
    """Open the gate of a server."""
    if settings.no_secret:
        return Gate(None, accounts)
    make_folder(settings.data_dir)
    return Gate(read_or_create_secret(settings.data_dir), accounts)
