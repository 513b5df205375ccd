"""Commands that turn recordings into reports."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from acromion.app.batch.again import list_inputs, plan_again, save_inputs
from acromion.app.batch.folder import Task, find_recordings, format_path, is_up_to_date, plan_tasks
from acromion.app.batch.run import (
    Outcome,
    ShardRecord,
    choose_workers,
    collect_outcomes,
    measure_capacity,
)
from acromion.app.batch.stated import list_stated
from acromion.app.cli.options import (
    ClockOffsetOption,
    DateOrderOption,
    DiaryOption,
    IscoOption,
    JobOption,
    LanguageOption,
    MinHoursOption,
    Out,
    PoseHeldOption,
    PostureOption,
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
    read_diary_names,
    read_list_file,
    read_posture_file,
    read_profile_file,
    read_settings_file,
    resolve_profile,
    save_profile,
)
from acromion.app.cli.output import (
    Exit,
    choose_exit,
    finish,
    finish_shard,
    holding_results,
    note_orphans,
    print_failure,
    print_json,
    print_outcome,
    print_problem,
    printing_refusals,
    report_progress,
)
from acromion.app.errors import NO_RECORDING, NO_SHARDS, AppError, RecordedProblem
from acromion.app.logs import escape_controls
from acromion.app.report.words.messages import describe_flag
from acromion.app.report.words.wording import fill, load_wording
from acromion.app.request import SHIFT_HINT, Language, Paper, ReportRequest
from acromion.fusion.conventions import MethodName, Pose
from acromion.fusion.diary import DiaryEntry


def run(
    context: typer.Context,
    paths: Annotated[
        list[Path] | None, typer.Argument(help="Recordings, folders of recordings, or patterns.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", help="Folder for the results  \\[required without --again]"),
    ] = None,
    again: Annotated[
        Path | None,
        typer.Option(
            metavar="RESULTS",
            help="Repeat the last run of this folder, into it or -o; PATHS: where its recordings are now.",
        ),
    ] = None,
    list_: Annotated[
        Path | None,
        typer.Option("--list", metavar="FILE", help="File with a list of paths; - for standard input."),
    ] = None,
    participants: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.csv",
            help="file,subject,side,pose,calibration,pose_held,axis,slip_at,no_slip_at,diary,posture,time_zone,clock_offset,job,isco.",
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
    posture: PostureOption = None,
    shift: Annotated[
        str | None,
        typer.Option(
            metavar=SHIFT_HINT,
            help="Cut a recording of several days: these hours of each day, or the days of the diary.",
        ),
    ] = None,
    min_hours: MinHoursOption = None,
    not_removed: Annotated[
        bool,
        typer.Option(
            "--not-removed",
            help="The sensor stayed on: the first shift's confirmed pose applies to later ones without one.",
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
    if out is None and again is None:
        raise typer.BadParameter("required, unless you repeat a run with --again", param_hint="-o")
    out = out or again or Path()
    if again:
        _check_only_repeats(context)
        with printing_refusals(format_path(again), lang or "en", Exit.USAGE):
            tasks, request = plan_again(again, out, paths or (), force=force)
        language, inputs_by_name = request.languages[0], list_inputs(again)
    else:
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
        settings |= {} if min_hours is None else {"min_hours": min_hours}
        language = lang or settings.get("languages", ("en",))[0]
        request = replace(ReportRequest(""), **{**settings, "languages": (language,)})
        profile = resolve_profile(profile, out)
        request = replace(
            request,
            subject=parse_subject(subject),
            job_title=parse_job(job),
            isco_code=parse_isco(isco),
            diary=(read_diary_file(diary, language) or request.diary) + read_posture_file(posture, language),
            profile=complete_profile(
                read_profile_file(profile, language) or request.profile, sensor, date_order
            ),
        )
        inputs = [path for path in (list_, participants, config, profile) if path]
        diaries = [path for path in (diary, posture, *read_diary_names(participants, language)) if path]
        inputs += diaries
        tasks = _plan(
            [*(paths or ()), *read_list_file(list_, language)], out, request, inputs, join=join, force=force
        )
        tasks, unmatched = apply_participants_file(participants, tasks, language)
        for row in unmatched:
            _note("unmatched", language, line=str(row.line), file=row.file)
        for task in tasks if participants else ():
            if not (task.line or task.double_of):
                _note("without_row", language, file=task.name)
        if columns := list(dict.fromkeys(name for task in tasks for name in task.further)):
            _note("further", language, names=", ".join(columns))
        _note_unmatched_diary(tasks, language)
        check_windows(task.request for task in tasks)
        if any(task.request.shift for task in tasks):
            from acromion.app.batch.shifts import split_into_shifts  # noqa: PLC0415  loads fusion

            whole, tasks = tasks, split_into_shifts(tasks, not_removed=not_removed)
            _note_unused_rows(whole, tasks, language)
        inputs_by_name = {_name_copy(path, participants): path for path in diaries}
        inputs_by_name |= {"participants.csv": participants} if participants else {}
    mine, record, everything = parse_shard_option(shard), None, tasks
    if mine:
        tasks, record = mine.select(tasks), ShardRecord(out, mine, tasks, request)
    if dry_run:
        words = load_wording(language, "run")["outcome"]
        for task in tasks:
            is_done = not task.force and not task.double_of and is_up_to_date(task)
            verb = words["would_skip" if is_done else "would_leave" if task.double_of else "would_do"]
            place = task.double_of or format_path(task.folder)
            typer.echo(escape_controls(f"{verb}: {format_path(task.log)} -> {place}"))
            typer.echo(escape_controls(f"  {_describe_plan(task)}"))
        note_orphans(everything, out, language)
        planned = [task for task in tasks if not task.double_of]
        _print_proposals(planned, language)
        raise typer.Exit(_check_plan(planned, language))
    on_outcome = print_json if json_log else print_failure if quiet else print_outcome
    count = workers or 1
    if not workers and len(tasks) != 1:
        capacity = measure_capacity()
        count, memory = choose_workers(len(tasks), capacity), round(capacity.free_bytes / (1 << 30), 1)
        _note("workers", language, n=str(count), cores=str(capacity.cores), memory=str(memory))
    with holding_results(out, language, is_shared=record is not None):
        with printing_refusals(format_path(out), language):
            save_profile(profile, out)
            save_inputs(out, everything, request, inputs_by_name, is_shared=record is not None)
        if record is None:
            finish(report_progress(tasks, count, on_outcome), out, request, asks=not (quiet or json_log))
        record.begin()
        finish_shard(report_progress(tasks, count, on_outcome), record, out, language)


def _check_plan(tasks: Sequence[Task], language: Language) -> Exit:
    """Print the stated times that the run will refuse or ignore; return the code with which it will end."""
    from acromion.app.batch.shifts import check_times  # noqa: PLC0415  loads fusion

    outcomes = []
    for task in tasks:
        try:
            flags = check_times(task)
        except (RecordedProblem, AppError) as refusal:
            outcomes.append(Outcome(task, code=refusal.code))
            print_problem(task.name, refusal.code, refusal.facts, language)
            continue
        outcomes.append(Outcome(task))
        for flag in flags:
            words = describe_flag(flag, language)
            typer.echo(escape_controls(f"{task.name}: {words.title}. {words.detail}"), err=True)
    return choose_exit(outcomes) if outcomes else Exit.ALL_GOOD


def _print_proposals(tasks: Sequence[Task], language: Language) -> None:
    """Print the recordings of each subject that pairs.csv will pair."""
    from acromion.app.batch.pairs import propose_pairs  # noqa: PLC0415  only a dry run

    entry = load_wording(language, "run")["outcome"]
    for proposal in propose_pairs(tasks):
        places = {
            name: ", ".join(task.name for task in getattr(proposal, name))
            for name in ("left", "right", "trunk")
        }
        typer.echo(fill(entry["pair"], {"subject": proposal.subject, **places}))


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
    with holding_results(out, lang, is_shared=True):
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
    with holding_results(out, lang):
        tasks = plan_tasks([path], out, request, force=True)
        save_inputs(out, tasks, request, {f"diaries/{diary.name}": diary} if diary else {}, is_shared=False)
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


_WITH_AGAIN = frozenset(
    {"context", "paths", "out", "again", "workers", "force", "shard", "dry_run", "quiet", "json_log"}
)
"""Parameters that may be given when a run is repeated."""


def _check_only_repeats(context: typer.Context) -> None:
    """Refuse settings beside --again, which uses those of the run that it repeats."""
    sources = {name: context.get_parameter_source(name) for name in context.params if name not in _WITH_AGAIN}
    given = [name for name, source in sources.items() if source and source.name == "COMMANDLINE"]
    if given:
        options = ", ".join(f"--{name.rstrip('_').replace('_', '-')}" for name in given)
        raise typer.BadParameter(f"repeats the settings of the run; omit {options}", param_hint="--again")


def _name_copy(diary: Path, participants: Path | None) -> str:
    """Return the path of a diary's copy in the inputs: as the list of participants names it."""
    folder = participants.parent if participants else diary.parent
    below = diary.relative_to(folder) if diary.is_relative_to(folder) else Path(diary.name)
    return f"diaries/{'_'.join(part for part in below.parts if part != '..')}"


def _describe_plan(task: Task) -> str:
    """Format the subject of a recording, its pose, the rows of its diary, and every stated setting."""
    request = task.request
    shown: dict[str, object] = {"subject": request.subject, "side": request.side, "pose": request.pose}
    shown |= {"diary": len(request.select_diary()), "job": request.job_title, "isco": request.isco_code}
    shown = {name: value for name, value in shown.items() if value or name in {"subject", "side", "diary"}}
    shown |= {name: value for name, value in list_stated(request).items() if name not in shown} | dict(
        task.further
    )
    return ", ".join(f"{name}: {'-' if value in ('', None) else value}" for name, value in shown.items())


def _note_unmatched_diary(tasks: Sequence[Task], language: Language) -> None:
    """Print the files and subjects of the diary that no recording has."""
    named = {entry.file: None for task in tasks for entry in task.request.diary}
    used = {entry.file for task in tasks for entry in task.request.select_diary()}
    if unused := [name for name in named if name and name not in used]:
        _note("unmatched_diary", language, names=", ".join(unused))


def _note_unused_rows(whole: Sequence[Task], tasks: Sequence[Task], language: Language) -> None:
    """Print the lines of the diaries that are in no shift, for recordings that could be cut."""

    def identify(task: Task, entry: DiaryEntry) -> tuple[object, int]:
        return entry.file or task.log, entry.line  # a row with a name may be for another recording of it

    refused = {task.log for task in tasks if task.code}
    used = {identify(task, entry) for task in tasks for entry in task.request.diary}
    unused = {
        entry.line
        for task in whole
        for entry in task.request.select_diary()
        if task.log not in refused and entry.kind != "posture" and identify(task, entry) not in used
    }
    if unused:
        _note("unused_rows", language, lines=", ".join(map(str, sorted(unused))))


def _note(name: str, language: Language, **facts: str) -> None:
    typer.echo(fill(load_wording(language, "run")["outcome"][name], facts), err=True)
