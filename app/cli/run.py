"""Commands that turn recordings into reports."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from app.batch.folder import Task, find_recordings, format_path, is_up_to_date, plan_tasks
from app.batch.run import ShardRecord, choose_workers, collect_outcomes, measure_capacity
from app.cli.options import (
    ClockOffsetOption,
    DateOrderOption,
    DiaryOption,
    IscoOption,
    JobOption,
    LanguageOption,
    Out,
    PoseHeldOption,
    ProfileOption,
    SensorOption,
    SideOption,
    SubjectOption,
    TimeZoneOption,
    apply_participants_file,
    check_windows,
    complete_profile,
    parse_axis,
    parse_isco,
    parse_job,
    parse_kinds,
    parse_offset,
    parse_shard_option,
    parse_shift,
    parse_slip_times,
    parse_subject,
    parse_windows,
    parse_zone,
    read_diary_file,
    read_list_file,
    read_profile_file,
    read_settings_file,
    resolve_profile,
    save_profile,
)
from app.cli.output import (
    Exit,
    finish,
    finish_shard,
    print_failure,
    print_json,
    print_outcome,
    print_problem,
    report_progress,
)
from app.errors import NO_RECORDING, NO_SHARDS
from app.report.words.wording import fill, load_wording
from app.request import SHIFT_HINT, Language, Paper, ReportRequest
from fusion.conventions import MethodName, Pose


def run(
    out: Out,
    paths: Annotated[
        list[Path] | None, typer.Argument(help="Recordings, folders of recordings, or patterns.")
    ] = None,
    list_: Annotated[
        Path | None,
        typer.Option("--list", metavar="FILE", help="File with a list of paths; - for standard input."),
    ] = None,
    participants: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.csv",
            help="file,subject,side,pose,calibration,pose_held,axis,slip_at,no_slip_at,diary,time_zone,clock_offset,job,isco.",
        ),
    ] = None,
    config: Annotated[
        Path | None,
        typer.Option(metavar="FILE.yaml", help="Settings of a study, in the format of settings.yaml."),
    ] = None,
    side: SideOption = None,
    subject: SubjectOption = "",
    job: JobOption = "",
    isco: IscoOption = "",
    method: Annotated[
        MethodName | None, typer.Option(help="How elevation is estimated  \\[default: smoothed]")
    ] = None,
    pose: Annotated[
        Pose | None, typer.Option(help="Calibration pose of the wearer  \\[default: n-pose]")
    ] = None,
    calibration: Annotated[
        list[str] | None,
        typer.Option(
            metavar="START_S,END_S",
            help="When the pose was held; can be repeated. Two-point: hanging, then level.",
        ),
    ] = None,
    pose_held: PoseHeldOption = None,
    axis: Annotated[
        str | None,
        typer.Option(
            metavar="x|-x|y|-y|z|-z",
            help="Without a pose: the sensor's axis along the arm, towards the shoulder.",
        ),
    ] = None,
    slip_at: Annotated[
        list[str] | None, typer.Option("--slip-at", metavar="SECONDS", help="When the sensor slipped.")
    ] = None,
    no_slip_at: Annotated[
        list[str] | None,
        typer.Option(
            "--no-slip-at", metavar="SECONDS", help="When it did not slip, although it may seem so."
        ),
    ] = None,
    diary: DiaryOption = None,
    shift: Annotated[
        str | None,
        typer.Option(
            metavar=SHIFT_HINT,
            help="Cut a recording of several days: these hours of each day, or the days of the diary.",
        ),
    ] = None,
    not_removed: Annotated[
        bool,
        typer.Option(
            "--not-removed",
            help="The sensor stayed on between the shifts: the first shift's pose applies to the later ones.",
        ),
    ] = False,
    lang: Annotated[
        Language | None, typer.Option(help="Language of the report; fr-CA: French of Québec  \\[default: en]")
    ] = None,
    rate_hz: Annotated[
        float | None, typer.Option(min=1, max=10_000, help="Sampling rate, for files without timestamps.")
    ] = None,
    profile: ProfileOption = None,
    sensor: SensorOption = "",
    date_order: DateOrderOption = None,
    time_zone: TimeZoneOption = "",
    clock_offset: ClockOffsetOption = "",
    report: Annotated[
        str | None, typer.Option(help="Report formats: html, pdf or html,pdf  \\[default: html,pdf]")
    ] = None,
    paper: Annotated[Paper | None, typer.Option(help="Paper of the PDF  \\[default: a4]")] = None,
    appendix: Annotated[
        bool,
        typer.Option("--appendix", help="Add all tables, the full method and the bibliography to the PDF."),
    ] = False,
    workers: Annotated[
        int | None,
        typer.Option("-j", "--jobs", min=1, help="Recordings in parallel  \\[default: by cores and memory]"),
    ] = None,
    join: Annotated[
        bool, typer.Option("--join", help="Join the files into one shift with one report.")
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Analyse finished recordings again.")] = False,
    shard: Annotated[
        str | None,
        typer.Option(
            metavar="K/N", help="Analyse the K-th of N slices; acromion collect then writes the tables."
        ),
    ] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Print the plan; write nothing.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print only problems and the total.")] = False,
    json_log: Annotated[bool, typer.Option("--json-log", help="Print one JSON line per recording.")] = False,
) -> None:
    """Analyse recordings and write a report for each.

    Options override the settings file. The list of participants overrides both.
    """
    given = {
        "side": side,
        "method": method,
        "pose": pose,
        "calibration_windows_s": parse_windows(calibration),
        "arm_axis": parse_axis(axis),
        "pose_held": pose_held,
        "slip_times_s": parse_slip_times(slip_at, "--slip-at"),
        "no_slip_times_s": parse_slip_times(no_slip_at, "--no-slip-at"),
        "shift": parse_shift(shift),
        "rate_hz": rate_hz,
        "time_zone": parse_zone(time_zone),
        "clock_offset_s": parse_offset(clock_offset),
        "kinds": parse_kinds(report),
        "paper": paper,
        "appendix": appendix,
    }
    settings = read_settings_file(config, lang or "en")
    settings |= {name: value for name, value in given.items() if value}
    language = lang or settings.get("languages", ("en",))[0]
    request = replace(ReportRequest(""), **{**settings, "languages": (language,)})
    profile = resolve_profile(profile, out)
    request = replace(
        request,
        subject=parse_subject(subject),
        job_title=parse_job(job),
        isco_code=parse_isco(isco),
        diary=read_diary_file(diary, language) or request.diary,
        profile=complete_profile(read_profile_file(profile, language) or request.profile, sensor, date_order),
    )
    inputs = [path for path in (list_, participants, config, diary, profile) if path]
    tasks = _plan(
        [*(paths or ()), *read_list_file(list_, language)], out, request, inputs, join=join, force=force
    )
    tasks, unmatched = apply_participants_file(participants, tasks, language)
    for row in unmatched:
        _note("unmatched", language, line=str(row.line), file=row.file)
    _note_unmatched_diary(tasks, language)
    check_windows(task.request for task in tasks)
    if any(task.request.shift for task in tasks):
        from app.batch.shifts import split_into_shifts  # noqa: PLC0415  loads fusion

        tasks = split_into_shifts(tasks, not_removed=not_removed)
    mine, record = parse_shard_option(shard), None
    if mine:
        tasks, record = mine.select(tasks), ShardRecord(out, mine, tasks, request)
    if dry_run:
        words = load_wording(language, "run")["outcome"]
        for task in tasks:
            verb = words["would_skip" if not task.force and is_up_to_date(task) else "would_do"]
            typer.echo(f"{verb}: {format_path(task.log)} -> {format_path(task.folder)}")
        raise typer.Exit
    on_outcome = print_json if json_log else print_failure if quiet else print_outcome
    save_profile(profile, out)
    count = workers or 1
    if not workers and len(tasks) != 1:
        capacity = measure_capacity()
        count, memory = choose_workers(len(tasks), capacity), round(capacity.free_bytes / (1 << 30), 1)
        _note("workers", language, n=str(count), cores=str(capacity.cores), memory=str(memory))
    if record is None:
        finish(report_progress(tasks, count, on_outcome), out, request, asks=not (quiet or json_log))
    record.begin()
    finish_shard(report_progress(tasks, count, on_outcome), record, out, language)


def collect(
    out: Annotated[Path, typer.Argument(metavar="DIR", help="Results folder of the runs with --shard.")],
    lang: Annotated[Language, typer.Option("--lang", help="Language of messages.")] = "en",
) -> None:
    """Write the tables of a run that was split with --shard."""
    try:
        collected = collect_outcomes(out)
    except (OSError, ValueError, KeyError, TypeError):
        print_problem(format_path(out), NO_SHARDS, {}, lang)
        raise typer.Exit(Exit.USAGE) from None
    for name, slices in (("undone", collected.undone), ("differing", collected.differing)):
        if slices:  # slices to repeat, and slices with other options than the last
            _note(name, lang, slices=", ".join(slices))
    finish(collected.outcomes, out, collected.request, goes_on=False)


def exposure(
    path: Annotated[Path, typer.Argument(help="CSV with the columns time_s,elevation_deg.")],
    out: Out,
    side: SideOption = None,
    subject: SubjectOption = "",
    diary: DiaryOption = None,
    lang: LanguageOption = "en",
) -> None:
    """Compute the exposure of an existing angle series (an empty angle is a missing value)."""
    entries = read_diary_file(diary, lang)
    request = ReportRequest(
        path.name, parse_subject(subject), side, languages=(lang,), source="angles", diary=entries
    )
    tasks = plan_tasks([path], out, request, force=True)
    finish(report_progress(tasks, 1), out, request)


def _plan(
    paths: Sequence[Path],
    out: Path,
    request: ReportRequest,
    inputs: Sequence[Path],
    *,
    join: bool,
    force: bool,
) -> list[Task]:
    language = request.languages[0]
    found = find_recordings(paths, out, inputs)
    if not found.logs:
        print_problem(", ".join(map(str, paths)), NO_RECORDING, {}, language)
        raise typer.Exit(Exit.NOTHING_DONE if paths else Exit.USAGE)
    if found.others:
        _note("others", language, n=str(found.others))
    logs = found.logs
    if join:  # one task, in a folder named after the first file
        logs, request = logs[:1], replace(request, joined=tuple(str(log.resolve()) for log in logs[1:]))
    return plan_tasks(logs, out, request, found.format_place, force=force)


def _note_unmatched_diary(tasks: Sequence[Task], language: Language) -> None:
    """Print the files and subjects of the diary that no recording has."""
    named = {entry.file: None for task in tasks for entry in task.request.diary}
    used = {entry.file for task in tasks for entry in task.request.select_diary()}
    if unused := [name for name in named if name and name not in used]:
        _note("unmatched_diary", language, names=", ".join(unused))


def _note(name: str, language: Language, **facts: str) -> None:
    typer.echo(fill(load_wording(language, "run")["outcome"][name], facts), err=True)
