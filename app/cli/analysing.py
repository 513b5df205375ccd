"""Commands that turn recordings into reports."""

from pathlib import Path
from typing import Annotated

import typer

from app.batch.plan import find_recordings, plan_joined, plan_tasks
from app.cli.options import (
    DiaryOption,
    LanguageOption,
    Out,
    ProfileOption,
    SideOption,
    SubjectOption,
    parse_kinds,
    parse_windows,
    read_diary_file,
    read_profile_file,
    take_subject,
)
from app.cli.said import Exit, finish, print_problem, report_progress
from app.request import ReportRequest
from fusion.choices import MethodName, Pose


def run(
    paths: Annotated[list[Path], typer.Argument(help="Recordings, or folders of recordings.")],
    out: Out,
    side: SideOption = None,
    subject: SubjectOption = "",
    method: Annotated[MethodName, typer.Option(help="How elevation is estimated.")] = "smoothed",
    pose: Annotated[Pose, typer.Option(help="The pose the wearer was calibrated in.")] = "n-pose",
    calibration: Annotated[
        list[str] | None,
        typer.Option(
            metavar="START_S,END_S", help="Calibration window; twice for two-point: hanging, level."
        ),
    ] = None,
    diary: DiaryOption = None,
    lang: LanguageOption = "en",
    rate_hz: Annotated[float | None, typer.Option(min=1, max=10_000, help="For logs without time.")] = None,
    profile: ProfileOption = None,
    report: Annotated[str, typer.Option(help="What to write: html, pdf or html,pdf.")] = "html,pdf",
    workers: Annotated[int, typer.Option("-j", "--jobs", min=1, help="Recordings at once.")] = 1,
    join: Annotated[bool, typer.Option("--join", help="The files are one shift, in one report.")] = False,
    force: Annotated[bool, typer.Option("--force", help="Do finished recordings again.")] = False,
) -> None:
    """Analyse recordings and write a report for each."""
    request = ReportRequest(
        file_name="",
        subject=take_subject(subject),
        side=side,
        method=method,
        pose=pose,
        calibration_windows_s=parse_windows(calibration, pose),
        rate_hz=rate_hz,
        languages=(lang,),
        kinds=parse_kinds(report),
        diary=read_diary_file(diary, lang),
        profile=read_profile_file(profile, lang),
    )
    logs = find_recordings(paths, out)
    if not logs:
        print_problem(", ".join(map(str, paths)), "E-NO-RECORDING", {}, lang)
        raise typer.Exit(Exit.NOTHING_DONE)
    tasks = (plan_joined if join else plan_tasks)(logs, out, request, force=force)
    finish(report_progress(tasks, workers), out, request)


def exposure(
    path: Annotated[Path, typer.Argument(help="CSV with the columns time_s,elevation_deg.")],
    out: Out,
    side: SideOption = None,
    subject: SubjectOption = "",
    diary: DiaryOption = None,
    lang: LanguageOption = "en",
) -> None:
    """Give the exposure of a ready angle series (an empty angle is missing)."""
    entries = read_diary_file(diary, lang)
    request = ReportRequest(
        path.name, take_subject(subject), side, languages=(lang,), source="angles", diary=entries
    )
    tasks = plan_tasks([path], out, request, force=True)
    finish(report_progress(tasks, 1), out, request)
