"""Commands that compare: both arms, two days, many days, a recording and a reference."""

from collections.abc import Iterable
from dataclasses import replace
from errno import ENOENT
from functools import partial
from os import strerror
from pathlib import Path
from typing import Annotated

import typer

from acromion.app.batch.folder import list_finished, plan_tasks, use_plain_names, write_version
from acromion.app.cli.options import (
    LanguageOption,
    MinHoursOption,
    Out,
    PaperOption,
    PoseHeldOption,
    SubjectOption,
    check_windows,
    parse_kinds,
    parse_subject,
    parse_windows,
    read_tasks_file,
)
from acromion.app.cli.output import Exit, choose_exit, print_problem, printing_refusals, report_progress
from acromion.app.errors import UNREADABLE_PATH, AppError, CannotCompare, CannotPair, CannotProfile
from acromion.app.request import (
    MIN_HOURS,
    PairClockSource,
    PairRequest,
    ProfileRequest,
    Reference,
    ReportRequest,
)
from acromion.fusion.conventions import MethodName, Pose, Side

_INPUT_HELP = "a folder written by acromion run, or a recording, which is analysed first."
SameSubjectOption = Annotated[
    bool, typer.Option("--same-subject", help="All are of one person, although a subject code is missing.")
]
MixedMethodsOption = Annotated[
    bool, typer.Option("--mixed-methods", help="Allow results of several method versions.")
]
KindsOption = Annotated[str, typer.Option("--report", help="Report formats: html, pdf or html,pdf.")]


def pair(
    left: Annotated[Path, typer.Argument(help=f"Left arm: {_INPUT_HELP}")],
    right: Annotated[Path, typer.Argument(help="Right arm: the same.")],
    out: Out,
    trunk: Annotated[Path | None, typer.Option(help="Trunk: the same.")] = None,
    offset_s: Annotated[
        float | None, typer.Option(help="When the right recording started, in seconds after the left.")
    ] = None,
    trunk_offset_s: Annotated[
        float | None,
        typer.Option(help="When the trunk's recording started, in seconds after the left arm's."),
    ] = None,
    clock: Annotated[
        PairClockSource,
        typer.Option(help="What gives the offsets not stated: the devices' clocks, or the shared movement."),
    ] = "devices",
    subject: SubjectOption = "",
    pose_held: PoseHeldOption = None,
    same_subject: SameSubjectOption = False,
    mixed_methods: MixedMethodsOption = False,
    lang: LanguageOption = "en",
    report: KindsOption = "html,pdf",
    paper: PaperOption = "a4",
) -> None:
    """Report both arms of one shift side by side."""
    kinds, code = parse_kinds(report), parse_subject(subject)
    asked = ReportRequest("", code, languages=(lang,), paper=paper, pose_held=pose_held)
    if not same_subject:
        _check_subject_codes(CannotPair(why="person"), (left, right, trunk), asked)
    first = _get_finished_folder(left, out / "left", replace(asked, side="left"))
    second = _get_finished_folder(right, out / "right", replace(asked, side="right"))
    body = (_get_finished_folder(trunk, out / "trunk", replace(asked, side="trunk")),) if trunk else ()
    offsets_s, asked_of = (offset_s, trunk_offset_s), (same_subject, mixed_methods)
    request = PairRequest("pair", *offsets_s, (lang,), kinds, paper, *asked_of, clock)
    _write_pair(out / "both-arms", (first, second, *body), request)


def compare(
    before: Annotated[Path, typer.Argument(help=f"Before: {_INPUT_HELP}")],
    after: Annotated[Path, typer.Argument(help="After: the same.")],
    out: Out,
    side: Annotated[Side | None, typer.Option(help="Which arm, for recordings.")] = None,
    subject: SubjectOption = "",
    pose_held: PoseHeldOption = None,
    same_subject: SameSubjectOption = False,
    mixed_methods: MixedMethodsOption = False,
    lang: LanguageOption = "en",
    report: KindsOption = "html,pdf",
    paper: PaperOption = "a4",
) -> None:
    """Compare two days, and report whether the change exceeds the usual day-to-day variation."""
    kinds = parse_kinds(report)
    code = parse_subject(subject)
    asked = ReportRequest("", code, side, languages=(lang,), paper=paper, pose_held=pose_held)
    if not same_subject:
        _check_subject_codes(CannotCompare(why="person"), (before, after), asked)
    first = _get_finished_folder(before, out / "before", asked)
    second = _get_finished_folder(after, out / "after", asked)
    request = PairRequest("compare", None, None, (lang,), kinds, paper, same_subject, mixed_methods)
    _write_pair(out / "before-after", (first, second), request)


def _check_subject_codes(refusal: AppError, paths: Iterable[Path | None], asked: ReportRequest) -> None:
    """Refuse recordings without a subject code before any analysis."""
    if not asked.subject and any(path and path.is_file() for path in paths):
        print_problem("--subject", refusal.code, refusal.facts, asked.languages[0])
        raise typer.Exit(Exit.NOTHING_DONE)


def _get_finished_folder(path: Path, out: Path, request: ReportRequest) -> Path:
    """Return the folder of a finished analysis; a recording is analysed first."""
    if path.is_dir():
        return path
    tasks = plan_tasks([path], out, request, force=False)
    if code := choose_exit(report_progress(tasks, 1)):
        raise typer.Exit(code)
    return tasks[0].folder


def _write_pair(folder: Path, sources: tuple[Path, ...], request: PairRequest) -> None:
    """Write the report of two analyses, and print its answer."""
    from acromion.app.analysis.pair import make_report_of_two  # noqa: PLC0415  slow import

    make = partial(make_report_of_two, sources, request)
    with printing_refusals(str(folder), request.languages[0]):
        marker = write_version(folder, request.figures_name, request.languages[0], make)
    _print_answer(folder.name, folder, marker.version)


def validate(
    path: Annotated[
        Path,
        typer.Argument(
            metavar="FILE", help="A recording, or the folder of a whole study (docs/validate.md)."
        ),
    ],
    reference: Annotated[
        Path | None,
        typer.Option(
            metavar="REF", help="MVNX, MT Manager, DOT, a CSV of angles or quaternions, or elevation.parquet."
        ),
    ] = None,
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for the results.")] = Path(
        "acromion-validation"
    ),
    tasks: Annotated[
        Path | None, typer.Option(metavar="FILE.csv", help="name,start_s,end_s[,paper_task].")
    ] = None,
    side: Annotated[Side | None, typer.Option(help="Which arm of an MVNX  \\[default: right]")] = None,
    subject: SubjectOption = "",
    method: Annotated[MethodName, typer.Option(help="How elevation is estimated.")] = "smoothed",
    pose: Annotated[Pose, typer.Option(help="Calibration pose of the wearer.")] = "n-pose",
    calibration: Annotated[
        list[str] | None, typer.Option(metavar="START_S,END_S", help="When the arm hung still.")
    ] = None,
    pose_held: PoseHeldOption = None,
    offset_s: Annotated[float | None, typer.Option(help="Reference clock at recording time 0.")] = None,
    drift_ppm: Annotated[float | None, typer.Option(help="How much faster the reference clock runs.")] = None,
    rate_hz: Annotated[
        float | None, typer.Option(min=1, max=10_000, help="Sampling rate, for a FILE without timestamps.")
    ] = None,
    reference_rate_hz: Annotated[
        float | None, typer.Option(min=1, max=10_000, help="Sampling rate, for a REF without timestamps.")
    ] = None,
    lang: LanguageOption = "en",
    paper: PaperOption = "a4",
) -> None:
    """Compare a recording with a reference angle or orientation: r, RMSE, bias, limits of agreement."""
    from acromion.app.analysis.validate import make_study, make_validation  # noqa: PLC0415  slow import

    request = ReportRequest(
        path.name,
        parse_subject(subject),
        side,
        method,
        pose,
        parse_windows(calibration),
        rate_hz,
        (lang,),
        paper=paper,
        pose_held=pose_held,
    )
    if path.is_dir():  # a whole study: print failures and set the exit code
        with printing_refusals(str(path), lang):
            out.mkdir(parents=True, exist_ok=True)
            problems = make_study(path, request, out, typer.echo)
            use_plain_names(out, lang)
        for problem in problems:
            print_problem(problem.name, problem.code, problem.facts, lang)
        typer.echo(f"{path} -> {(out / 'study.html').resolve()}")
        raise typer.Exit(Exit.SOME_FAILED if problems else Exit.ALL_GOOD)
    if reference is None:
        raise typer.BadParameter("required, unless FILE is the folder of a study", param_hint="--reference")
    check_windows([request])
    given = Reference(str(reference.resolve()), reference.name, offset_s, drift_ppm, reference_rate_hz)
    given = replace(given, tasks=read_tasks_file(tasks, lang))
    with printing_refusals(path.name, lang):
        out.mkdir(parents=True, exist_ok=True)
        make_validation(path, replace(request, reference=given), out)
        use_plain_names(out, lang)
    _print_answer(path.name, out)


def _print_answer(name: str, folder: Path, version: int = 1) -> None:
    typer.echo(f"{name} -> {folder}" + (f" (version {version})" if version > 1 else ""))
    for line in (folder / "answer.txt").read_text("utf-8").splitlines():
        typer.echo(f"  {line}")


# Several days.


def profile(
    results: Annotated[
        list[Path],
        typer.Argument(
            metavar="RESULTS...", help="Folders written by acromion run, or results.json in them."
        ),
    ],
    out: Out,
    after: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="RESULTS", help="Days after a change; can be repeated. RESULTS are the days before it."
        ),
    ] = None,
    min_hours: MinHoursOption = None,
    same_subject: SameSubjectOption = False,
    mixed_methods: MixedMethodsOption = False,
    lang: LanguageOption = "en",
    report: KindsOption = "html,pdf",
    paper: PaperOption = "a4",
) -> None:
    """Report the days of a person or group together: mean, spread, days still needed."""
    from acromion.app.analysis.pair import make_profile  # noqa: PLC0415  slow import

    kinds = parse_kinds(report)
    folder = out / "days"
    try:
        first, later = _find_all(results), _find_all(after or [])
        request = ProfileRequest(
            len(first) if after else None,
            (lang,),
            kinds,
            paper,
            same_subject,
            mixed_methods,
            min_hours=MIN_HOURS if min_hours is None else min_hours,
        )
        make = partial(make_profile, (*first, *later), request)
        marker = write_version(folder, request.figures_name, lang, make)
    except AppError as refusal:
        print_problem(folder.name, refusal.code, refusal.facts, lang)
        raise typer.Exit(Exit.NOTHING_DONE) from None
    except OSError as error:
        print_problem(error.filename or str(folder), UNREADABLE_PATH, {"why": error.strerror or ""}, lang)
        raise typer.Exit(Exit.NOTHING_DONE) from None
    _print_answer(folder.name, folder, marker.version)


def _find_all(paths: list[Path]) -> list[Path]:
    """Return the folders of finished analyses at or below the paths (:func:`list_finished`).

    Raises CannotProfile if a path contains none, or if all contain the same one. Raises FileNotFoundError if
    a path does not exist.
    """
    found: dict[Path, None] = {}
    for path in paths:
        if not path.exists():
            raise FileNotFoundError(ENOENT, strerror(ENOENT), str(path))
        folders = list_finished(path)
        if not folders:
            raise CannotProfile(why="kept", name=path.name)
        found |= dict.fromkeys(folder.resolve() for folder in folders)
    if len(found) == 1 and len(paths) > 1:
        raise CannotProfile(why="same", name=paths[0].name, other=paths[1].name)
    return list(found)
