"""Options that commands share, and their parsers."""

import json
import sys
from collections.abc import Callable, Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import typer

from acromion.app.batch.doubles import mark_doubles
from acromion.app.batch.folder import PROFILES, Task, read_list
from acromion.app.batch.inputs import (
    Participant,
    assign_participants,
    list_diaries,
    read_checked_diary,
    read_postures,
)
from acromion.app.batch.run import SHARD_HINT, Shard, parse_shard
from acromion.app.cli.output import Exit, print_problem
from acromion.app.errors import UNREADABLE_PATH, AppError, UnusableList
from acromion.app.request import (
    ISCO_HINT,
    SHIFT_HINT,
    SLIP_HINT,
    SUBJECT_HINT,
    WINDOW_HINT,
    Language,
    Paper,
    ReportKind,
    ReportRequest,
    check_hours,
    check_isco,
    check_job_title,
    check_subject,
    find_window_hint,
    parse_slip_time,
    parse_window,
    write_profile,
)
from acromion.fusion.clocks import OFFSET_HINT, parse_clock_offset, parse_time_zone
from acromion.fusion.conventions import AXIS_HINT, ArmAxis, PoseHeld, Side, parse_arm_axis
from acromion.fusion.diary import DiaryEntry, TaskWindow, read_tasks
from acromion.fusion.errors import FusionError

T = TypeVar("T")

Out = Annotated[Path, typer.Option("-o", "--out", help="Folder for the results.")]
SideOption = Annotated[Side | None, typer.Option(help="Which arm.")]
MinHoursOption = Annotated[
    float | None,
    typer.Option(
        min=0,
        max=24,
        help="Least analysed hours of a day that counts; quality plays no part  \\[default: 4]",
    ),
]
JobOption = Annotated[str, typer.Option("--job", help="Title of the person's job.")]
IscoOption = Annotated[
    str, typer.Option("--isco", metavar="CODE", help="Code of the job in ISCO-08, one to four digits.")
]
SubjectOption = Annotated[str, typer.Option("--subject", help="Subject code; never a name.")]
DiaryOption = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="CSV or .xlsx of shift, tasks, breaks, marks: start,end,kind,label (clock), or start_s,end_s.",
    ),
]
PostureOption = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="Activity per second of ActiPASS or acti-motus, or a recording of the thigh (.cwa, .csv).",
    ),
]
ProfileOption = Annotated[
    Path | None,
    typer.Option(
        "--profile",
        metavar="FILE.json|NAME",
        help="Meaning of a table's columns (docs/formats.md); a NAME is in profiles/ of the results.",
    ),
]
SensorOption = Annotated[
    str,
    typer.Option("--sensor", metavar="NAME", help="Sensor on the arm, if a table or zip has several."),
]
DateOrderOption = Annotated[
    Literal["dmy", "mdy"] | None,
    typer.Option("--date-order", help="Order of day, month and year in dates that can be read both ways."),
]
PoseHeldOption = Annotated[
    PoseHeld | None,
    typer.Option(
        "--pose-held",
        help="The pose was held at the start of wear; no: not held, even if the file states it.",
    ),
]
TimeZoneOption = Annotated[
    str,
    typer.Option(
        "--time-zone", metavar="ZONE", help="Zone of clock times, e.g. Europe/Paris  \\[default: the file's]"
    ),
]
ClockOffsetOption = Annotated[
    str,
    typer.Option(
        "--clock-offset",
        metavar="±H:MM:SS",
        help="Added to the device's clock, if it was wrong: -1h02m, -1:02:00 or -3720 (s).",
    ),
]
PaperOption = Annotated[Paper, typer.Option(help="Paper of the PDF.")]
LanguageOption = Annotated[
    Language, typer.Option("--lang", help="Language of the report; fr-CA: French of Québec.")
]


def read_diary_file(path: Path | None, language: Language) -> tuple[DiaryEntry, ...]:
    """Read the diary; called before any recording is read, so that errors in it are reported at once."""
    return _read_option_file(path, language, (), lambda file: read_checked_diary(file.read_bytes()))


def read_posture_file(path: Path | None, language: Language) -> tuple[DiaryEntry, ...]:
    """Read a file of postures, as rows of a diary."""
    return _read_option_file(path, language, (), read_postures)


def resolve_profile(path: Path | None, out: Path) -> Path | None:
    """Return the path of a column profile: a file, or a name in ``profiles/`` of the results."""
    if path is None or path.exists():
        return path
    kept = out / PROFILES / f"{path.name.removesuffix('.json')}.json"
    return kept if kept.exists() and len(path.parts) == 1 else path


def read_profile_file(path: Path | None, language: Language) -> str:
    """Read the column profile; called before any recording is read, so that errors are reported at once."""
    if path is None:
        return ""
    from acromion.fusion.readers import parse_profile  # noqa: PLC0415  slow import

    def parse(file: Path) -> str:
        return write_profile(asdict(parse_profile(file.read_text("utf-8", errors="replace"))))

    return _read_option_file(path, language, "", parse)


def complete_profile(profile: str, sensor: str, date_order: str | None) -> str:
    """Add the sensor on the arm and the order of dates to a request's column profile."""
    stated = {name: value for name, value in (("sensor", sensor), ("date_order", date_order)) if value}
    return write_profile(json.loads(profile or "{}") | stated) if stated else profile


def save_profile(path: Path | None, out: Path) -> None:
    """Copy a used profile to ``profiles/`` of the results, so that later runs can use its name."""
    if path is not None:
        kept = out / PROFILES / f"{path.stem}.json"
        content = path.read_bytes()
        if not kept.exists() or kept.read_bytes() != content:
            kept.parent.mkdir(parents=True, exist_ok=True)
            kept.write_bytes(content)


def read_settings_file(path: Path | None, language: Language) -> dict[str, Any]:
    """Read a settings file; return the request fields that it sets."""
    if path is None:
        return {}
    from acromion.app.batch.settings_file import read_settings  # noqa: PLC0415  loads YAML

    return _read_option_file(path, language, {}, lambda file: read_settings(file.read_bytes()))


def read_diary_names(path: Path | None, language: Language) -> list[Path]:
    """Return the diaries and files of postures that the list of participants names."""
    return _read_option_file(path, language, [], lambda file: list_diaries(file.read_bytes(), file.parent))


def apply_participants_file(
    path: Path | None, tasks: list[Task], language: Language
) -> tuple[list[Task], list[Participant]]:
    """Return the tasks with the settings of the list of participants, and its rows that match no recording.

    Diaries are read from the folder of the list. Recordings that occur twice are marked.
    """

    def read(file: Path) -> tuple[list[Task], list[Participant]]:
        assigned, unmatched = assign_participants(tasks, file.read_bytes(), file.parent)
        return mark_doubles(assigned), unmatched

    return _read_option_file(path, language, None, read) or (mark_doubles(tasks), [])


def read_list_file(path: Path | None, language: Language) -> list[Path]:
    """Read a list of recordings; paths are relative to the list (standard input: to the current folder)."""
    if path == Path("-"):
        return _read_option_file(path, language, [], lambda _: read_list(sys.stdin.read(), Path()))
    return _read_option_file(
        path, language, [], lambda file: read_list(file.read_text("utf-8-sig"), file.parent)
    )


def read_tasks_file(path: Path | None, language: Language) -> tuple[TaskWindow, ...]:
    """Read the tasks of a comparison."""
    return _read_option_file(path, language, (), lambda file: read_tasks(file.read_bytes()))


def _read_option_file(path: Path | None, language: Language, nothing: T, read: Callable[[Path], T]) -> T:
    """Read a file named by an option; an unusable file is a usage error with a printed fix."""
    if path is None:
        return nothing
    try:
        return read(path)
    except (FusionError, AppError) as refusal:
        print_problem(str(refusal.facts.get("diary", path.name)), refusal.code, refusal.facts, language)
    except OSError as error:
        print_problem(path.name, UNREADABLE_PATH, {"why": error.strerror or ""}, language)
    except UnicodeDecodeError:
        print_problem(path.name, UnusableList.code, {"why": "not text"}, language)
    raise typer.Exit(Exit.USAGE)


def _parse(option: str, hint: str, read: Callable[[], T]) -> T:
    """Parse a value; an invalid value is a usage error."""
    try:
        return read()
    except ValueError:
        raise typer.BadParameter(f"write {hint}", param_hint=option) from None


def parse_job(text: str) -> str:
    """Check the job title."""
    return _parse("--job", SUBJECT_HINT, lambda: check_job_title(text))


def parse_isco(text: str) -> str:
    """Check the code of the job."""
    return _parse("--isco", ISCO_HINT, lambda: check_isco(text))


def parse_subject(text: str) -> str:
    """Check the subject code."""
    return _parse("--subject", SUBJECT_HINT, lambda: check_subject(text))


def parse_windows(texts: list[str] | None) -> tuple[tuple[float, float], ...]:
    """Parse the calibration windows."""
    return _parse("--calibration", f"{WINDOW_HINT}, e.g. 5,15", lambda: tuple(map(parse_window, texts or ())))


def parse_axis(text: str | None) -> ArmAxis | None:
    """Parse the sensor axis that points along the arm."""
    return _parse("--axis", AXIS_HINT, lambda: None if text is None else parse_arm_axis(text))


def parse_zone(text: str) -> str:
    """Parse the time zone of clock times; the error names the nearest zones."""
    try:
        return parse_time_zone(text)
    except ValueError as error:
        problem = f"{text!r} is not a known time zone: write {error}"
        raise typer.BadParameter(problem, param_hint="--time-zone") from None


def parse_offset(text: str) -> float:
    """Parse the correction of the device's clock, in s."""
    return _parse("--clock-offset", OFFSET_HINT, lambda: parse_clock_offset(text) if text else 0.0)


def parse_shard_option(text: str | None) -> Shard | None:
    """Parse the slice of the recordings to analyse; None for all."""
    return _parse("--shard", f"{SHARD_HINT}, e.g. 3/8", lambda: None if text is None else parse_shard(text))


def parse_slip_times(texts: list[str] | None, option: str) -> tuple[float, ...]:
    """Parse times at which the sensor did or did not slip."""
    return _parse(option, f"{SLIP_HINT}, e.g. 14400", lambda: tuple(map(parse_slip_time, texts or ())))


def parse_shift(text: str | None) -> str:
    """Parse the hours of the shifts; empty if the option is not given."""
    return _parse("--shift", SHIFT_HINT, lambda: check_hours(text) if text else "")


def check_windows(requests: Iterable[ReportRequest]) -> None:
    """Refuse, before any analysis, a number of windows that does not fit the pose or axis."""
    for request in requests:
        count = len(request.calibration_windows_s)
        hint = find_window_hint(request.pose, count, request.arm_axis)
        if hint:
            problem = f"{request.file_name}: {count} windows; {hint}"
            raise typer.BadParameter(problem, param_hint="--calibration")


def parse_kinds(text: str | None) -> tuple[ReportKind, ...]:
    """Parse the report formats, in a fixed order; empty if the option is not given."""
    kinds = {part.strip() for part in text.split(",")} if text is not None else set()
    known: tuple[ReportKind, ...] = ("html", "pdf")
    if kinds - set(known):
        raise typer.BadParameter(f"{text!r}: write html, pdf or html,pdf")
    return tuple(kind for kind in known if kind in kinds)
