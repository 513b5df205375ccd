"""The command ``acromion validate``: how far a recording agrees with a reference."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Annotated, NoReturn, TypeVar

import typer

from app.errors import find_outcome
from app.report.messages import describe_problem
from app.request import (
    SUBJECT_ALLOWED,
    WINDOW_ALLOWED,
    Language,
    Reference,
    ReportRequest,
    check_subject,
    list_window_counts,
    parse_window,
)
from fusion.choices import MethodName, Pose, Side
from fusion.errors import Fact, FusionError
from fusion.task_windows import TaskWindow, read_tasks

T = TypeVar("T")


def validate(
    path: Annotated[
        Path,
        typer.Argument(metavar="FILE", help="A recording; or a folder of a whole study (docs/validate.md)."),
    ],
    reference: Annotated[
        Path | None,
        typer.Option(
            metavar="REF", help="MVNX, MT Manager, DOT, a CSV of angle or quaternion, elevation.parquet."
        ),
    ] = None,
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for the results.")] = Path(
        "acromion-validation"
    ),
    tasks: Annotated[
        Path | None, typer.Option(metavar="FILE.csv", help="name,start_s,end_s[,paper_task].")
    ] = None,
    side: Annotated[Side | None, typer.Option(help="Which arm of an MVNX (right if not said).")] = None,
    subject: Annotated[str, typer.Option(help="Subject code; never a name.")] = "",
    method: Annotated[MethodName, typer.Option(help="How elevation is estimated.")] = "smoothed",
    pose: Annotated[Pose, typer.Option(help="The pose the wearer was calibrated in.")] = "n-pose",
    calibration: Annotated[
        list[str] | None, typer.Option(metavar="START_S,END_S", help="When the arm hung still.")
    ] = None,
    offset_s: Annotated[float | None, typer.Option(help="Reference clock at recording time 0.")] = None,
    drift_ppm: Annotated[
        float | None, typer.Option(help="How much faster the reference's clock runs.")
    ] = None,
    rate_hz: Annotated[float | None, typer.Option(min=1, max=10_000, help="For a FILE without time.")] = None,
    reference_rate_hz: Annotated[
        float | None, typer.Option(min=1, max=10_000, help="For a REF without time.")
    ] = None,
    lang: Annotated[Language, typer.Option("--lang", help="Language of the report.")] = "en",
) -> None:
    """Compare a recording with a reference angle or orientation: r, RMSE, bias, limits of agreement."""
    request = ReportRequest(
        path.name,
        _parse(check_subject, subject, "--subject", SUBJECT_ALLOWED),
        side,
        method,
        pose,
        tuple(_parse(parse_window, text, "--calibration", WINDOW_ALLOWED) for text in calibration or ()),
        rate_hz,
        (lang,),
    )
    if path.is_dir():
        _study(path, request, out)
    if reference is None:
        raise typer.BadParameter("needed, unless FILE is the folder of a study", param_hint="--reference")
    _check_windows(request)
    given = Reference(str(reference.resolve()), reference.name, offset_s, drift_ppm, reference_rate_hz)
    given = replace(given, tasks=_read_tasks(tasks, lang))
    with _telling(path.name, lang):
        _compare(path, replace(request, reference=given), out)
    answer = (out / "answer.txt").read_text("utf-8").splitlines()
    typer.echo("\n  ".join((f"{path.name} -> {out}", *answer)))


def _compare(path: Path, request: ReportRequest, out: Path) -> None:
    """Take the one road."""
    from app.agreement_workflow import make_validation  # noqa: PLC0415  heavy, and only this needs it

    out.mkdir(parents=True, exist_ok=True)
    make_validation(path, request, out)
    _use_plain_names(out, request)


def _study(path: Path, request: ReportRequest, out: Path) -> NoReturn:
    """Compare a whole folder; what failed is told, and shows in the exit code."""
    from app.study_workflow import make_study  # noqa: PLC0415

    language = request.languages[0]
    with _telling(str(path), language):
        out.mkdir(parents=True, exist_ok=True)
        outcome = make_study(path, request, out, typer.echo)
        _use_plain_names(out, request)
    for problem in outcome.problems:
        print_problem(problem.name, problem.code, problem.facts, language)
    typer.echo(f"{path} -> {(out / 'study.html').resolve()}")
    raise typer.Exit(1 if outcome.problems else 0)


def _use_plain_names(out: Path, request: ReportRequest) -> None:
    """The report in the language asked for is ``validation.html`` or ``study.html``."""
    for made in out.glob(f"*.{request.languages[0]}.*"):
        made.replace(out / f"{made.name.partition('.')[0]}{made.suffix}")


def _read_tasks(path: Path | None, language: Language) -> tuple[TaskWindow, ...]:
    """Read the tasks before any recording, so that a slip in them is told at once."""
    if path is None:
        return ()
    with _telling(path.name, language, code=2):
        return read_tasks(path.read_bytes())


def _parse(read: Callable[[str], T], text: str, option: str, allowed: str) -> T:
    try:
        return read(text)
    except ValueError:
        raise typer.BadParameter(f"write {allowed}", param_hint=option) from None


def _check_windows(request: ReportRequest) -> None:
    if len(request.calibration_windows_s) not in list_window_counts(request.pose):
        needed = " or ".join(map(str, list_window_counts(request.pose)))
        raise typer.BadParameter(f"{request.pose} takes {needed} windows", param_hint="--calibration")


@contextmanager
def _telling(name: str, language: Language, code: int | None = None) -> Iterator[None]:
    """Tell a refusal in words and leave with the exit code of its kind, or with ``code``."""
    try:
        yield
    except FusionError as refusal:
        print_problem(name, refusal.code, refusal.facts, language)
        raise typer.Exit(code or find_outcome(type(refusal)).exit_code) from None
    except OSError as error:
        print_problem(name, "E-FILE", {"why": error.strerror or ""}, language)
        raise typer.Exit(code or 3) from None


def print_problem(name: str, code: str, facts: Mapping[str, Fact], language: Language) -> None:
    """Write a refusal for people, to the error stream."""
    problem = describe_problem(code, facts, language)
    typer.echo(f"{name}: {code} {problem.title}\n  {problem.detail}\n  {problem.fix}", err=True)
