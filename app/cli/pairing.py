"""Commands that set two analyses side by side: both arms of one shift, one day beside another."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from app.batch.folder import keep_versions
from app.batch.plan import plan_tasks
from app.cli.options import LanguageOption, Out, PaperOption, SubjectOption, parse_kinds, take_subject
from app.cli.said import Exit, choose_exit, print_problem, report_progress
from app.errors import AppError
from app.request import Language, ReportRequest
from fusion.choices import Side

_INPUT_HELP = "a folder that acromion run made, or a recording, which is analysed first."
KindsOption = Annotated[str, typer.Option("--report", help="What to write: html, pdf or html,pdf.")]


def pair(
    left: Annotated[Path, typer.Argument(help=f"Left arm: {_INPUT_HELP}")],
    right: Annotated[Path, typer.Argument(help="Right arm: likewise.")],
    out: Out,
    trunk: Annotated[Path | None, typer.Option(help="Trunk: likewise.")] = None,
    offset_s: Annotated[
        float | None, typer.Option(help="When the right recording began, seconds after the left.")
    ] = None,
    trunk_offset_s: Annotated[
        float | None, typer.Option(help="When the trunk's recording began, seconds after the left arm's.")
    ] = None,
    subject: SubjectOption = "",
    lang: LanguageOption = "en",
    report: KindsOption = "html,pdf",
    paper: PaperOption = "a4",
) -> None:
    """Set both arms of one shift side by side."""
    from app.pairing import PAIR, PairRequest, make_pair_report  # noqa: PLC0415  heavy

    kinds, code = parse_kinds(report), take_subject(subject)
    asked = ReportRequest("", code, languages=(lang,), paper=paper)
    first = _finish_first(left, out / "left", replace(asked, side="left"))
    second = _finish_first(right, out / "right", replace(asked, side="right"))
    body = _finish_first(trunk, out / "trunk", asked) if trunk else None
    request = PairRequest(body, offset_s, trunk_offset_s, (lang,), kinds, paper)
    _keep(out / "both-arms", PAIR, lang, partial(make_pair_report, first, second, request))


def compare(
    before: Annotated[Path, typer.Argument(help=f"Before: {_INPUT_HELP}")],
    after: Annotated[Path, typer.Argument(help="After: likewise.")],
    out: Out,
    side: Annotated[Side | None, typer.Option(help="Which arm, for recordings.")] = None,
    subject: SubjectOption = "",
    lang: LanguageOption = "en",
    report: KindsOption = "html,pdf",
    paper: PaperOption = "a4",
) -> None:
    """Set one day beside another, and say whether the change is larger than days differ anyway."""
    from app.pairing import COMPARISON, PairRequest, make_comparison_report  # noqa: PLC0415  heavy

    kinds = parse_kinds(report)
    asked = ReportRequest("", take_subject(subject), side, languages=(lang,), paper=paper)
    first = _finish_first(before, out / "before", asked)
    second = _finish_first(after, out / "after", asked)
    request = PairRequest(languages=(lang,), kinds=kinds, paper=paper)
    _keep(out / "before-after", COMPARISON, lang, partial(make_comparison_report, first, second, request))


def _finish_first(path: Path, out: Path, request: ReportRequest) -> Path:
    """Give the folder of a finished analysis: the one named, or that of the recording, once analysed."""
    if path.is_dir():
        return path
    tasks = plan_tasks([path], out, request, force=False)
    if code := choose_exit(report_progress(tasks, 1)):
        raise typer.Exit(code)
    return tasks[0].folder


def _keep(folder: Path, figures: str, language: Language, make: Callable[[Path], None]) -> None:
    try:
        marker = keep_versions(folder, figures, language, make)
    except AppError as refusal:
        print_problem(folder.name, refusal.code, refusal.facts, language)
        raise typer.Exit(Exit.NOTHING_DONE) from None
    except OSError as error:
        print_problem(str(folder), "E-FILE", {"why": error.strerror or ""}, language)
        raise typer.Exit(Exit.NOTHING_DONE) from None
    typer.echo(f"{folder.name} -> {folder}" + (f" (version {marker.version})" if marker.version > 1 else ""))
    for line in (folder / "answer.txt").read_text("utf-8").splitlines():
        typer.echo(f"  {line}")
