"""The commands of trust: the audit log, terms, holds; and the original of a recording."""

import hashlib
import json
import secrets
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from app.cli.admin import (
    DataOption,
    LanguageOption,
    find_settings,
    print_sentence,
    refusals_printed,
)
from app.cli.output import Exit, print_problem
from app.errors import UNREADABLE_PATH, BadParameter, NotHere, StoreDamaged
from app.report.words.wording import Language, load_wording

if TYPE_CHECKING:
    from app.jobs.recordings import RecordingStore
    from app.jobs.store import JobStore
    from app.settings import Settings

MOST_SHOWN = 1000

trail = typer.Typer(help="The audit log: who did what.", no_args_is_help=True)
hold = typer.Typer(help="Keep a recording whatever happens.", no_args_is_help=True)


@trail.command("show")
def show_trail(
    subject: Annotated[str, typer.Option(help="Who touched this subject's recordings.")] = "",
    recording: Annotated[str, typer.Option(metavar="ID", help="An erased one, too.")] = "",
    who: Annotated[str, typer.Option(metavar="ID", help="What did this person, token or machine do.")] = "",
    begin: Annotated[str, typer.Option("--from", metavar="TIME", help="ISO 8601; without a zone UTC.")] = "",
    end: Annotated[str, typer.Option("--to", metavar="TIME")] = "",
    form: Annotated[str, typer.Option(help="text, csv or jsonl; the last two give every line.")] = "text",
    data: DataOption = None,
    lang: LanguageOption = "en",
) -> None:
    """Answer who touched a subject, or what somebody did, between two moments; the newest first."""
    from app.jobs.audit_log import AuditQuestion, find_lines  # noqa: PLC0415
    from app.jobs.recordings import RecordingStore  # noqa: PLC0415

    for option, value in (("--subject", subject), ("--recording", recording), ("--who", who)):
        if not value.isprintable():  # a broken byte of the terminal, which no database takes
            raise typer.BadParameter("signs that cannot be printed", param_hint=option)
    with _opened(lang, data) as (_, store):
        ids = frozenset({recording}) if recording else None
        if subject and ids is None:
            ids = RecordingStore(store.engine, store.reader).find_of_subject(subject)
        question = AuditQuestion(ids, who, "", _read_moment(begin), _read_moment(end))
        _record_asked(store)
        _print_lines(
            form, map(asdict, find_lines(store.reader, question, most=MOST_SHOWN * (form == "text"))), lang
        )


@hold.command("begin")
def begin_hold(
    recording: Annotated[str, typer.Argument(metavar="RECORDING")],
    reason: Annotated[str, typer.Option(help="legal, complaint, insurance, study or other")] = "legal",
    data: DataOption = None,
    lang: LanguageOption = "en",
) -> None:
    """Put a recording on hold: nothing of it is deleted for good."""
    from app.jobs.audit_log import AT_MACHINE  # noqa: PLC0415
    from app.jobs.recordings import HOLD_REASONS  # noqa: PLC0415

    with _opened_recordings(lang, data) as recordings:
        code = next((one for one in HOLD_REASONS if one == reason), None)
        if code is None:
            raise BadParameter(name="reason", value=reason[:20], allowed=", ".join(HOLD_REASONS))
        recordings.hold(recording, code, AT_MACHINE)
    print_sentence(lang, "trail", "held", id=recording)


@hold.command("end")
def end_hold(
    recording: Annotated[str, typer.Argument(metavar="RECORDING")],
    data: DataOption = None,
    lang: LanguageOption = "en",
) -> None:
    """End the hold of a recording."""
    with _opened_recordings(lang, data) as recordings:
        recordings.let_go(recording)
    print_sentence(lang, "trail", "let_go", id=recording)


def get(
    recording: Annotated[
        str, typer.Argument(metavar="ID", help="Of the recording, or of an analysis of it.")
    ],
    out: Annotated[Path, typer.Option("-o", "--out", metavar="FILE", help="The file to write.")],
    force: Annotated[bool, typer.Option("--force", help="Replace FILE.")] = False,
    data: DataOption = None,
    lang: LanguageOption = "en",
) -> None:
    """Write the original file of a recording, byte for byte, verified by its SHA-256."""
    from app.jobs.audit_log import record_readings  # noqa: PLC0415
    from app.jobs.recordings import RecordingStore  # noqa: PLC0415  the database, and only this needs it
    from app.storage.open import open_storage  # noqa: PLC0415
    from app.storage.store import borrow_recording  # noqa: PLC0415

    if out.exists() and not (force and out.is_file()):
        raise typer.BadParameter(f"{out} exists", param_hint="-o")
    if not recording.isprintable():  # a broken byte of the terminal, which no database takes
        raise typer.BadParameter("characters that cannot be printed", param_hint="ID")
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
    """Copy a file whole or not at all, readable by its owner alone. Raises DiskFull or StoreDamaged."""
    from app.storage.permissions import create_file  # noqa: PLC0415
    from app.storage.store import COPY_BYTES, sync_file, translate_disk_full  # noqa: PLC0415

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
    data: DataOption = None,
    lang: LanguageOption = "en",
) -> None:
    """Show how long each kind is kept, or change the term of one."""
    from app.jobs.governance.retention import RetentionStore  # noqa: PLC0415

    with _opened(lang, data) as (_, store):
        terms = RetentionStore(store.engine, store.reader)
        if kind:
            terms.put(kind, _read_days(days))
        for name, number in terms.find_all().items():
            sentence = "term" if number is not None else "for_good"
            what = load_wording(lang, "trail")["terms"][name]
            print_sentence(lang, "trail", sentence, what=what, days=str(number or ""))


def _read_days(text: str) -> int | None:
    if text == "never":
        return None
    if not text.isdecimal() or len(text) > 6:
        raise BadParameter(name="days", value=text[:20], allowed="1, 2, 3 …, never")
    return int(text)


def _read_moment(text: str) -> str:
    from app.jobs.audit_log import parse_moment  # noqa: PLC0415

    try:
        return parse_moment(text)
    except ValueError:
        raise BadParameter(name="time", value=text[:40], allowed="2026-11-23T07:00") from None


def _record_asked(store: "JobStore") -> None:
    from app.jobs.audit_log import record_alone  # noqa: PLC0415

    record_alone(store.engine, "trail.read")


def _print_lines(form: str, lines: Iterator[dict[str, str | int]], language: Language) -> None:
    from app.jobs.audit_log import AUDIT_COLUMNS  # noqa: PLC0415

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
    """Open the database for whoever sits at the machine; a place without one is refused."""
    from app.jobs.audit_log import AT_MACHINE, acting  # noqa: PLC0415
    from app.jobs.database.connect import find_database_file  # noqa: PLC0415
    from app.jobs.store import JobStore  # noqa: PLC0415
    from app.upkeep.place import check_used  # noqa: PLC0415

    settings = find_settings(data)
    with refusals_printed(language, settings), acting(AT_MACHINE):
        check_used(settings)
        file = find_database_file(settings.database_url)
        if file and not Path(file).exists():
            raise NotHere(id=str(settings.data_dir))
        with closing(JobStore(settings)) as store:
            yield settings, store


@contextmanager
def _opened_recordings(language: Language, data: Path | None) -> "Iterator[RecordingStore]":
    from app.jobs.recordings import RecordingStore  # noqa: PLC0415

    with _opened(language, data) as (_, store):
        yield RecordingStore(store.engine, store.reader)
