"""The commands of the person who runs Acromion: serve, worker, backup, restore, verify, recover, doctor."""

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from app.cli.output import Exit, print_problem
from app.errors import AppError, BackupRefused, DatabaseAway
from app.logs import escape_controls, start_logging
from app.report.words.messages import describe_problem
from app.report.words.wording import Language, fill, load_wording
from fusion.conventions import PoseHeld

if TYPE_CHECKING:
    from app.settings import Settings
    from app.upkeep.account_rows import Accounts
    from app.upkeep.backup import Copied
    from app.upkeep.verify import Fault


# Commands that keep running: the server and its workers.


def serve(
    host: Annotated[
        str, typer.Option(help="Any but this computer needs accounts, --hosts and TLS.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535)] = 8080,
    data: Annotated[Path, typer.Option(metavar="DIR", help="Where recordings and reports are kept.")] = Path(
        "acromion-data"
    ),
    workers: Annotated[
        int, typer.Option("-j", "--jobs", min=0, help="Analyses at once; 0 leaves them to other workers.")
    ] = 2,
    open_: Annotated[bool, typer.Option("--open", help="Open the page in the browser.")] = False,
    watch: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Take in what is put into this folder, too.")
    ] = None,
    pose_held: Annotated[
        PoseHeld | None,
        typer.Option(help="Of what --watch takes in: the pose was held at the start of wear, or not."),
    ] = None,
    tls_cert: Annotated[Path | None, typer.Option(metavar="FILE.pem", help="Certificate of HTTPS.")] = None,
    tls_key: Annotated[Path | None, typer.Option(metavar="FILE.pem", help="Its key.")] = None,
    hosts: Annotated[str, typer.Option(metavar="NAME,...", help="Names that the server answers to.")] = "",
    proxy: Annotated[
        str, typer.Option(metavar="ADDRESS", help="A proxy of this computer that ends TLS: 127.0.0.1 or ::1.")
    ] = "",
    no_secret: Annotated[
        bool, typer.Option("--no-secret", help="Without accounts, let everybody on this computer in.")
    ] = False,
) -> None:
    """Serve the page and the API, with the workers that do the analyses."""
    from app.main import serve as serve_app  # noqa: PLC0415
    from app.settings import Settings  # noqa: PLC0415

    if pose_held and not watch:
        raise typer.BadParameter("only with --watch", param_hint="--pose-held")
    try:
        settings = Settings(host=host, port=port, data_dir=data, workers=workers, watch_dir=watch)
        chosen = {"tls_cert": tls_cert, "tls_key": tls_key, "hosts": hosts, "proxy": proxy}
        chosen["watch_pose_held"] = pose_held
        given = {name: value for name, value in (chosen | {"no_secret": no_secret}).items() if value}
        settings = settings.model_copy(update=given)
        serve_app(settings, open_browser=open_)
    except AppError as refusal:
        print_problem("serve", refusal.code, refusal.facts, "en")
        raise typer.Exit(Exit.USAGE) from None


def worker(
    data: Annotated[Path, typer.Option(metavar="DIR", help="The data folder of the server.")] = Path(
        "acromion-data"
    ),
) -> None:
    """Do queued analyses until stopped; any number may run beside the server."""
    from app.jobs.database.connect import check_whole, translate_start_errors  # noqa: PLC0415
    from app.jobs.worker import run_by_settings  # noqa: PLC0415
    from app.settings import Settings  # noqa: PLC0415
    from app.start_checks import check_passwords  # noqa: PLC0415

    settings = Settings(data_dir=data)
    try:
        start_logging()
        check_passwords(settings)
        with translate_start_errors(settings):
            check_whole(settings.database_url)
        run_by_settings(settings)
    except AppError as refusal:
        print_problem("worker", refusal.code, refusal.facts, "en")
        raise typer.Exit(Exit.USAGE) from None


DataOption = Annotated[
    Path | None,
    typer.Option("--data", metavar="DIR", help="The data folder; else ACROMION_DATA_DIR or ./acromion-data."),
]
LanguageOption = Annotated[Language, typer.Option("--lang")]
RecipientOption = Annotated[
    list[str] | None,
    typer.Option("--recipient", metavar="age1...", help="Who may read it (age); again for several."),
]
IdentityOption = Annotated[
    Path | None, typer.Option("--identity", metavar="FILE", help="The age identity that opens it.")
]


def backup(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="The backup to write (.zip, .zip.age).")],
    recipient: RecipientOption = None,
    keep: Annotated[
        int | None,
        typer.Option(
            min=1, help="Keep so many backups of this name (its digits may differ); delete older ones."
        ),
    ] = None,
    data: DataOption = None,
    lang: LanguageOption = "en",
) -> None:
    """Write every row and every file into one file; the server may run meanwhile.

    A damaged store is backed up, too: what is missing or damaged is listed, and the exit code is 1.
    """
    from app.storage.open import open_storage  # noqa: PLC0415
    from app.upkeep.backup import back_up, drop_older_backups  # noqa: PLC0415  only this needs the database
    from app.upkeep.backup_term import record_backup  # noqa: PLC0415
    from app.upkeep.envelope import Recipients  # noqa: PLC0415
    from app.upkeep.place import check_used, record_command  # noqa: PLC0415

    if keep and not any(letter.isdigit() for letter in file.name):
        raise typer.BadParameter("FILE needs a date: acromion-2026-03-02.zip", param_hint="--keep")
    settings = find_settings(data)
    with refusals_printed(lang, settings):
        check_used(settings)
        record_command(settings, "store.backed_up")
        copied = back_up(settings, file, Recipients(tuple(recipient or ())))
        dropped = drop_older_backups(file, keep) if keep and not copied.faults else ()
        record_backup(open_storage(settings), keep)
    print_sentence(lang, "backup", "encrypted" if recipient else "in_clear")
    _print_copied(lang, "backup", copied, file=str(file))
    if dropped:
        print_sentence(lang, "backup", "dropped", keep=str(keep), names=", ".join(dropped))
    _exit_by(copied)


def drill(
    file: Annotated[Path, typer.Argument(metavar="BACKUP", help="The backup to try.")],
    identity: IdentityOption = None,
    lang: LanguageOption = "en",
) -> None:
    """Restore a backup into a temporary folder, read every byte, and say how long it took."""
    from app.upkeep.backup import drill as try_out  # noqa: PLC0415  the database, and only this needs it

    with refusals_printed(lang, find_settings(None)):
        done = try_out(file, identity)
    _print_faults(lang, done.faults)
    minutes = math.ceil(done.minutes * 10) / 10  # a short drill took no 0.0 minutes
    facts = {"number": str(done.files), "minutes": f"{minutes:.1f}", "faults": str(len(done.faults))}
    print_sentence(lang, "drill", "bad" if done.faults else "good", **facts)
    if done.faults:
        raise typer.Exit(Exit.SOME_FAILED)


def restore(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="The backup to read.")],
    identity: IdentityOption = None,
    data: DataOption = None,
    lang: LanguageOption = "en",
) -> None:
    """Put a backup into an empty data folder (or an empty database and bucket).

    A backup with faults is restored, too: what is missing or damaged is listed, and the exit code is 1.
    """
    from app.storage.store import LEDGER_FILE  # noqa: PLC0415  the database, and only this needs it
    from app.upkeep.backup import restore as put_back  # noqa: PLC0415

    settings = find_settings(data)
    with refusals_printed(lang, settings):
        copied = put_back(settings, file, identity)
    _print_accounts(lang, copied.accounts)
    if copied.erased:
        print_sentence(lang, "restore", "erased", number=str(copied.erased))
    _print_copied(lang, "restore", copied, folder=str(settings.data_dir), **_name_places(settings))
    print_sentence(lang, "restore", "ledger", name=LEDGER_FILE)
    _exit_by(copied)


def verify(
    file: Annotated[Path | None, typer.Argument(metavar="FILE", help="A backup; else what is kept.")] = None,
    identity: IdentityOption = None,
    data: DataOption = None,
    lang: LanguageOption = "en",
) -> None:
    """Read every file and compare it with what its row says."""
    with refusals_printed(lang, find_settings(data)):
        settings = find_settings(data)
        number, faults = _verify_kept(settings) if file is None else _verify_backup(file, identity)
    _print_faults(lang, faults)
    if faults:
        print_sentence(lang, "verify", "bad", faults=str(len(faults)), number=str(number))
        raise typer.Exit(Exit.SOME_FAILED)
    print_sentence(lang, "verify", "good", number=str(number))


def recover(
    data: DataOption = None,
    lang: LanguageOption = "en",
) -> None:
    """Bring back from the side files the recordings that the database has lost; rows that are there stay."""
    from app.upkeep.place import check_recoverable  # noqa: PLC0415  the database, and only this needs it
    from app.upkeep.recover import recover as bring_back  # noqa: PLC0415

    settings = find_settings(data)
    with refusals_printed(lang, settings):
        check_recoverable(settings)
        done = bring_back(settings)
    for trouble in done.troubles:
        print_sentence(lang, "recover", trouble.finding, name=trouble.name)
    counts = {"added": done.recordings, "trashed": done.trashed, "reports": done.reports, "known": done.known}
    facts = {name: str(number) for name, number in counts.items()}
    if done.copied_at:
        print_sentence(lang, "recover", "copy", at=done.copied_at)
    print_sentence(lang, "recover", "done", **facts)
    _print_accounts(lang, done.accounts)
    if done.troubles:
        print_sentence(lang, "recover", "bad", number=str(len(done.troubles)))
        raise typer.Exit(Exit.SOME_FAILED)


def doctor(data: DataOption = None, lang: LanguageOption = "en") -> None:
    """Look for what would keep Acromion from working well on this machine, and say the cure."""
    from app.upkeep.doctor import examine  # noqa: PLC0415  the database, and only this needs it

    words, healthy = load_wording(lang, "operations"), True
    for found in examine(find_settings(data)):
        entry = words["check"][found.name]
        what, cure = fill(entry["what"], found.facts), fill(entry["cure"], found.facts)
        print_sentence(lang, "doctor", "good" if found.healthy else "bad", what=what, cure=cure)
        healthy = healthy and found.healthy
    if not healthy:
        raise typer.Exit(Exit.SOME_FAILED)


def _verify_kept(settings: "Settings") -> "tuple[int, Sequence[Fault]]":
    from app.jobs.database.connect import check_whole  # noqa: PLC0415  the database, and only this needs it
    from app.upkeep.place import check_used, record_command  # noqa: PLC0415
    from app.upkeep.verify import find_faults, find_kept  # noqa: PLC0415

    check_used(settings)
    check_whole(settings.database_url)
    record_command(settings, "store.verified")
    kept = find_kept(settings)
    return len(kept), tuple(find_faults(settings, kept))


def _verify_backup(file: Path, identity: Path | None) -> "tuple[int, Sequence[Fault]]":
    from app.upkeep.backup import find_damage  # noqa: PLC0415  the database, and only this needs it

    copied = find_damage(file, identity)
    return copied.promised, copied.faults


def _name_places(settings: "Settings") -> dict[str, str]:
    """Name where files and rows are: the data folder alone, or both places, without a password."""
    from sqlalchemy.engine import make_url  # noqa: PLC0415  heavy, and only this needs it

    files, database = settings.object_store or str(settings.data_dir), make_url(settings.database_url)
    is_one = not settings.object_store and settings.is_database_inside
    return {"files": files, "rows": "" if is_one else database.render_as_string(hide_password=True)}


def _print_copied(language: Language, command: str, copied: "Copied", **facts: str) -> None:
    """Print how many files were copied and which were not whole."""
    if not copied.faults:
        print_sentence(language, command, "done", number=str(copied.promised), **facts)
        return
    _print_faults(language, copied.faults)
    counts = {"number": str(copied.promised), "faults": str(len(copied.faults))}
    print_sentence(language, command, "not_whole", **counts, **facts)


def _exit_by(copied: "Copied") -> None:
    if copied.faults:
        raise typer.Exit(Exit.SOME_FAILED)


def _print_accounts(language: Language, accounts: "Accounts") -> None:
    """Print who may sign in, and which tokens work."""
    for login, roles in accounts.people:
        print_sentence(language, "restore", "person", login=login, roles=roles)
    for name, login, permissions, expires_s in accounts.tokens:
        end = datetime.fromtimestamp(expires_s, UTC).isoformat(timespec="minutes")
        print_sentence(language, "restore", "token", name=name, login=login, permissions=permissions, end=end)


def _print_faults(language: Language, faults: "Sequence[Fault]") -> None:
    for fault in faults:
        print_sentence(language, "verify", fault.finding, name=fault.name)


def find_settings(data: Path | None) -> "Settings":
    """Give the settings of a data folder, else those of the environment."""
    from app.settings import Settings  # noqa: PLC0415

    return Settings() if data is None else Settings(data_dir=data)


def print_sentence(language: Language, command: str, sentence: str, /, **facts: str) -> None:
    """Print a sentence of a command, filled in."""
    shown = {name: escape_controls(fact) for name, fact in facts.items()}
    typer.echo(fill(load_wording(language, "operations")[command][sentence], shown))


@contextmanager
def refusals_printed(language: Language, settings: "Settings") -> Iterator[None]:
    """Print a refusal in words, and end with its exit code."""
    from sqlalchemy.exc import SQLAlchemyError  # noqa: PLC0415  heavy, and only this needs it

    from app.jobs.database.connect import translate_start_errors  # noqa: PLC0415

    try:
        with translate_start_errors(settings):
            yield
    except AppError as refusal:
        _print_refusal(refusal, language)
    except SQLAlchemyError:
        _print_refusal(DatabaseAway(), language)
    except OSError as error:  # the place of the backup
        _print_refusal(BackupRefused(why=f"{error.filename or ''} {error.strerror}".strip()), language)


def _print_refusal(refusal: AppError, language: Language) -> None:
    words = describe_problem(refusal.code, refusal.facts, language)
    typer.echo(f"{refusal.code} {words.title}\n  {words.detail}\n  {words.fix}", err=True)
    raise typer.Exit(Exit.NOTHING_DONE) from None
