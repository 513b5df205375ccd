"""The card after an upload: it asks for the person, the arm, the pose and the breaks.

A recording of a day or more is asked for its shifts instead of the pose, which each shift is asked for later.

A file name, its folders and a list of participants only propose: nothing is used before a person saves it.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import datetime, time, timedelta
from itertools import pairwise, zip_longest
from pathlib import Path
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Response

from acromion.app.batch.folder import Task
from acromion.app.batch.inputs import assign_participants
from acromion.app.batch.shifts import cut_request, read_start
from acromion.app.errors import (
    BadParameter,
    NoSuchFile,
    NotFinished,
    NotHere,
    OutOfMemory,
    OutOfTime,
    RecordedProblem,
    ResultDamaged,
)
from acromion.app.http.api.library.analyses import check_queue
from acromion.app.http.pages.recording.analysis import find_results
from acromion.app.http.pages.recording.day import (
    DAY_S,
    MAX_SHOWN,
    START,
    Choice,
    DayClock,
    add_correction,
    build_day,
    choose_pose,
    find_shifts,
    find_stated_pose,
    load_day,
    place_rows,
    read_rows,
    read_whose,
    read_windows,
    update_description,
)
from acromion.app.http.pages.recording.page_one import read_page_one
from acromion.app.http.pages.rendering import Form, Page, UsedForm, UsedPage, first, read_body
from acromion.app.http.pages.views import OPEN_POSES, build_row, find_durations, find_path
from acromion.app.library.jobs import JobFilter
from acromion.app.library.listing import Entry
from acromion.app.library.rows import Job, JobState
from acromion.app.report.charts.svg import NARROW, RAMP, RULE, WIDE, line, number, path, picture, rect, text
from acromion.app.report.words.numbers import format_iso_moment
from acromion.app.report.words.wording import fill
from acromion.app.request import ReportRequest, propose_description
from acromion.app.store.day_file import DayFile
from acromion.app.store.folder import borrow_recording
from acromion.fusion.clocks import ShiftWindow, measure_us, parse_interval, read_clock
from acromion.fusion.errors import UnusableShift
from acromion.fusion.recording import MICROSECONDS
from acromion.fusion.shifts import HOURS_HINT, find_by_hours, has_samples, parse_hours

router = APIRouter(include_in_schema=False, prefix="/recordings/{recording_id}/finish")

OTHER = "other"
"""The answer that the pose was held at the typed times."""
MAX_SHIFTS = 100
AROUND_S, SHORTEST_VIEW_S = 60.0, 300.0
TOP_PX, BASE_PX, HEIGHT_PX, SCALE_PX = 20.0, 110.0, 126.0, 30.0
LABEL_PX = 18.0
TOP_DEG = 180.0


@router.get("")
def show_finish(recording_id: str, page: UsedPage, analysis: str = "") -> Response:
    """Ask the open questions of a recording, or of one analysis of it."""
    job = _find_job(page, recording_id, analysis)
    entry = Entry(job, None)
    row = build_row(job, page.language, find_durations(page.services, [entry]))
    proposal = propose_description(str(find_path(page.services, job)))
    asked: dict[str, Any] = dict.fromkeys(
        ("day", "question", "choices", "pose_state", "curves", "is_open", "shifts", "is_cut", "stayed")
    )
    if job.state is JobState.SUCCEEDED or _is_too_long(job):
        with suppress(ResultDamaged, NoSuchFile, RecordedProblem):
            asked |= _build_asked(page, job)
    return page.render("recording/finish.html", row=row, job=job, proposal=proposal, **asked)


@router.post("")
def finish(recording_id: str, page: UsedPage, form: UsedForm) -> Response:
    """Store the answers; if one is new, make the next version of the report with them, or of each shift."""
    job = _find_job(page, recording_id, first(form, "analysis"))
    if not job.is_over:
        raise NotFinished(state=job.state)
    day = None
    with suppress(NoSuchFile, RecordedProblem):
        day = _load_day(page, job)
    answered = read_answers(job.request, form, day)
    clock = DayClock.of(day.facts) if day and _asks_shifts(job, day) else None
    shifts = read_shifts(form, clock, _list_covered(day)) if clock and day else None
    if clock and shifts is not None and (shifts or job.replaced_by is not None):
        not_removed = bool(first(form, "not_removed"))
        job = _cut(page, job, answered, shifts, clock, not_removed=not_removed)
    elif answered != job.request:
        job = add_correction(page.services, job, answered)
    return page.go(f"/analyses/{job.id}")


def _cut(
    page: Page,
    job: Job,
    answered: ReportRequest,
    shifts: Sequence[ShiftWindow],
    clock: DayClock,
    *,
    not_removed: bool,
) -> Job:
    """Queue an analysis of each shift, or of the whole without shifts; return the first. Raises Busy."""
    assert clock.start is not None  # shifts are asked for on the recording's clock
    whole, store = replace(answered, conclusion=None, reason=""), page.services.store
    asked = cut_request(whole, shifts, clock.start, clock.duration_us, not_removed=not_removed) or [whole]
    check_queue(page.services, len(asked))
    update_description(page.services, job, answered, ("subject", "side"))
    known = {one.request.shift: one for one in find_shifts(page.services, job.recording_id)}
    cut = store.cut(job, [known[one.shift].request if one.shift in known else one for one in asked])
    again = [
        store.correct(known[one.shift], kept)
        for one in asked
        if one.shift in known and (kept := _keep_answers(page, known, one)) != known[one.shift].request
    ]
    return again[0] if again and asked[0].shift in known else cut[0]


def _keep_answers(page: Page, known: Mapping[str, Job], asked: ReportRequest) -> ReportRequest:
    """Return the request of a shift that was cut before: what a person stated about it stays."""
    kept = replace(known[asked.shift].request, subject=asked.subject, side=asked.side, reason="")
    source = known.get(asked.pose_from)
    if kept.pose_from == asked.pose_from:
        return kept
    return replace(
        kept,
        pose_from=asked.pose_from,
        pose_from_windows_s=find_stated_pose(page.services, source, source.request) if source else (),
        pose_from_no_slip_at_s=source.request.no_slip_times_s if source else (),
    )


def _is_too_long(job: Job) -> bool:
    """Return whether an analysis of a whole recording needed too much memory or time; its shifts may not."""
    return job.problem_code in {OutOfMemory.code, OutOfTime.code} and not job.request.shift


def _load_day(page: Page, job: Job) -> DayFile:
    """Return the day of an analysis, or only start and duration of a recording that is too long.

    Raises NoSuchFile, ResultDamaged or RecordedProblem.
    """
    if not _is_too_long(job):
        return load_day(page.services, job)
    services, request = page.services, job.request
    with borrow_recording(services.storage, job.recording_id, job.sha256) as path:
        extent = services.inspector.measure(path, request)
    start = read_start(extent, request)
    facts: dict[str, Any] = {
        "start": start.isoformat() if start else None,
        "time_zone": request.time_zone,
        "device": "other",
    }
    facts |= dict.fromkeys(("still", "not_worn", "left_out", "calibration"), ())
    return DayFile(facts | {name: extent[name] for name in ("duration_us", "covered_us")}, ())


@router.post("/proposal")
def propose(
    recording_id: str, page: UsedPage, body: Annotated[bytes, Depends(read_body)], analysis: str = ""
) -> dict[str, str]:
    """Return the subject and arm of this recording in a list of participants; nothing is stored.

    Raises UnusableParticipants.
    """
    job = _find_job(page, recording_id, analysis)
    task = Task(find_path(page.services, job), ReportRequest(job.file_name), Path())
    (assigned,), _ = assign_participants([task], body, None)
    return {"subject": assigned.request.subject, "side": assigned.request.side or ""}


def read_answers(before: ReportRequest, form: Form, day: DayFile | None) -> ReportRequest:
    """Return the request with the answers of the card; an answer that was left open changes nothing.

    Raises BadParameter, UnusableCalibration or UnusableDiary.
    """
    answered = replace(read_whose(before, form), reason="")
    if day is None:
        return answered if _is_changed(before, answered) else before
    clock, choice = DayClock.of(day.facts), first(form, "choice")
    if choice == OTHER:
        (window_s,) = read_windows(form, "pose", clock) or [None]
        if window_s is None:
            raise BadParameter(name="calibration", value="", allowed=clock.format_bounds())
        answered = replace(answered, calibration_windows_s=(window_s,), arm_axis=None)
    elif choice:
        answered = choose_pose(answered, day.facts, choice)
    _check_breaks(form, clock)
    if breaks := read_rows(form, clock):
        answered = replace(answered, diary=(*before.diary, *breaks))
        place_rows(answered.select_diary(), clock)  # raises if a row cannot be placed
    return answered if _is_changed(before, answered) else before


def _list_covered(day: DayFile) -> Sequence[Sequence[int]]:
    """Return the stretches of a recording with samples (start, end), in microseconds."""
    spans_s = ((segment.start_s, segment.end_s) for segment in day.segments)
    drawn = [(round(start_s * MICROSECONDS), round(end_s * MICROSECONDS)) for start_s, end_s in spans_s]
    return drawn or day.facts.get("covered_us", ())  # a recording that is too long has no curve


def read_shifts(
    form: Form, clock: DayClock, covered_us: Sequence[Sequence[int]] = ()
) -> tuple[ShiftWindow, ...] | None:
    """Return the shifts that a person states, none for one report of the whole recording; None if left open.

    ``covered_us``: the stretches with samples, as for :func:`acromion.fusion.shifts.find_by_hours`.

    Raises BadParameter, UnusableCalibration, or UnusableShift if the clock has a time of it twice or never,
    or the recording no samples in it.
    """
    cut, allowed = first(form, "cut"), clock.format_bounds()
    if not cut or clock.start is None:
        return None
    if cut == "whole":
        return ()
    if cut == "hours":
        typed = "-".join(first(form, name).strip() for name in ("hours_start", "hours_end"))
        try:
            windows = find_by_hours(clock.start, clock.duration_us, parse_hours(typed), covered_us)
        except ValueError:
            raise BadParameter(name="shift", value=typed[:60], allowed=HOURS_HINT) from None
        for window in windows:
            window.place(clock.start)
    else:
        lines_s = sorted(window_s for window_s in read_windows(form, "shift", clock) if window_s)
        for (_, end_s), (start_s, _) in pairwise(lines_s):
            if start_s < end_s:
                raise BadParameter(
                    name="shift", value=clock.format(start_s), allowed=f"≥ {clock.format(end_s)}"
                )
        windows = tuple(ShiftWindow(*(_place(clock.start, at_s) for at_s in line_s)) for line_s in lines_s)
    for window in windows:
        if covered_us and not has_samples(*window.place(clock.start), covered_us):
            raise UnusableShift(why="no samples", window=str(window))
    if cut == "hours" and not windows:
        raise UnusableShift(why="no samples", window=typed)
    if not 0 < len(windows) <= MAX_SHIFTS:
        raise BadParameter(name="shift", value=str(len(windows)), allowed=f"1 … {MAX_SHIFTS}; {allowed}")
    return windows


def _place(start: datetime, at_s: float) -> datetime:
    return read_clock(start, round(at_s * MICROSECONDS))


def _asks_shifts(job: Job, day: DayFile) -> bool:
    """Return whether a recording may contain several shifts: at least a day, by a clock."""
    clock, request = DayClock.of(day.facts), job.request
    return clock.start is not None and clock.needs_date and not request.shift and request.source == "samples"


def _check_breaks(form: Form, clock: DayClock) -> None:
    """Refuse a break without its start or end: an open one would exclude the rest of the shift.

    Raises BadParameter.
    """
    columns = (form.get(name, []) for name in ("label", "start", "end"))
    for label, *ends in zip_longest(*columns, fillvalue=""):
        if any(map(str.strip, (label, *ends))) and not all(map(str.strip, ends)):
            raise BadParameter(
                name="break", value=" ".join((label, *ends))[:60], allowed=clock.format_bounds()
            )


def _is_changed(before: ReportRequest, answered: ReportRequest) -> bool:
    return replace(before, reason="") != answered


def _find_job(page: Page, recording_id: str, analysis: str = "") -> Job:
    """Return the analysis to finish: the newest, or the current report if the newest has none.

    Raises NotHere.
    """
    if analysis:
        job = page.services.store.get(analysis)
        if job.recording_id != recording_id:
            raise NotHere
        return job
    found = page.services.store.find_page(JobFilter(recording_id=recording_id), MAX_SHOWN)
    jobs = [job for job in found if job.request.reference is None and job.replaced_by is None]
    if not jobs:
        raise NotHere
    reports = [job for job in jobs if job.state is JobState.SUCCEEDED]
    return reports[0] if jobs[0].is_over and reports else jobs[0]


def _build_asked(page: Page, job: Job) -> dict[str, Any]:
    """Return the day, the question about the shifts or the pose with its small curves, and the pose's state.

    ``is_open``: nobody has stated the pose, also if no stretch can be proposed. ``shifts``: the proposals.

    Raises NoSuchFile or ResultDamaged.
    """
    day = _load_day(page, job)
    shown = build_day(day, job.request, page.language)
    if _asks_shifts(job, day):
        current = find_shifts(page.services, job.recording_id)
        windows = sorted(one.request.shift for one in current) or day.facts.get("shifts", ())
        shifts = _list_shifts(day, page, windows)
        curves = [draw_shifts(day, shifts, page, width_px) for width_px in (WIDE, NARROW)]
        return {
            "day": shown,
            "shifts": shifts,
            "is_cut": bool(current),
            "stayed": any(one.request.pose_from for one in current),
            "curves": curves,
            "start": format_iso_moment(shown["start"], page.language),
        }
    question = next((one for one in shown["questions"] if one.key == "which-pose"), None)
    page_one = read_page_one(page.services, job, None, page.language)
    state = page_one.report.pose_state if page_one else ""
    start = format_iso_moment(shown["start"], page.language)
    found = (find_results(page.services, job) or {}).get("calibration") or {}
    is_open = question is not None or found.get("state") in OPEN_POSES
    choices = question.choices if question else ()
    curves = [draw_start(day, choices, page, width_px) for width_px in (WIDE, NARROW)] if is_open else []
    known = {"choices": choices, "pose_state": state, "is_open": is_open, "start": start}
    return {"day": shown, "question": question, "curves": curves, **known}


@dataclass(frozen=True, slots=True)
class ShiftLine:
    """A proposed shift: times of the fields, in s for the curve, and for reading."""

    start: str
    end: str
    start_s: float
    end_s: float
    span: str


def _list_shifts(day: DayFile, page: Page, windows: Sequence[str]) -> list[ShiftLine]:
    clock = DayClock.of(day.facts)
    assert clock.start is not None
    lines = []
    for window in map(parse_interval, windows):
        start_s, end_s = (at_us / MICROSECONDS for at_us in window.place(clock.start))
        shown = clock.show_span(start_s, end_s, page.language)
        lines.append(ShiftLine(clock.format(start_s), clock.format(end_s), start_s, end_s, shown))
    return lines


def draw_shifts(day: DayFile, shifts: Sequence[ShiftLine], page: Page, width_px: float) -> str:
    """Draw the whole recording as a small curve, with each proposed shift marked and each date."""
    words, duration_s = page.words()["finish"], DayClock.of(day.facts).duration_s
    marks = [(shift.start_s, shift.end_s, f"{place}") for place, shift in enumerate(shifts)]
    listed = "; ".join(f"{n}: {shift.span}" for n, shift in enumerate(shifts, 1))
    described = (str(words["curve_whole"]), fill(words["shift_list"], {"list": listed}) if listed else "")
    return _draw(day, marks, (f"shifts-{width_px:.0f}", *described), page, width_px, duration_s)


def draw_start(day: DayFile, choices: Sequence[Choice], page: Page, width_px: float) -> str:
    """Draw the start of the recording as a small curve, with each stretch that may be the pose marked."""
    words, marks = page.words()["finish"], _list_marks(choices)
    last_s = max((stop_s for _, stop_s, _ in marks), default=0.0)
    end_s = min(max(last_s + AROUND_S, SHORTEST_VIEW_S), DayClock.of(day.facts).duration_s)
    listed = "; ".join(f"{n}: {choice.span}" for n, choice in enumerate(_list_stretches(choices), 1))
    described = (str(words["curve"]), fill(words["curve_list"], {"list": listed}))
    return _draw(day, marks, (f"start-{width_px:.0f}", *described), page, width_px, end_s)


def _draw(
    day: DayFile,
    marks: Sequence[tuple[float, float, str]],
    named: tuple[str, str, str],
    page: Page,
    width_px: float,
    end_s: float,
) -> str:
    """Draw the curve until ``end_s`` with numbered marks; ``named``: key, title and description."""
    clock, plot_px, (key, *described) = DayClock.of(day.facts), width_px - SCALE_PX, named

    def place(at_s: float) -> float:
        return at_s / end_s * plot_px

    def rise(angle_deg: float) -> float:
        return BASE_PX - angle_deg / TOP_DEG * (BASE_PX - TOP_PX)

    body = []
    free_px = 0.0
    for number_of, (start_s, stop_s, value) in enumerate(marks, 1):
        left_px, wide_px = place(start_s), max(place(stop_s) - place(start_s), 3.0)
        middle_px = left_px + wide_px / 2
        body.append(rect(left_px, TOP_PX, wide_px, BASE_PX - TOP_PX, f'class="stretch" data-value="{value}"'))
        if middle_px >= free_px:  # a number never covers the one before it
            body.append(text(middle_px, TOP_PX - 6, str(number_of), "strong", "middle"))
            free_px = middle_px + LABEL_PX
    for x_px in map(place, _list_midnights(clock, end_s)):
        body += [line(x_px, TOP_PX, x_px, BASE_PX, f'{RULE} stroke-width="0.6"')]
    for angle_deg in (0.0, 90.0):
        body += [line(0, rise(angle_deg), plot_px, rise(angle_deg), f'{RULE} stroke-width="0.6"')]
        body += [text(width_px, rise(angle_deg) + 4, f"{angle_deg:.0f}°", anchor="end")]
    commands = []
    for stretch in day.cut(0.0, end_s, int(plot_px)):
        for step, (low, high) in enumerate(zip(stretch.low, stretch.high, strict=True)):
            if low is not None and high is not None:
                x_px = place(stretch.start_s + step * stretch.step_s)
                if 0.0 <= x_px <= plot_px:
                    commands.append(f"M{number(x_px)} {number(rise(high))}V{number(rise(low) + 0.8)}")
    body.append(path("".join(commands), f'class="trace" fill="none" stroke="{RAMP[3]}"'))
    ends = [clock.show(at_s, page.language, with_seconds=end_s < DAY_S) for at_s in (0.0, end_s)]
    body.append(text(0, HEIGHT_PX - 3, ends[0]))
    body.append(text(plot_px, HEIGHT_PX - 3, ends[1], anchor="end"))
    return picture(width_px, HEIGHT_PX, key, (described[0], described[1]), body)


def _list_midnights(clock: DayClock, end_s: float) -> list[float]:
    """Return the start of each date until ``end_s``, in s from the first sample."""
    if clock.start is None:
        return []
    first = datetime.combine(clock.start.date(), time(), clock.start.tzinfo)
    days = range(1, int(end_s / DAY_S) + 2)
    found = [measure_us(clock.start, first + timedelta(days=number)) / MICROSECONDS for number in days]
    return [at_s for at_s in found if at_s < end_s]


def _list_stretches(choices: Sequence[Choice]) -> list[Choice]:
    return [choice for choice in choices if choice.value != START]


def _list_marks(choices: Sequence[Choice]) -> list[tuple[float, float, str]]:
    """Return start and end, s, and value of each proposed stretch, in the order of the choices."""
    marks = []
    for choice in _list_stretches(choices):
        start_s, _, stop_s = choice.value.partition("-")
        marks.append((float(start_s), float(stop_s), choice.value))
    return marks
