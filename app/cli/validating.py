"""The command ``acromion validate``: how far a recording agrees with a reference."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Annotated, NoReturn

import typer

from app.batch.folder import use_plain_names
from app.cli.options import (
    LanguageOption,
    PaperOption,
    SubjectOption,
    check_windows,
    parse_windows,
    read_tasks_file,
    take_subject,
)
from app.cli.said import Exit, print_problem
from app.outcomes import find_outcome
from app.request import Language, Reference, ReportRequest
from fusion.choices import MethodName, Pose, Side
from fusion.errors import FusionError


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
    subject: SubjectOption = "",
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
    lang: LanguageOption = "en",
    paper: PaperOption = "a4",
) -> None:
    """Compare a recording with a reference angle or orientation: r, RMSE, bias, limits of agreement."""
    request = ReportRequest(
        path.name,
        take_subject(subject),
        side,
        method,
        pose,
        parse_windows(calibration),
        rate_hz,
        (lang,),
        paper=paper,
    )
    if path.is_dir():
        _study(path, request, out)
    if reference is None:
        raise typer.BadParameter("needed, unless FILE is the folder of a study", param_hint="--reference")
    check_windows([request])
    given = Reference(str(reference.resolve()), reference.name, offset_s, drift_ppm, reference_rate_hz)
    given = replace(given, tasks=read_tasks_file(tasks, lang))
    with _telling(path.name, lang):
        _compare(path, replace(request, reference=given), out)
    answer = (out / "answer.txt").read_text("utf-8").splitlines()
    typer.echo("\n  ".join((f"{path.name} -> {out}", *answer)))


def _compare(path: Path, request: ReportRequest, out: Path) -> None:
    """Take the one road."""
    from app.agreement_workflow import make_validation  # noqa: PLC0415  heavy, and only this needs it

    out.mkdir(parents=True, exist_ok=True)
    make_validation(path, request, out)
    use_plain_names(out, request.languages[0])


def _study(path: Path, request: ReportRequest, out: Path) -> NoReturn:
    """Compare a whole folder; what failed is told, and shows in the exit code."""
    from app.study_workflow import make_study  # noqa: PLC0415

    language = request.languages[0]
    with _telling(str(path), language):
        out.mkdir(parents=True, exist_ok=True)
        outcome = make_study(path, request, out, typer.echo)
        use_plain_names(out, request.languages[0])
    for problem in outcome.problems:
        print_problem(problem.name, problem.code, problem.facts, language)
    typer.echo(f"{path} -> {(out / 'study.html').resolve()}")
    raise typer.Exit(Exit.SOME_FAILED if outcome.problems else Exit.ALL_GOOD)


@contextmanager
def _telling(name: str, language: Language) -> Iterator[None]:
    """Tell a refusal in words and leave with the exit code of its kind."""
    try:
        yield
    except FusionError as refusal:
        print_problem(name, refusal.code, refusal.facts, language)
        raise typer.Exit(find_outcome(type(refusal)).exit_code) from None
    except OSError as error:
        print_problem(name, "E-FILE", {"why": error.strerror or ""}, language)
        raise typer.Exit(Exit.NOTHING_DONE) from None
