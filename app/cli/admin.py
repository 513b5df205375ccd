"""Commands for administrators: server, backups, audit log, retention, holds and accounts."""

import hashlib
import json
import math
import secrets
import sys
from collections.abc import Collection, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import typer

from acromion.app.accounts.subjects import PERMISSIONS, ROLES, Subject, collect_permissions
from acromion.app.cli.output import Exit, print_problem
from acromion.app.errors import (
    UNREADABLE_PATH,
    AppError,
    BackupRefused,
    BadParameter,
    DatabaseAway,
    NotHere,
    StoreDamaged,
)
from acromion.app.logs import escape_controls, start_logging
from acromion.app.report.words.messages import describe_problem
from acromion.app.report.words.wording import Language, fill, load_wording
from acromion.fusion.conventions import PoseHeld

if TYPE_CHECKING:
    from acromion.app.accounts.accounts import Person
    from acromion.app.accounts.sign_in import SignIn
    from acromion.app.library.jobs import JobStore
    from acromion.app.ops.backup import Copied
    from acromion.app.ops.place import Accounts
    from acromion.app.ops.verify import Fault
    from acromion.app.settings import Settings

T = TypeVar("T", bound=str)

# Commands that keep running: the server and its workers.


def serve(
    host: Annotated[
        str | None,
        typer.Option(
            help="Address to listen on; other than this computer, it needs accounts, --hosts and TLS.",
            show_default="127.0.0.1",
        ),
    ] = None,
    port: Annotated[int | None, typer.Option(min=0, max=65535, show_default="8080")] = None,
    data: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder for recordings and reports.", show_default="acromion-data"),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(
            *("-j", "--jobs"),
            min=0,
            help="Analyses in parallel; 0 leaves them to separate workers.",
            show_default="2",
        ),
    ] = None,
    open_: Annotated[bool, typer.Option("--open", help="Open the page in the browser.")] = False,
    watch: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Also import files that are put into this folder.")
    ] = None,
    pose_held: Annotated[
        PoseHeld | None,
        typer.Option(help="For files of --watch: whether the pose was held at the start of wear."),
    ] = None,
    tls_cert: Annotated[Path | None, typer.Option(metavar="FILE.pem", help="TLS certificate.")] = None,
    tls_key: Annotated[
        Path | None, typer.Option(metavar="FILE.pem", help="Private key of the certificate.")
    ] = None,
    hosts: Annotated[str, typer.Option(metavar="NAME,...", help="Host names of the server.")] = "",
    proxy: Annotated[
        str,
        typer.Option(metavar="ADDRESS", help="Address of a TLS proxy on this computer: 127.0.0.1 or ::1."),
    ] = "",
    no_secret: Annotated[
        bool, typer.Option("--no-secret", help="Without accounts, allow everyone on this computer.")
    ] = False,
) -> None:
    """Start the web page, the API and the workers.

    An option overrides its setting in the environment (ACROMION_HOST, ACROMION_PORT and so on).
    """
    from acromion.app.main import serve as serve_app  # noqa: PLC0415

    settings = load_settings(
        data,
        host=host,
        port=port,
        workers=workers,
        watch_dir=watch,
        tls_cert=tls_cert,
        tls_key=tls_key,
        hosts=hosts or None,
        proxy=proxy or None,
        watch_pose_held=pose_held,
        no_secret=no_secret or None,
    )
    if pose_held and not settings.watch_dir:
        raise typer.BadParameter("only with --watch", param_hint="--pose-held")
    try:
        serve_app(settings, open_browser=open_)
    except AppError as refusal:
        print_problem("serve", refusal.code, refusal.facts, "en")
        raise typer.Exit(Exit.USAGE) from None


def worker(
    data: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Data folder of the server.", show_default="acromion-data"),
    ] = None,
) -> None:
    """Run queued analyses until stopped; several workers can run next to the server."""
    from acromion.app.library.database.connect import check_whole, translate_start_errors  # noqa: PLC0415
    from acromion.app.queue.worker import run_by_settings  # noqa: PLC0415
    from acromion.app.start_checks import check_passwords  # noqa: PLC0415
    from acromion.app.store.permissions import restrict_new_files  # noqa: PLC0415

    restrict_new_files()
    settings = load_settings(data)
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
    typer.Option("--data", metavar="DIR", help="Data folder; default: ACROMION_DATA_DIR or ./acromion-data."),
]
LanguageOption = Annotated[Language, typer.Option("--lang")]
RecipientOption = Annotated[
    list[str] | None,
    typer.Option(
        "--recipient", metavar="age1...", help="Public key (age) that can decrypt it; can be repeated."
    ),
]
IdentityOption = Annotated[
    Path | None,
    typer.Option("--identity", metavar="FILE", help="File with the age identity that decrypts it."),
]


def backup(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE",
            help="The backup to write (.zip, .zip.age), or a folder for a dated one.",
        ),
    ],
    recipient: RecipientOption = None,
    keep: Annotated[
        int | None,
        typer.Option(
            min=1, help="Keep this many backups with this name (digits may differ); delete older ones."
        ),
    ] = None,
    data: DataOption = None,
    lang: LanguageOption = "en",
) -> None:
    """Write all rows and files into one file, even while the server is running.

    A damaged store is also backed up: missing or damaged files are listed, and the exit code is 1.
    """
    from acromion.app.ops.backup import back_up, drop_older_backups  # noqa: PLC0415  loads the database
    from acromion.app.ops.copies import record_backup  # noqa: PLC0415
    from acromion.app.ops.place import check_used, record_command  # noqa: PLC0415
    from acromion.app.store.folder import open_storage  # noqa: PLC0415

    if file.is_dir():
        file /= f"acromion-{datetime.now(UTC):%Y-%m-%d-%H%M%S}.zip{'.age' if recipient else ''}"
    if keep and not any(letter.isdigit() for letter in file.name):
        raise typer.BadParameter(
            "FILE must contain a date, such as acromion-2026-03-02.zip", param_hint="--keep"
        )
    settings = load_settings(data)
    with _printing_refusals(lang, settings):
        check_used(settings)
        record_command(settings, "store.backed_up")
        copied = back_up(settings, file, recipient or ())
        dropped = drop_older_backups(file, keep) if keep and not copied.faults else ()
        record_backup(open_storage(settings), keep)
    print_sentence(lang, "backup", "encrypted" if recipient else "in_clear")
    _print_copied(lang, "backup", copied, file=str(file))
    if dropped:
        print_sentence(lang, "backup", "dropped", keep=str(keep), names=", ".join(dropped))
    if copied.faults:
        raise typer.Exit(Exit.SOME_FAILED)


def drill(
    file: Annotated[Path, typer.Argument(metavar="BACKUP", help="Backup to test.")],
    identity: IdentityOption = None,
    lang: LanguageOption = "en",
) -> None:
    """Restore a backup into a temporary folder, check every file, and print how long it took.

    If a file is missing or damaged, the exit code is 4.
    """
    from acromion.app.ops.backup import drill as try_out  # noqa: PLC0415  loads the database

    with _printing_refusals(lang, load_settings(None)):
        done = try_out(file, identity)
    _print_faults(lang, done.faults)
    minutes = math.ceil(done.minutes * 10) / 10  # round up, so that a short drill does not show 0.0
    facts = {"number": str(done.files), "minutes": f"{minutes:.1f}", "faults": str(len(done.faults))}
    print_sentence(lang, "drill", "bad" if done.faults else "good", **facts)
    if done.faults:
        raise typer.Exit(Exit.INCOMPLETE)


def restore(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Backup to restore.")],
    identity: IdentityOption = None,
    data: DataOption = None,
    lang: LanguageOption = "en",
) -> None:
    """Restore a backup into an empty data folder (or an empty database and bucket).

    A backup with errors is also restored: missing or damaged files are listed, and the exit code is 4.
    Recordings that were erased after the backup are skipped and counted; they do not change the exit code.
    """
    from sqlalchemy.engine import make_url  # noqa: PLC0415  slow import

    from acromion.app.ops.backup import restore as put_back  # noqa: PLC0415
    from acromion.app.store.folder import LEDGER_FILE  # noqa: PLC0415  loads the database

    settings = load_settings(data)
    with _printing_refusals(lang, settings):
        copied = put_back(settings, file, identity)
    _print_accounts(lang, copied.accounts)
    if copied.erased:
        print_sentence(lang, "restore", "erased", number=str(copied.erased))
    places = {"folder": str(settings.data_dir), "files": settings.object_store or str(settings.data_dir)}
    rows = ""  # the rows are in the data folder, like the files
    if settings.object_store or not settings.is_database_inside:
        rows = make_url(settings.database_url).render_as_string(hide_password=True)
    _print_copied(lang, "restore", copied, **places, rows=rows)
    print_sentence(lang, "restore", "ledger", name=LEDGER_FILE)
    if copied.faults:
        raise typer.Exit(Exit.INCOMPLETE)


def verify(
    file: Annotated[
        Path | None, typer.Argument(metavar="FILE", help="Backup to check; default: the data folder.")
    ] = None,
    identity: IdentityOption = None,
    data: DataOption = None,
    lang: LanguageOption = "en",
) -> None:
    """Read every file and compare it with its row in the database."""
    from acromion.app.library.database.connect import check_whole  # noqa: PLC0415  loads the database
    from acromion.app.ops.backup import find_damage  # noqa: PLC0415
    from acromion.app.ops.place import check_used, record_command  # noqa: PLC0415
    from acromion.app.ops.verify import find_expected, find_faults  # noqa: PLC0415

    with _printing_refusals(lang, load_settings(data)):
        settings = load_settings(data)
        if file is None:
            check_used(settings)
            check_whole(settings.database_url)
            record_command(settings, "store.verified")
            kept = find_expected(settings)
            number, faults = len(kept), tuple(find_faults(settings, kept))
        else:
            copied = find_damage(file, identity)
            number, faults = copied.promised, tuple(copied.faults)
    _print_faults(lang, faults)
    if faults:
        print_sentence(lang, "verify", "bad", faults=str(len(faults)), number=str(number))
        raise typer.Exit(Exit.SOME_FAILED)
    print_sentence(lang, "verify", "good", number=str(number))


def recover(data: DataOption = None, lang: LanguageOption = "en") -> None:
    """Restore recordings that the database has lost from the side files; existing rows do not change.

    Recordings that could not be recovered completely are listed, and the exit code is 4. Erased recordings
    are skipped and counted; they do not change the exit code.
    """
    from acromion.app.ops.place import check_recoverable  # noqa: PLC0415  loads the database
    from acromion.app.ops.recover import recover as bring_back  # noqa: PLC0415

    settings = load_settings(data)
    with _printing_refusals(lang, settings):
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
    if done.erased:
        print_sentence(lang, "recover", "erased", number=str(done.erased))
    if done.troubles:
        print_sentence(lang, "recover", "bad", number=str(len(done.troubles)))
        raise typer.Exit(Exit.INCOMPLETE)


def doctor(data: DataOption = None, lang: LanguageOption = "en") -> None:
    """Check this machine for problems that affect Acromion, and print how to fix them."""
    from acromion.app.ops.doctor import examine  # noqa: PLC0415  loads the database

    words, has_failed = load_wording(lang, "operations"), False
    for found in examine(load_settings(data)):
        entry = words["check"][found.name]
        what, cure = fill(entry["what"], found.facts), fill(entry["cure"], found.facts)
        print_sentence(lang, "doctor", found.state, what=what, cure=cure)
        has_failed = has_failed or found.state == "bad"
    if has_failed:
        raise typer.Exit(Exit.SOME_FAILED)


def _print_copied(language: Language, command: str, copied: "Copied", **facts: str) -> None:
    """Print how many files were copied, and which were missing or damaged."""
    if not copied.faults:
        print_sentence(language, command, "done", number=str(copied.promised), **facts)
        return
    _print_faults(language, copied.faults)
    counts = {"number": str(copied.promised), "faults": str(len(copied.faults))}
    print_sentence(language, command, "not_whole", **counts, **facts)


def _print_accounts(language: Language, accounts: "Accounts") -> None:
    """Print which people can sign in, and which tokens are valid."""
    for login, roles in accounts.people:
        print_sentence(language, "restore", "person", login=login, roles=roles)
    for name, login, permissions, expires_s in accounts.tokens:
        end = datetime.fromtimestamp(expires_s, UTC).isoformat(timespec="minutes")
        print_sentence(language, "restore", "token", name=name, login=login, permissions=permissions, end=end)


def _print_faults(language: Language, faults: "Sequence[Fault]") -> None:
    for fault in faults:
        print_sentence(language, "verify", fault.finding, name=fault.name)


def load_settings(data: Path | None, **options: object) -> "Settings":
    """Return the settings of the environment, overridden by the options that are not None.

    An unusable setting is printed and ends the command.
    """
    from pydantic import ValidationError  # noqa: PLC0415  slow import

    from acromion.app.settings import Settings  # noqa: PLC0415

    given = {name: value for name, value in (options | {"data_dir": data}).items() if value is not None}
    try:
        return Settings(**given)  # type: ignore[arg-type]
    except ValidationError as error:
        wrong = error.errors(include_url=False)[0]
        name, allowed = f"ACROMION_{wrong['loc'][0]}".upper(), wrong["msg"].removeprefix("Value error, ")
        refusal = BadParameter(name=name, allowed=allowed)  # the value may contain a password
        print_problem("acromion", refusal.code, refusal.facts, "en")
        raise typer.Exit(Exit.USAGE) from None


def print_sentence(language: Language, command: str, sentence: str, /, **facts: str) -> None:
    """Print a sentence of a command with its values."""
    shown = {name: escape_controls(fact) for name, fact in facts.items()}
    typer.echo(fill(load_wording(language, "operations")[command][sentence], shown))


@contextmanager
def _printing_refusals(language: Language, settings: "Settings") -> Iterator[None]:
    """Print a refusal and exit with its code."""
    from sqlalchemy.exc import SQLAlchemyError  # noqa: PLC0415  slow import

    from acromion.app.library.database.connect import translate_start_errors  # noqa: PLC0415

    try:
        with translate_start_errors(settings):
            yield
    except AppError as refusal:
        _print_refusal(refusal, language)
    except SQLAlchemyError:
        _print_refusal(DatabaseAway(), language)
    except OSError as error:  # of the backup file
        _print_refusal(BackupRefused(why=f"{error.filename or ''} {error.strerror}".strip()), language)


def _print_refusal(refusal: AppError, language: Language) -> None:
    words = describe_problem(refusal.code, refusal.facts, language)
    typer.echo(f"{refusal.code} {words.title}\n  {words.detail}\n  {words.fix}", err=True)
    raise typer.Exit(Exit.NOTHING_DONE) from None


# The audit log, retention, holds; and original recordings.


MAX_SHOWN = 1000

trail = typer.Typer(help="The audit log: who did what.", no_args_is_help=True)
hold = typer.Typer(help="Protect a recording from deletion.", no_args_is_help=True)


@trail.command("show")
def show_trail(
    subject: Annotated[str, typer.Option(help="Show entries about the recordings of this subject.")] = "",
    recording: Annotated[
        str, typer.Option(metavar="ID", help="Show entries about this recording, also if it was erased.")
    ] = "",
    who: Annotated[
        str, typer.Option(metavar="ID", help="Show entries of this person, token or command line.")
    ] = "",
    begin: Annotated[
        str, typer.Option("--from", metavar="TIME", help="ISO 8601; UTC if it has no time zone.")
    ] = "",
    end: Annotated[str, typer.Option("--to", metavar="TIME")] = "",
    form: Annotated[
        str, typer.Option(help="text, csv or jsonl; csv and jsonl contain all entries.")
    ] = "text",
    data: DataOption = None,
    lang: LanguageOption = "en",
) -> None:
    """Show audit log entries of a subject, recording or person in a time range, newest first."""
    from acromion.app.library.audit_log import AuditFilter, find_lines, record_alone  # noqa: PLC0415
    from acromion.app.library.recordings import RecordingStore  # noqa: PLC0415

    for option, value in (("--subject", subject), ("--recording", recording), ("--who", who)):
        if not value.isprintable():  # invalid bytes, which databases refuse
            raise typer.BadParameter("unprintable characters", param_hint=option)
    with _opened(lang, data) as (_, store):
        ids = frozenset({recording}) if recording else None
        if subject and ids is None:
            ids = RecordingStore(store.engine, store.reader).find_of_subject(subject)
        question = AuditFilter(ids, who, "", _read_moment(begin), _read_moment(end))
        record_alone(store.engine, "trail.read")
        _print_lines(
            form, map(asdict, find_lines(store.reader, question, most=MAX_SHOWN * (form == "text"))), lang
        )


@hold.command("begin")
def begin_hold(
    recording: Annotated[str, typer.Argument(metavar="RECORDING")],
    reason: Annotated[str, typer.Option(help="legal, complaint, insurance, study or other")] = "legal",
    data: DataOption = None,
    lang: LanguageOption = "en",
) -> None:
    """Put a recording on hold, so that it cannot be permanently deleted."""
    from acromion.app.library.audit_log import AT_MACHINE  # noqa: PLC0415
    from acromion.app.library.recordings import HOLD_REASONS, RecordingStore  # noqa: PLC0415

    with _opened(lang, data) as (_, store):
        code = next((one for one in HOLD_REASONS if one == reason), None)
        if code is None:
            raise BadParameter(name="reason", value=reason[:20], allowed=", ".join(HOLD_REASONS))
        RecordingStore(store.engine, store.reader).hold(recording, code, AT_MACHINE)
    print_sentence(lang, "trail", "held", id=recording)


@hold.command("end")
def end_hold(
    recording: Annotated[str, typer.Argument(metavar="RECORDING")],
    data: DataOption = None,
    lang: LanguageOption = "en",
) -> None:
    """End the hold of a recording."""
    from acromion.app.library.recordings import RecordingStore  # noqa: PLC0415

    with _opened(lang, data) as (_, store):
        RecordingStore(store.engine, store.reader).release_hold(recording)
    print_sentence(lang, "trail", "let_go", id=recording)


def get(
    recording: Annotated[
        str, typer.Argument(metavar="ID", help="Id of the recording, or of one of its analyses.")
    ],
    out: Annotated[Path, typer.Option("-o", "--out", metavar="FILE", help="File to write.")],
    force: Annotated[bool, typer.Option("--force", help="Replace FILE.")] = False,
    data: DataOption = None,
    lang: LanguageOption = "en",
) -> None:
    """Write the original file of a recording, byte for byte, verified by its SHA-256."""
    from acromion.app.library.audit_log import record_readings  # noqa: PLC0415
    from acromion.app.library.recordings import RecordingStore  # noqa: PLC0415  loads the database
    from acromion.app.store.folder import borrow_recording, open_storage  # noqa: PLC0415

    if out.exists() and not (force and out.is_file()):
        raise typer.BadParameter(f"{out} exists", param_hint="-o")
    if not recording.isprintable():  # invalid bytes, which databases refuse
        raise typer.BadParameter("unprintable characters", param_hint="ID")
    with _opened(lang, data) as (place, store):
        recording_id = store.find_recording(recording) or recording
        row = RecordingStore(store.engine, store.reader).get(recording_id)
        storage = open_storage(place)
        storage.prepare()
        with borrow_recording(storage, row.id, row.sha256) as source:
            record_readings(store.engine, "file.exported", [(row.id, "")], {"command": "get"})
            try:
                _copy_verified(source, out, row.sha256)
            except OSError as error:
                print_problem(str(out), UNREADABLE_PATH, {"why": error.strerror or ""}, lang)
                raise typer.Exit(Exit.NOTHING_DONE) from None
    facts = {"name": row.about.file_name, "file": str(out), "sha256": row.sha256}
    print_sentence(lang, "trail", "got", **facts)


def _copy_verified(source: Path, out: Path, sha256: str) -> None:
    """Copy a file completely or not at all, readable only by its owner. Raises DiskFull or StoreDamaged."""
    from acromion.app.store.folder import COPY_BYTES, sync_file, translate_disk_full  # noqa: PLC0415
    from acromion.app.store.permissions import create_file  # noqa: PLC0415

    part, copied = out.with_name(f".{secrets.token_hex(8)}.part"), hashlib.sha256()
    try:
        with translate_disk_full():
            with source.open("rb") as stored, create_file(part) as file:
                while piece := stored.read(COPY_BYTES):
                    copied.update(piece)
                    file.write(piece)
            sync_file(part)
        if copied.hexdigest() != sha256:
            raise StoreDamaged
        part.replace(out)
    finally:
        part.unlink(missing_ok=True)


def retention(
    kind: Annotated[str, typer.Argument(metavar="[KIND]", help="recordings, results, trash, trail")] = "",
    days: Annotated[str, typer.Argument(metavar="[DAYS]", help='Days of running time, or "never".')] = "",
    now: Annotated[
        bool, typer.Option("--now", help="Apply a shorter term at once, not after 7 days.")
    ] = False,
    data: DataOption = None,
    lang: LanguageOption = "en",
) -> None:
    """Show how long each kind is kept, or change the term of one."""
    from acromion.app.library.governance import DAY_S, GRACE_DAYS, RetentionStore  # noqa: PLC0415

    with _opened(lang, data) as (settings, store):
        terms = RetentionStore(store.engine, store.reader)
        if kind:
            if days != "never" and (not days.isdecimal() or len(days) > 6):
                raise BadParameter(name="days", value=days[:20], allowed="1, 2, 3 …, never")
            term = None if days == "never" else int(days)
            if count := terms.count_due(kind, term):
                print_sentence(lang, "trail", "due", count=str(count), days="0" if now else str(GRACE_DAYS))
            terms.put(kind, term, now=now)
        for name, number in terms.find_all().items():
            what = load_wording(lang, "trail")["terms"][name]
            sentence, shown = ("for_good", "") if number is None else ("term", str(number))
            if name == "trash" and number is None:
                sentence, shown = "server_term", f"{settings.trash_term_s / DAY_S:g}"
            print_sentence(lang, "trail", sentence, what=what, days=shown)


def _read_moment(text: str) -> str:
    from acromion.app.library.audit_log import parse_moment  # noqa: PLC0415

    try:
        return parse_moment(text)
    except ValueError:
        raise BadParameter(name="time", value=text[:40], allowed="2026-11-23T07:00") from None


def _print_lines(form: str, lines: Iterator[dict[str, str | int]], language: Language) -> None:
    from acromion.app.library.audit_log import AUDIT_COLUMNS  # noqa: PLC0415

    if form not in ("text", "csv", "jsonl"):
        raise BadParameter(name="form", value=form[:20], allowed="text, csv, jsonl")
    acts, names = load_wording(language, "trail")["act"], load_wording(language, "trail")["who"]
    if form == "csv":
        typer.echo(",".join(AUDIT_COLUMNS))
    for line in lines:
        if form == "jsonl":
            typer.echo(json.dumps(line))
        elif form == "csv":
            typer.echo(",".join(_quote(str(value)) for value in line.values()))
        else:
            who, act = str(line["who"]), str(line["act"])
            about = (line["recording_id"], line["analysis_id"], line["other"])
            parts = (line["seq"], line["at"], names.get(who, who), acts[act.replace(".", "_")], *about)
            typer.echo("  ".join(map(str, parts)).rstrip())


def _quote(value: str) -> str:
    return '"' + value.replace('"', '""') + '"' if '"' in value or "," in value else value


@contextmanager
def _opened(language: Language, data: Path | None) -> "Iterator[tuple[Settings, JobStore]]":
    """Open the database for a command; without a database, raise NotHere."""
    from acromion.app.library.audit_log import AT_MACHINE, acting  # noqa: PLC0415
    from acromion.app.library.database.connect import find_database_file  # noqa: PLC0415
    from acromion.app.library.jobs import JobStore  # noqa: PLC0415
    from acromion.app.ops.place import check_used  # noqa: PLC0415

    settings = load_settings(data)
    with _printing_refusals(language, settings), acting(AT_MACHINE):
        check_used(settings)
        file = find_database_file(settings.database_url)
        if file and not Path(file).exists():
            raise NotHere(id=str(settings.data_dir))
        with closing(JobStore(settings)) as store:
            yield settings, store


# Accounts.


account = typer.Typer(help="People who can sign in: their roles, links and tokens.", no_args_is_help=True)

LoginArgument = Annotated[str, typer.Argument(metavar="LOGIN")]
PasswordOption = Annotated[
    bool, typer.Option("--password", help="Ask for a password now instead of printing a link.")
]
RolesOption = Annotated[list[str], typer.Option("--role", metavar="|".join(ROLES), help="Can be repeated.")]


@dataclass(frozen=True, slots=True)
class _AccountCommand:
    """The accounts of an installation, and the language of messages."""

    sign_in: "SignIn"
    language: Language

    def print(self, sentence: str, **facts: str) -> None:
        shown = {name: escape_controls(fact) for name, fact in facts.items()}
        typer.echo(fill(load_wording(self.language, "access")["command"][sentence], shown))

    def find(self, login: str) -> "Person":
        person = self.sign_in.accounts.find_person(login)
        if person is None:
            raise NotHere(id=login)
        return person

    def print_link(self, person: "Person", term_s: float) -> None:
        link = f"/login/link/{self.sign_in.make_link(person.id, term_s)}"
        self.print("link", hours=str(int(term_s // 3600)), link=link)
        self.print("link_path")

    def ask_password(self, person: "Person") -> None:
        """Read a password from the terminal, typed twice, or from a line of standard input."""
        words = load_wording(self.language, "access")["command"]
        if sys.stdin.isatty():
            password = typer.prompt(str(words["ask"]), hide_input=True, confirmation_prompt=True)
        else:
            password = sys.stdin.readline().rstrip("\r\n")
        self.sign_in.check_password(person, password)
        self.sign_in.set_password(person, password)
        self.print("password", login=person.login)


@account.command()
def add(
    login: LoginArgument,
    role: RolesOption,
    name: Annotated[str, typer.Option(help="Name of the person; default: LOGIN.")] = "",
    password: PasswordOption = False,
    data: DataOption = None,
    lang: LanguageOption = "en",
) -> None:
    """Add a person and print a one-time link for setting a password."""
    from acromion.app.accounts.sign_in import INVITED_S  # noqa: PLC0415  loads the database

    with _open(data, lang, may_begin=True) as command:
        roles = frozenset(_read_known("--role", role, ROLES))
        person = command.sign_in.accounts.add_person(login, name or login, roles)
        command.print("added", login=person.login, roles=", ".join(sorted(roles)))
        if password:
            command.ask_password(person)
        else:
            command.print_link(person, INVITED_S)


@account.command("list")
def list_people(data: DataOption = None, lang: LanguageOption = "en") -> None:
    """List the people."""
    with _open(data, lang) as command:
        command.sign_in.accounts.record_people_read()
        words = load_wording(lang, "access")
        for person in command.sign_in.accounts.find_people():
            state = words["ended"] if person.ended_at else words["command"]["open"]
            about = {"id": person.id, "login": person.login, "name": person.name, "state": state}
            roles = ", ".join(sorted(person.roles))
            command.print("person", roles=roles, **about)


@account.command()
def roles(
    login: LoginArgument, role: RolesOption, data: DataOption = None, lang: LanguageOption = "en"
) -> None:
    """Set the roles of a person, replacing the earlier ones."""
    with _open(data, lang) as command:
        given = frozenset(_read_known("--role", role, ROLES))
        command.sign_in.accounts.set_roles(command.find(login).id, given)
        command.print("roles", login=login, roles=", ".join(sorted(given)))


@account.command()
def reset(
    login: LoginArgument,
    password: PasswordOption = False,
    second_factor: Annotated[
        bool, typer.Option("--second-factor", help="Also reset two-factor sign-in, if the phone is lost.")
    ] = False,
    data: DataOption = None,
    lang: LanguageOption = "en",
) -> None:
    """Print a one-time link, valid for an hour, for setting a new password."""
    from acromion.app.accounts.sign_in import FORGOTTEN_S  # noqa: PLC0415  loads the database

    with _open(data, lang) as command:
        person = command.find(login)
        command.sign_in.forget_tries(person)
        if second_factor:
            command.sign_in.drop_second_factor(person.id)
            command.print("second", login=person.login)
        if password:
            command.ask_password(person)
        else:
            command.print_link(person, FORGOTTEN_S)


@account.command()
def end(login: LoginArgument, data: DataOption = None, lang: LanguageOption = "en") -> None:
    """Close an account; its sessions and tokens end at once."""
    with _open(data, lang) as command:
        command.sign_in.accounts.end_person(command.find(login).id)
        command.print("ended", login=login)


@account.command()
def token(
    login: LoginArgument,
    name: Annotated[str, typer.Option(help="What the token is for.")],
    permission: Annotated[
        list[str], typer.Option("--may", metavar="PERMISSION", help=", ".join(PERMISSIONS))
    ],
    days: Annotated[int, typer.Option(min=1, max=365)] = 90,
    data: DataOption = None,
    lang: LanguageOption = "en",
) -> None:
    """Create a token for a person's scripts; it is printed once."""
    from acromion.app.accounts.accounts import format_end, make_token  # noqa: PLC0415  loads the database

    with _open(data, lang) as command:
        person, chosen = command.find(login), _read_known("--may", permission, PERMISSIONS)
        may = collect_permissions(person.roles)
        subject = Subject("person", person.id, person.name, may)
        made, bearer = make_token(command.sign_in.accounts, subject, name, chosen, days)
        typer.echo(bearer)
        command.print("token_once", end=format_end(made))


def _read_known(option: str, given: list[str], known: Collection[T]) -> list[T]:
    """Return the given values if all are known. Raises BadParameter."""
    if not set(given) <= set(known):
        raise BadParameter(name=option, value=", ".join(given), allowed=", ".join(map(str, known)))
    return [next(one for one in known if one == name) for name in given]


@contextmanager
def _open(data: DataOption, lang: Language, *, may_begin: bool = False) -> Iterator[_AccountCommand]:
    """Open the accounts; with ``may_begin``, the data folder may be new."""
    from acromion.app.accounts.accounts import AccountStore  # noqa: PLC0415  loads the database
    from acromion.app.accounts.sign_in import SignIn  # noqa: PLC0415
    from acromion.app.library.audit_log import AT_MACHINE, acting  # noqa: PLC0415
    from acromion.app.ops.place import check_used  # noqa: PLC0415
    from acromion.app.store.permissions import make_folder  # noqa: PLC0415

    settings = load_settings(data)
    with _printing_refusals(lang, settings):
        if not may_begin:
            check_used(settings)
        make_folder(settings.data_dir)
        accounts = AccountStore(settings)
        try:
            with acting(AT_MACHINE):
                yield _AccountCommand(SignIn(accounts, settings), lang)
        finally:
            accounts.database.close()
