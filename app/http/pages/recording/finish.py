"""The card after an upload: it asks for the person, the arm, the pose and the breaks.

A file name, its folders and a list of participants only propose: nothing is used before a person saves it.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import zip_longest
from pathlib import Path
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Response

from app.batch.folder import Task
from app.batch.inputs import assign_participants
from app.errors import BadParameter, NoSuchFile, NotFinished, NotHere, ResultDamaged
from app.http.pages.recording.analysis import find_results
from app.http.pages.recording.day import (
    START,
    Choice,
    DayClock,
    add_correction,
    build_day,
    choose_pose,
    load_day,
    place_rows,
    read_rows,
    read_whose,
    read_windows,
)
from app.http.pages.recording.page_one import read_page_one
from app.http.pages.rendering import Form, Page, UsedForm, UsedPage, first, read_body
from app.http.pages.views import OPEN_POSES, build_row, find_durations, find_path
from app.library.jobs import JobFilter
from app.library.listing import Entry
from app.library.rows import Job, JobState
from app.report.charts.svg import NARROW, RAMP, RULE, WIDE, line, number, path, picture, rect, text
from app.report.words.numbers import format_iso_moment
from app.report.words.wording import fill
from app.request import ReportRequest, propose_description
from app.store.day_file import DayFile

router = APIRouter(include_in_schema=False, prefix="/recordings/{recording_id}/finish")

OTHER = "other"
"""The answer that the pose was held at the typed times."""
AROUND_S, SHORTEST_VIEW_S = 60.0, 300.0
TOP_PX, BASE_PX, HEIGHT_PX, SCALE_PX = 20.0, 110.0, 126.0, 30.0
LABEL_PX = 18.0
TOP_DEG = 180.0
MAX_SHOWN = 200


@router.get("")
def show_finish(recording_id: str, page: UsedPage) -> Response:
    """Ask the open questions of a recording."""
    job = _find_job(page, recording_id)
    entry = Entry(job, None)
    row = build_row(job, page.language, find_durations(page.services, [entry]))
    proposal = propose_description(str(find_path(page.services, job)))
    asked: dict[str, Any] = dict.fromkeys(("day", "question", "choices", "pose_state", "curves", "is_open"))
    if job.state is JobState.SUCCEEDED:
        with suppress(ResultDamaged, NoSuchFile):
            asked |= _build_asked(page, job)
    return page.render("recording/finish.html", row=row, job=job, proposal=proposal, **asked)


@router.post("")
def finish(recording_id: str, page: UsedPage, form: UsedForm) -> Response:
    """Store the answers; if one is new, make the next version of the report with them."""
    job = page.services.store.get(first(form, "analysis"))
    if job.recording_id != recording_id:
        raise NotHere
    if not job.is_over:
        raise NotFinished(state=job.state)
    day = None
    with suppress(NoSuchFile):
        day = load_day(page.services, job)
    answered = read_answers(job.request, form, day)
    if answered != job.request:
        job = add_correction(page.services, job, answered)
    return page.go(f"/analyses/{job.id}")


@router.post("/proposal")
def propose(recording_id: str, page: UsedPage, body: Annotated[bytes, Depends(read_body)]) -> dict[str, str]:
    """Return the subject and arm of this recording in a list of participants; nothing is stored.

    Raises UnusableParticipants.
    """
    job = _find_job(page, recording_id)
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


def _find_job(page: Page, recording_id: str) -> Job:
    """Return the analysis to finish: the newest, or the current report if the newest has none.

    Raises NotHere.
    """
    found = page.services.store.find_page(JobFilter(recording_id=recording_id), MAX_SHOWN)
    jobs = [job for job in found if job.request.reference is None and job.replaced_by is None]
    if not jobs:
        raise NotHere
    reports = [job for job in jobs if job.state is JobState.SUCCEEDED]
    return reports[0] if jobs[0].is_over and reports else jobs[0]


def _build_asked(page: Page, job: Job) -> dict[str, Any]:
    """Return the day, the question about the pose with its small curves, and the state of the pose.

    ``is_open``: nobody has stated the pose, also if no stretch can be proposed.

    Raises NoSuchFile or ResultDamaged.
    """
    day = load_day(page.services, job)
    shown = build_day(day, job.request, page.language)
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


def draw_start(day: DayFile, choices: Sequence[Choice], page: Page, width_px: float) -> str:
    """Draw the start of the recording as a small curve, with each stretch that may be the pose marked."""
    clock, words, key = DayClock.of(day.facts), page.words()["finish"], f"start-{width_px:.0f}"
    marks = _list_marks(choices)
    last_s = max((stop_s for _, stop_s, _ in marks), default=0.0)
    end_s = min(max(last_s + AROUND_S, SHORTEST_VIEW_S), clock.duration_s)
    plot_px = width_px - SCALE_PX

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
    body.append(text(0, HEIGHT_PX - 3, clock.show(0.0, page.language)))
    body.append(text(plot_px, HEIGHT_PX - 3, clock.show(end_s, page.language), anchor="end"))
    listed = "; ".join(f"{n}: {choice.span}" for n, choice in enumerate(_list_stretches(choices), 1))
    described = (str(words["curve"]), fill(words["curve_list"], {"list": listed}))
    return picture(width_px, HEIGHT_PX, key, described, body)


def _list_stretches(choices: Sequence[Choice]) -> list[Choice]:
    return [choice for choice in choices if choice.value != START]


def _list_marks(choices: Sequence[Choice]) -> list[tuple[float, float, str]]:
    """Return start and end, s, and value of each proposed stretch, in the order of the choices."""
    marks = []
    for choice in _list_stretches(choices):
        start_s, _, stop_s = choice.value.partition("-")
        marks.append((float(start_s), float(stop_s), choice.value))
    return marks
