"""``acromion account``: people, by whoever runs the server."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, get_args

import typer

from app.access.subjects import PERMISSIONS, Permission, Role, Subject, collect_permissions
from app.cli.admin import DataOption, LanguageOption, find_settings, refusals_printed
from app.errors import BadParameter, NotHere
from app.logs import escape_controls
from app.report.words.wording import Language, fill, load_wording

if TYPE_CHECKING:
    from app.access.accounts import Person
    from app.access.logins import Logins

account = typer.Typer(help="Who may log in: people, their roles, links and tokens.", no_args_is_help=True)

LoginArgument = Annotated[str, typer.Argument(metavar="LOGIN")]
RolesOption = Annotated[
    list[str], typer.Option("--role", metavar="|".join(get_args(Role)), help="Again for each.")
]


@dataclass(frozen=True, slots=True)
class _Desk:
    """The accounts of an installation, and the language in which they are told of."""

    logins: "Logins"
    language: Language

    def say(self, sentence: str, **facts: str) -> None:
        shown = {name: escape_controls(fact) for name, fact in facts.items()}
        typer.echo(fill(load_wording(self.language, "access")["command"][sentence], shown))

    def find(self, login: str) -> "Person":
        person = self.logins.accounts.find_person(login)
        if person is None:
            raise NotHere(id=login)
        return person

    def give_link(self, person: "Person", term_s: float) -> None:
        link = f"/login/link/{self.logins.make_link(person.id, term_s)}"
        self.say("link", hours=str(int(term_s // 3600)), link=link)
        self.say("link_path")

    def ask_password(self, person: "Person") -> None:
        """Take a password from the terminal, typed twice, or a line of standard input."""
        words = load_wording(self.language, "access")["command"]
        if sys.stdin.isatty():
            password = typer.prompt(str(words["ask"]), hide_input=True, confirmation_prompt=True)
        else:
            password = sys.stdin.readline().rstrip("\r\n")
        self.logins.check_password(person, password)
        self.logins.set_password(person, password)
        self.say("password", login=person.login)


@account.command()
def add(
    login: LoginArgument,
    role: RolesOption,
    name: Annotated[str, typer.Option(help="Of the person; else the login.")] = "",
    password: Annotated[
        bool, typer.Option("--password", help="Ask for a password now, instead of printing a link.")
    ] = False,
    data: DataOption = None,
    lang: LanguageOption = "en",
) -> None:
    """Add a person; prints an address that works once, by which a password is chosen."""
    from app.access.logins import INVITED_S  # noqa: PLC0415  the database, and only this needs it

    with _open(data, lang, may_begin=True) as desk:
        roles = _read_roles(role)
        person = desk.logins.accounts.add_person(login, name or login, roles)
        desk.say("added", login=person.login, roles=", ".join(sorted(roles)))
        if password:
            desk.ask_password(person)
        else:
            desk.give_link(person, INVITED_S)


@account.command("list")
def list_people(data: DataOption = None, lang: LanguageOption = "en") -> None:
    """List the people."""
    with _open(data, lang) as desk:
        desk.logins.accounts.note_reading()
        words = load_wording(lang, "access")
        for person in desk.logins.accounts.find_people():
            state = words["ended"] if person.ended_at else words["command"]["open"]
            about = {"id": person.id, "login": person.login, "name": person.name, "state": state}
            roles = ", ".join(sorted(person.roles))
            desk.say("person", roles=roles, **about)


@account.command()
def roles(
    login: LoginArgument, role: RolesOption, data: DataOption = None, lang: LanguageOption = "en"
) -> None:
    """Give a person these roles in place of those before."""
    with _open(data, lang) as desk:
        given = _read_roles(role)
        desk.logins.accounts.set_roles(desk.find(login).id, given)
        desk.say("roles", login=login, roles=", ".join(sorted(given)))


@account.command()
def reset(
    login: LoginArgument,
    password: Annotated[
        bool, typer.Option("--password", help="Ask for a password now, instead of printing a link.")
    ] = False,
    second_factor: Annotated[
        bool, typer.Option("--second-factor", help="Turn the second step off, too: the phone is lost.")
    ] = False,
    data: DataOption = None,
    lang: LanguageOption = "en",
) -> None:
    """Let a person choose a new password by an address that works once, for an hour."""
    from app.access.logins import FORGOTTEN_S  # noqa: PLC0415  the database, and only this needs it

    with _open(data, lang) as desk:
        person = desk.find(login)
        if second_factor:
            desk.logins.drop_second_factor(person.id)
            desk.say("second", login=person.login)
        if password:
            desk.ask_password(person)
        else:
            desk.give_link(person, FORGOTTEN_S)


@account.command()
def end(login: LoginArgument, data: DataOption = None, lang: LanguageOption = "en") -> None:
    """Let a person log in no more; sessions and tokens end at once."""
    with _open(data, lang) as desk:
        desk.logins.accounts.end_person(desk.find(login).id)
        desk.say("ended", login=login)


@account.command()
def token(
    login: LoginArgument,
    name: Annotated[str, typer.Option(help="What it is for.")],
    permission: Annotated[
        list[str], typer.Option("--may", metavar="PERMISSION", help=", ".join(PERMISSIONS))
    ],
    days: Annotated[int, typer.Option(min=1, max=365)] = 90,
    data: DataOption = None,
    lang: LanguageOption = "en",
) -> None:
    """Make a token for a person's scripts; it is printed once."""
    from app.access.tokens import format_end, make_token  # noqa: PLC0415  the database, and only this needs it

    with _open(data, lang) as desk:
        person, chosen = desk.find(login), _read_permissions(permission)
        may = collect_permissions(person.roles)
        subject = Subject("person", person.id, person.name, may)
        made, bearer = make_token(desk.logins.accounts, subject, name, chosen, days)
        typer.echo(bearer)
        desk.say("token_once", end=format_end(made))


def _read_roles(given: list[str]) -> frozenset[Role]:
    known = {role: role for role in get_args(Role)}
    if not set(given) <= set(known):
        raise BadParameter(name="--role", value=", ".join(given), allowed=", ".join(known))
    return frozenset(known[role] for role in given)


def _read_permissions(given: list[str]) -> list[Permission]:
    known: dict[str, Permission] = {permission: permission for permission in PERMISSIONS}
    if not set(given) <= set(known):
        raise BadParameter(name="--may", value=", ".join(given), allowed=", ".join(known))
    return [known[permission] for permission in given]


@contextmanager
def _open(data: DataOption, lang: Language, *, may_begin: bool = False) -> Iterator[_Desk]:
    """Open the accounts; ``may_begin``: the installation may begin with them."""
    from app.access.accounts import AccountStore  # noqa: PLC0415  the database, and only this needs it
    from app.access.logins import Logins  # noqa: PLC0415
    from app.jobs.audit_log import AT_MACHINE, acting  # noqa: PLC0415
    from app.storage.permissions import make_folder  # noqa: PLC0415
    from app.upkeep.place import check_used  # noqa: PLC0415

    settings = find_settings(data)
    with refusals_printed(lang, settings):
        if not may_begin:
            check_used(settings)
        make_folder(settings.data_dir)
        accounts = AccountStore(settings)
        try:
            with acting(AT_MACHINE):
                yield _Desk(Logins(accounts, settings), lang)
        finally:
            accounts.database.close()
