"""Cut recordings into shifts: each has its request, and in a run its task, folder, calibration and report."""

import json
import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

from acromion.app.analysis.attempt import (
    Attempt,
    MakeReport,
    choose_limits,
    load_and_check,
    load_and_measure,
    run_and_wait,
)
from acromion.app.batch.folder import MARKER, Task, identify_place
from acromion.app.errors import Crashed, Interrupted, RecordedProblem
from acromion.app.request import BY_DIARY, ReportRequest
from acromion.app.settings import Settings
from acromion.fusion.clocks import ShiftWindow, correct_start, in_zone, parse_interval, read_clock
from acromion.fusion.diary import DiaryEntry, refuse_slips
from acromion.fusion.errors import (
    FusionError,
    UnusableCalibration,
    UnusableClock,
    UnusableDiary,
    UnusableShift,
)
from acromion.fusion.exposure.periods import close_rows, find_diary_poses, place_diary, place_moment
from acromion.fusion.recording import MICROSECONDS, QualityFlag, cut_windows, find_uncovered
from acromion.fusion.shifts import (
    cut_diary,
    find_by_diary,
    find_by_hours,
    is_undated,
    parse_hours,
    widen_to_pose,
)


def split_into_shifts(tasks: Sequence[Task], *, not_removed: bool) -> list[Task]:
    """Return a task for each shift of each recording.

    ``not_removed``: a person states that the sensor stayed on the arm, so that the pose of the first shift
    applies to the later ones. A recording that cannot be cut keeps one task, which states the reason; so does
    a shift at a time that the clock skips or repeats.
    """
    return [part for task in tasks for part in _split(task, not_removed=not_removed)]


def _split(task: Task, *, not_removed: bool) -> list[Task]:
    whole = replace(task.request, shift="")
    try:
        extent = _measure(task.log, whole)
        requests, refusals = cut_as_asked(task.request, extent, not_removed=not_removed)
    except (RecordedProblem, Crashed, Interrupted, UnusableClock):
        return [replace(task, request=whole)]  # its analysis fails for the same reason
    except (UnusableDiary, UnusableCalibration) as error:
        return [replace(task, request=whole, code=error.code, facts=error.facts)]
    if not refusals:
        return [replace(task, request=requests[0])]
    parts = [
        replace(
            task,
            request=request,
            folder=_choose_folder(task, name),
            path=f"{task.name} {name}",
            sha256=extent["sha256"],
        )
        for request, name in zip(requests, _name_shifts(requests), strict=True)
    ]
    return [
        replace(part, code=refusal.code, facts=refusal.facts) if refusal else part
        for part, refusal in zip(parts, refusals, strict=True)
    ]


def _find_refusal(window: ShiftWindow, start: datetime) -> FusionError | None:
    """Return why a recording cannot be cut to a window of its clock."""
    try:
        window.place(start)
    except UnusableShift as refusal:
        return refusal
    return None


def _measure(log: Path, request: ReportRequest) -> dict[str, Any]:
    """Return start, duration and digest of a recording. Raises RecordedProblem, Crashed or Interrupted."""
    found: dict[str, Any] = _find(log, request, load_and_measure, "extent.json")
    return found


def check_times(task: Task) -> list[QualityFlag]:
    """Return the caveats of the diary of a task, before its recording is analysed.

    Raises RecordedProblem, Crashed or Interrupted: the recording will be refused because of a stated time.
    """
    asked = task.request
    if task.code:
        raise RecordedProblem(task.code, task.facts)
    times = (asked.calibration_windows_s, asked.slip_times_s, asked.no_slip_times_s, asked.select_diary())
    if not any((asked.shift, asked.time_zone, asked.clock_offset_s, *times)):
        return []
    return [QualityFlag(**flag) for flag in _find(task.log, asked, load_and_check, "check.json")]


def _find(log: Path, request: ReportRequest, make: MakeReport, name: str) -> Any:
    """Return what a child process finds. Raises RecordedProblem, Crashed or Interrupted."""
    with tempfile.TemporaryDirectory() as folder:
        limits = choose_limits(Settings(), log.stat().st_size)
        run_and_wait(Attempt(log, request, Path(folder), make, limits))
        return json.loads((Path(folder) / name).read_bytes())


def read_start(extent: Mapping[str, Any], request: ReportRequest) -> datetime | None:
    """Return the measured start by the stated clock; None without a clock. Raises UnusableClock."""
    device = datetime.fromisoformat(extent["start"]) if extent["start"] else None
    device = in_zone(device, extent["time_zone"])
    return correct_start(device, request.time_zone, request.clock_offset_s)


def _find_windows(
    request: ReportRequest, start: datetime, extent: Mapping[str, Any]
) -> tuple[ShiftWindow, ...]:
    duration_us = int(extent["duration_us"])
    if request.shift == BY_DIARY:
        return find_by_diary(request.select_diary(), start, duration_us)
    return find_by_hours(start, duration_us, parse_hours(request.shift), extent["covered_us"])


def cut_as_asked(
    request: ReportRequest, extent: Mapping[str, Any], *, not_removed: bool
) -> tuple[list[ReportRequest], list[FusionError | None]]:
    """Return the request of each shift for hours of the day or "diary" in ``request.shift``.

    Also return why each shift cannot be cut, None if it can. If the recording has no such time, there is one
    request, whose analysis states the reason, and no refusal.

    Raises UnusableClock, and as :func:`cut_request`.
    """
    whole = replace(request, shift="")
    start, duration_us = read_start(extent, whole), int(extent["duration_us"])
    if start is None:
        return [request], []
    windows = _find_windows(request, start, extent)
    if not windows:
        return [replace(whole, shift=_name_missing(request.shift, start))], []
    requests = cut_request(whole, windows, start, duration_us, not_removed=not_removed)
    return requests, [_find_refusal(window, start) for window in windows]


def _name_missing(shift: str, start: datetime) -> str:
    """Return the hours on the first date, so that the refusal names them."""
    if shift == BY_DIARY:
        return shift
    hours = parse_hours(shift)
    end_day = start if hours.end > hours.start else start + timedelta(days=1)
    return str(
        ShiftWindow(*(datetime.combine(day, at) for day, at in ((start, hours.start), (end_day, hours.end))))
    )


def cut_request(
    whole: ReportRequest,
    windows: Sequence[ShiftWindow],
    start: datetime,
    duration_us: int,
    *,
    not_removed: bool,
) -> list[ReportRequest]:
    """Return the request of each shift of a recording; ``not_removed`` as in :func:`split_into_shifts`.

    A shift begins at its stated pose, if that was held shortly before it; the time between is then outside of
    the shift. No pose is carried over a slip that a person stated. The analysis of a shift at a time that the
    clock skips or repeats states the reason.

    Raises UnusableDiary: with several shifts, every row without a date; every row, if all are outside the
    recording. Raises UnusableCalibration: a calibration window is in no shift.
    """
    if len(windows) > 1:
        _refuse_undated(whole.select_diary())
    _refuse_outside(whole.select_diary(), start, duration_us)
    begins_us = _find_poses(whole, start, duration_us)
    asked: list[ReportRequest] = []
    usable: list[tuple[int, int]] = []
    earliest_us, unused_s = 0, set(whole.calibration_windows_s)
    for place, window in enumerate(windows):
        if _find_refusal(window, start):
            asked.append(replace(whole, shift=str(window)))
            continue
        first_us, stop_us = window.place(start)
        begin_us = widen_to_pose(max(first_us, 0), stop_us, earliest_us, begins_us)
        asked.append(_cut_request(whole, window, begin_us, start, duration_us))
        usable.append((place, begin_us))
        earliest_us = stop_us
        unused_s -= {window_s for window_s in unused_s if cut_windows([window_s], begin_us, stop_us)}
    if usable and unused_s:
        start_s, end_s = min(unused_s)
        raise UnusableCalibration(why="no shift", start_s=start_s, end_s=end_s)
    if not_removed:
        _carry_poses(asked, usable, whole.slip_times_s, start)
    return asked


def _carry_poses(
    asked: list[ReportRequest],
    usable: Sequence[tuple[int, int]],
    slip_times_s: Sequence[float],
    start: datetime,
) -> None:
    """Set the pose of each later shift in ``asked``: the last stated one before it, or that of the first.

    ``usable``: place and first microsecond of each shift that can be cut.
    """
    for number, (place, begin_us) in enumerate(usable[1:], 1):
        posed = [one for one in usable[:number] if _has_pose(asked[one[0]])]
        source, from_us = posed[-1] if posed else usable[0]
        if not any(from_us <= at_s * MICROSECONDS < begin_us for at_s in slip_times_s):
            asked[place] = _carry_pose(asked[source], asked[place], start)


def _refuse_undated(diary: Sequence[DiaryEntry]) -> None:
    """Refuse clock times without a date, which several shifts may contain. Raises UnusableDiary."""
    refuse_slips(
        [
            UnusableDiary(line=entry.line, why="which day", cure="date", value=str(entry.start))
            for entry in diary
            if is_undated(entry.start)
        ]
    )


def _refuse_outside(diary: Sequence[DiaryEntry], start: datetime, duration_us: int) -> None:
    """Refuse a diary of one recording if every row of it is outside the recording. Raises UnusableDiary."""
    own = [entry for entry in diary if not entry.file and entry.kind != "posture"]
    if not cut_diary(own, start, duration_us, 0, duration_us):
        why, cure = "outside recording", "clock"
        refuse_slips([UnusableDiary(line=e.line, why=why, cure=cure, value=str(e.start)) for e in own])


def _find_poses(request: ReportRequest, start: datetime, duration_us: int) -> list[int]:
    """Return when each pose that a person stated began, in microseconds from the first sample."""
    begins_us = [round(first_s * MICROSECONDS) for first_s, _ in request.calibration_windows_s]
    return begins_us + [
        place_moment(entry.start, entry.line, start, duration_us)
        for entry in request.select_diary()
        if entry.kind == "pose"
    ]


def _cut_request(
    request: ReportRequest, window: ShiftWindow, begin_us: int, start: datetime, duration_us: int
) -> ReportRequest:
    """Return the request of a shift: what a person stated about its time, and nothing about other shifts.

    ``begin_us``: its first microsecond, which is that of its pose if the pose was held before the window. A
    calibration window becomes a row of the diary, because seconds count from the first sample of the shift.
    """
    first_us, stop_us = window.place(start)
    last_us = min(stop_us, duration_us)
    rows = [
        DiaryEntry(_format_clock(start, first_s), _format_clock(start, last_s), "pose")
        for first_s, last_s in request.calibration_windows_s
        if cut_windows([(first_s, last_s)], begin_us, last_us)
    ]
    diary = cut_diary(request.select_diary(), start, duration_us, begin_us, last_us)
    if begin_us < max(first_us, 0):
        begin = read_clock(start, begin_us)
        window = ShiftWindow(begin, read_clock(start, stop_us))
        rows += _list_outside(diary, begin, first_us - begin_us, last_us - begin_us)
    slips, no_slips = (
        tuple(at_s - begin_us / MICROSECONDS for at_s in times_s if begin_us <= at_s * MICROSECONDS < last_us)
        for times_s in (request.slip_times_s, request.no_slip_times_s)
    )
    return replace(
        request,
        shift=str(window),
        calibration_windows_s=(),
        slip_times_s=slips,
        no_slip_times_s=no_slips,
        diary=(*rows, *diary),
    )


def _list_outside(
    diary: Sequence[DiaryEntry], begin: datetime, until_us: int, duration_us: int
) -> Iterator[DiaryEntry]:
    """Yield the time from the pose until the shift as outside of it, if no row of the diary states it."""
    stated = [entry for entry in close_rows(diary) if entry.kind == "outside"]
    placed = place_diary(stated, begin, duration_us).periods
    spans = ((period.start_us, period.end_us) for period in placed)
    for span_us in find_uncovered(spans, 0, until_us, 0):
        first, last = (read_clock(begin, edge_us).isoformat() for edge_us in span_us)
        yield DiaryEntry(first, last, "outside")


def _format_clock(start: datetime, at_s: float) -> str:
    return read_clock(start, round(at_s * MICROSECONDS)).isoformat()


def _has_pose(request: ReportRequest) -> bool:
    return any(entry.kind == "pose" for entry in request.diary)


def _carry_pose(first: ReportRequest, later: ReportRequest, start: datetime) -> ReportRequest:
    """Return a later request with the pose of an earlier shift, in case that it has no confirmed pose."""
    if later.arm_axis or _has_pose(later):
        return later
    window = parse_interval(first.shift)
    first_us, stop_us = window.place(start)
    begin = read_clock(start, max(first_us, 0))
    windows_s = find_diary_poses(first.diary, begin, stop_us - max(first_us, 0))
    return replace(
        later,
        pose_from=first.shift,
        pose_from_windows_s=windows_s,
        pose_from_no_slip_at_s=first.no_slip_times_s,
    )


def _name_shifts(requests: Sequence[ReportRequest]) -> list[str]:
    """Return the date of each shift; with its hour if there are several on one date."""
    starts = [parse_interval(request.shift).start for request in requests]
    dates = Counter(start.date() for start in starts)
    return [start.strftime("%Y-%m-%d" if dates[start.date()] == 1 else "%Y-%m-%d_%H%M") for start in starts]


def _choose_folder(task: Task, name: str) -> Path:
    """Return the folder of a shift, next to that of its recording; not one of another recording."""
    place, number = identify_place(task.log), 1
    folder = task.folder.with_name(f"{task.folder.name}_{name}")
    while _belongs_to_other(folder, place):
        number += 1
        folder = task.folder.with_name(f"{task.folder.name}_{name}-{number}")
    return folder


def _belongs_to_other(folder: Path, place: str) -> bool:
    try:
        return bool(json.loads((folder / MARKER).read_text("utf-8")).get("place") != place)
    except (OSError, ValueError):
        return False
