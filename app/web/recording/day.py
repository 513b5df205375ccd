"""The day of one analysis: its curve in pieces, how still a window is, the diary, and another analysis."""

import csv
import io
from collections.abc import Sequence
from dataclasses import asdict, replace
from itertools import zip_longest
from typing import Annotated, Any, TypeVar, get_args

import numpy as np
from fastapi import APIRouter, Depends, Query, Request, Response
from fastapi.responses import JSONResponse, RedirectResponse
from pydantic import BaseModel, Field
from starlette.status import HTTP_303_SEE_OTHER

from app.errors import BadParameter, NoSuchFile
from app.jobs.job import Job, JobState
from app.report.words.numbers import format_duration, format_percent
from app.report.words.subject import MAX_TEXT
from app.request import SUBJECT_HINT, ReportRequest, check_subject, find_window_hint
from app.services import Services, UsedLanguage, UsedServices
from app.storage.day_file import DAY_NAME, DayFile, open_day
from app.web.forms import Form, UsedForm, first, read_body
from app.web.recording.day_views import NO, START, YES, DayClock, name_choice, place_rows
from app.web.rendering import find_base
from fusion.conventions import AXIS_HINT, MAIN_THRESHOLD_DEG, ArmAxis, Pose, PoseHeld, Side, parse_arm_axis
from fusion.diary import DiaryEntry, read_diary
from fusion.errors import UnusableCalibration
from fusion.pose.rules import RULES, object_to_window, score_still_period

# Corrections on the page of an analysis: arm, pose, window, periods of the day.


NO_POSE = "axis"
"""What the form says in place of a pose where none was held."""
Window = tuple[float, float]
COLUMNS = ("start", "end", "kind", "label")
SECONDS = ("start_s", "end_s", "kind", "label")
"""The columns of the diary of a recording without a clock; the fields of the form are always COLUMNS."""
BOM = "\ufeff"

T = TypeVar("T", bound=str)


def correct_request(
    before: ReportRequest, form: Form, clock: DayClock, used_s: tuple[Window, ...] = ()
) -> ReportRequest:
    """Give the request of the next analysis; ``used_s``: the windows that the one before used.

    Raises BadParameter, UnusableDiary or UnusableCalibration.
    """
    known = _read_pose(before, form, clock, used_s)
    hint = find_window_hint(known.pose, len(known.calibration_windows_s), known.arm_axis)
    if hint:
        raise BadParameter(name="calibration", value=str(len(known.calibration_windows_s)), allowed=hint)
    try:
        subject = check_subject(first(form, "subject"))
    except ValueError:
        typed = first(form, "subject")[:60]
        raise BadParameter(name="subject", value=typed, allowed=SUBJECT_HINT) from None
    diary = read_rows(form, clock)
    place_rows(diary, clock)  # so that a row that cannot be placed is refused at once
    sides: tuple[Side, ...] = get_args(Side)
    held: tuple[PoseHeld, ...] = get_args(PoseHeld)
    return replace(
        known,
        subject=subject,
        side=_choose(sides, first(form, "side"), "side") if first(form, "side") else None,
        pose_held=_choose(held, first(form, "held"), "held") if first(form, "held") else None,
        slip_times_s=_read_times(first(form, "slips"), "slip_at", clock),
        no_slip_times_s=_read_times(first(form, "no_slips"), "no_slip_at", clock),
        diary=diary,
        reason=first(form, "reason").strip()[:MAX_TEXT],
    )


def read_rows(form: Form, clock: DayClock) -> tuple[DiaryEntry, ...]:
    """Return the periods of the form; rows without a time are left aside.

    Raises
    ------
    fusion.errors.UnusableDiary
        With the row as ``line``, counted from 1 with the heading.
    """
    rows = [
        row for row in zip_longest(*(form.get(name, []) for name in COLUMNS), fillvalue="") if row[0].strip()
    ]
    return read_diary(write_csv(rows, clock)) if rows else ()


def write_csv(rows: list[tuple[str, ...]], clock: DayClock, *, bom: str = "") -> bytes:
    """Write rows of start, end, kind, label as a diary that we read again."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, delimiter=";")
    writer.writerows([COLUMNS if clock.start else SECONDS, *rows])
    return (bom + text.getvalue()).encode()


def _read_pose(
    before: ReportRequest, form: Form, clock: DayClock, used_s: tuple[Window, ...]
) -> ReportRequest:
    """Read how the sensor is tied to the arm: by an axis that was strapped along it, or by a pose."""
    if first(form, "pose") == NO_POSE:
        return replace(before, calibration_windows_s=(), arm_axis=_choose_axis(first(form, "axis")))
    poses: tuple[Pose, ...] = get_args(Pose)
    pose = _choose(poses, first(form, "pose"), "pose")
    windows_s = _read_windows(form, "window", clock)
    if pose == "two-point":
        windows_s = [*windows_s[:1], *_read_windows(form, "level", clock)]
    elif windows_s[:1] == [None] and any(windows_s) and used_s:
        windows_s[0] = used_s[0]  # held again, besides the one that the software found
    given_s = tuple(window_s for window_s in windows_s if window_s is not None)
    return replace(before, pose=pose, calibration_windows_s=given_s, arm_axis=None)


def _read_windows(form: Form, name: str, clock: DayClock) -> list[Window | None]:
    """Read the windows that were typed; None for an empty one, which leaves the choice to the software."""
    windows_s: list[Window | None] = []
    for pair in zip_longest(form.get(f"{name}_start", []), form.get(f"{name}_end", []), fillvalue=""):
        typed = [moment.strip() for moment in pair]
        if not any(typed):
            windows_s.append(None)
            continue
        if not all(typed):
            window = " – ".join(moment or "?" for moment in typed)
            raise BadParameter(name="calibration", value=window[:60], allowed=clock.format_bounds())
        start_s, end_s = (clock.read(moment, "calibration") for moment in typed)
        if end_s <= start_s:
            raise UnusableCalibration(why="end first", start_s=start_s, end_s=end_s)
        windows_s.append((start_s, end_s))
    return windows_s


def _read_times(text: str, name: str, clock: DayClock) -> tuple[float, ...]:
    """Read moments at which the sensor slipped, or did not, with ";" between them."""
    return tuple(clock.read(moment.strip(), name) for moment in text.split(";") if moment.strip())


def _choose_axis(text: str) -> ArmAxis:
    try:
        return parse_arm_axis(text)
    except ValueError:
        raise BadParameter(name="axis", value=text[:60], allowed=AXIS_HINT) from None


def _choose(allowed: tuple[T, ...], text: str, name: str) -> T:
    for choice in allowed:
        if choice == text:
            return choice
    raise BadParameter(name=name, value=text[:60], allowed=", ".join(allowed))


MOST_POINTS = 4000
MOST_SPANS = 200
LATEST_S = 1e8

router = APIRouter(include_in_schema=False, prefix="/analyses/{analysis_id}")
Second = Annotated[float, Query(ge=0, le=LATEST_S)]


class Piece(BaseModel):
    """A stretch of a curve, and into how many pieces it is cut."""

    from_s: Annotated[float, Field(ge=0, le=LATEST_S)]
    to_s: Annotated[float, Field(ge=0, le=LATEST_S)]
    points: Annotated[int, Field(ge=1, le=MOST_POINTS)] = 1200


@router.get("/curve")
def curve(analysis_id: str, services: UsedServices, piece: Annotated[Piece, Query()]) -> Response:
    """Give the lowest and highest angle in each of about ``points`` pieces of a stretch."""
    return cut_curve(find_day(services, services.store.get(analysis_id)), piece)


def cut_curve(day: DayFile, piece: Piece) -> Response:
    """Answer with a stretch of a curve."""
    stretches = [asdict(stretch) for stretch in day.cut(piece.from_s, piece.to_s, piece.points)]
    return JSONResponse({"stretches": stretches})


@router.get("/stillness")
def stillness(analysis_id: str, services: UsedServices, start_s: Second, end_s: Second) -> dict[str, Any]:
    """Say how still the arm was in a window, and why the window would be refused.

    ``score``: 0 to 1, as the calibration scores it, null in a hole; ``why``: a term of E-CALIBRATION or "".
    """
    day = find_day(services, services.store.get(analysis_id))
    quiet = day.measure_quiet(start_s, end_s)
    if quiet is None:
        return {"score": None, "why": "short" if end_s - start_s < RULES.shortest_window_s else "hole"}
    gravity_g, sd_g = quiet
    score = score_still_period(end_s - start_s, sd_g, np.asarray(gravity_g))
    return {"score": round(score, 3), "why": object_to_window(end_s - start_s, sd_g, np.asarray(gravity_g))}


@router.get("/share")
def share(
    analysis_id: str,
    services: UsedServices,
    language: UsedLanguage,
    span: Annotated[list[str], Query(min_length=1, max_length=MOST_SPANS)],
) -> dict[str, Any]:
    """Give the time above 60 deg in stretches, each ``start,end`` in s, as of a task of the diary."""
    day = find_day(services, services.store.get(analysis_id))
    valid_s = above_s = 0.0
    for text in span:
        try:
            start_s, end_s = (float(part) for part in text.split(","))
        except ValueError:
            start_s = end_s = 0.0
        if not 0.0 <= start_s < end_s <= LATEST_S:
            raise BadParameter(name="span", value=text[:60], allowed="start,end (s)")
        valid, above = day.measure_above(start_s, end_s, MAIN_THRESHOLD_DEG)
        valid_s, above_s = valid_s + valid, above_s + above
    percent = 100.0 * above_s / valid_s if valid_s else None
    told = (format_duration(above_s, language), format_percent(percent, language))
    return {"percent": percent, "words": "{} ({})".format(*told) if valid_s else told[1]}


@router.post("/again")
def analyse_again(analysis_id: str, request: Request, services: UsedServices, form: UsedForm) -> Response:
    """Analyse the recording once more, as corrected on the page; the earlier analysis stays as it is."""
    job = services.store.get(analysis_id)
    facts = find_day(services, job).facts
    used_s = tuple((start_s, end_s) for start_s, end_s, *_ in facts["calibration"])
    corrected = correct_request(job.request, form, DayClock.of(facts), used_s)
    return _add_again(job, corrected, request, services)


@router.post("/pose")
def name_pose(analysis_id: str, request: Request, services: UsedServices, form: UsedForm) -> Response:
    """Analyse the recording once more, with one of the proposed stretches as the pose.

    A stretch after the sensor moved is a pose beside those before it; ``start`` states that the pose was held
    at the start of wear.
    """
    job = services.store.get(analysis_id)
    facts = find_day(services, job).facts
    before_s = job.request.calibration_windows_s or tuple((a, b) for a, b, *_ in facts["calibration"])
    choices_s: dict[str, tuple[Window, ...]] = {START: ()}
    choices_s |= {name_choice(a, b): ((a, b),) for a, b in facts["asked"]}
    choices_s |= {
        name_choice(a, b): (*before_s, (a, b)) for *_, stills in facts.get("unread", ()) for a, b in stills
    }
    choice = first(form, "choice")
    if choice not in choices_s:
        raise BadParameter(name="choice", value=choice[:60], allowed=", ".join(choices_s))
    held: PoseHeld | None = "start" if choice == START else job.request.pose_held
    named = replace(
        job.request, calibration_windows_s=choices_s[choice], pose_held=held, arm_axis=None, reason=""
    )
    return _add_again(job, named, request, services)


@router.post("/moved")
def answer_move(analysis_id: str, request: Request, services: UsedServices, form: UsedForm) -> Response:
    """Analyse the recording once more, with the answer to whether the sensor moved on the arm."""
    job = services.store.get(analysis_id)
    before, middles_s = job.request, dict[str, float]()
    for place, (_, start_s, end_s, _) in enumerate(find_day(services, job).facts.get("moves", ())):
        middles_s |= dict.fromkeys((f"{place}-{YES}", f"{place}-{NO}"), float(round((start_s + end_s) / 2.0)))
    answer = first(form, "answer")
    if answer not in middles_s:
        raise BadParameter(name="answer", value=answer[:60], allowed=", ".join(middles_s))
    if answer.endswith(YES):
        slips_s = tuple(sorted((*before.slip_times_s, middles_s[answer])))
        answered = replace(before, slip_times_s=slips_s, reason="")
    else:
        no_slips_s = tuple(sorted((*before.no_slip_times_s, middles_s[answer])))
        answered = replace(before, no_slip_times_s=no_slips_s, reason="")
    return _add_again(job, answered, request, services)


@router.post("/other-pose")
def try_other_pose(analysis_id: str, request: Request, services: UsedServices, form: UsedForm) -> Response:
    """Analyse once more what no pose could be found for, by an axis, or else without the windows given."""
    job = services.store.get(analysis_id)
    axis = _choose_axis(first(form, "axis")) if first(form, "axis") else None
    pose = "n-pose" if job.request.pose == "two-point" else job.request.pose
    other = replace(job.request, pose=pose, calibration_windows_s=(), arm_axis=axis, reason="")
    return _add_again(job, other, request, services)


def say_whose(services: Services, job: Job, asked: ReportRequest, names: Sequence[str]) -> None:
    """Write what is asked of these names (subject, side) on the recording, for its next analysis to know."""
    row = services.recordings.get(job.recording_id)
    about = replace(row.about, **{name: getattr(asked, name) for name in names})
    if about != row.about:
        services.recordings.describe(row, about)


def _add_again(job: Job, corrected: ReportRequest, request: Request, services: Services) -> Response:
    said = [name for name in ("subject", "side") if getattr(corrected, name) != getattr(job.request, name)]
    again = services.store.correct(job, corrected)
    say_whose(services, job, corrected, said)
    address = f"{find_base(request)}/analyses/{again.id}?before={job.id}"
    return RedirectResponse(address, HTTP_303_SEE_OTHER)


@router.post("/diary")
def import_diary(
    analysis_id: str, services: UsedServices, body: Annotated[bytes, Depends(read_body)]
) -> list[dict[str, Any]]:
    """Read a diary as CSV and give its rows as the form shows them; nothing is changed."""
    job = services.store.get(analysis_id)
    return place_rows(read_diary(body), DayClock.of(find_day(services, job).facts))


@router.post("/diary.csv")
def export_diary(analysis_id: str, services: UsedServices, form: UsedForm) -> Response:
    """Give the rows of the form as a diary, for another recording or another program."""
    job = services.store.get(analysis_id)
    clock = DayClock.of(find_day(services, job).facts)
    rows = place_rows(read_rows(form, clock), clock)
    body = write_csv([tuple(row[name] for name in COLUMNS) for row in rows], clock, bom=BOM)
    headers = {"Content-Disposition": 'attachment; filename="diary.csv"'}
    return Response(body, media_type="text/csv; charset=utf-8", headers=headers)


def find_day(services: Services, job: Job, name: str = DAY_NAME) -> DayFile:
    """Open the day of a finished analysis, or one of the two curves of a comparison.

    Raises NoSuchFile or ResultDamaged.
    """
    if job.state is not JobState.SUCCEEDED:
        raise NoSuchFile(name=name)
    with services.results.borrow(job, name) as path:
        return open_day(path)
