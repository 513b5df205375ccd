"""The day of one analysis: its curve, its diary, its corrections and the open questions.

The clock of the day comes first, then the correction form, the routes, and the view for the page.
"""

import csv
import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import datetime
from itertools import zip_longest
from typing import Annotated, Any, Literal, TypeVar, get_args

import numpy as np
from fastapi import APIRouter, Depends, Query, Response
from fastapi.responses import JSONResponse
from pydantic import BaseModel, Field

from acromion.app.errors import BadParameter, NoSuchFile
from acromion.app.http.api.library.files import MEDIA_TYPES, respond_with_file
from acromion.app.http.pages.rendering import Form, Page, UsedForm, UsedPage, first, read_diary_body
from acromion.app.library.jobs import JobFilter
from acromion.app.library.recordings import DESCRIBED
from acromion.app.library.rows import Job, JobState
from acromion.app.report.words.numbers import (
    Clock,
    add_offset,
    format_angle,
    format_clock,
    format_duration,
    format_elapsed,
    format_moment,
    format_number,
    format_percent,
)
from acromion.app.report.words.wording import MAX_TEXT, Language, Words, fill, load_wording
from acromion.app.request import (
    ISCO_HINT,
    SUBJECT_HINT,
    ReportRequest,
    check_isco,
    check_job_title,
    check_subject,
    find_window_hint,
)
from acromion.app.services import Services
from acromion.app.store.day_file import DAY_NAME, DayFile, open_day
from acromion.fusion.clocks import (
    OFFSET_HINT,
    find_instants,
    format_clock_offset,
    in_zone,
    is_repeated,
    list_zone_changes,
    parse_clock_offset,
    parse_time_zone,
    read_clock,
)
from acromion.fusion.conventions import (
    ARM_AXES,
    AXIS_HINT,
    MAIN_THRESHOLD_DEG,
    ArmAxis,
    Pose,
    PoseHeld,
    Side,
    parse_arm_axis,
)
from acromion.fusion.diary import KINDS, DiaryEntry, read_diary, read_moment
from acromion.fusion.errors import UnusableCalibration, UnusableDiary
from acromion.fusion.exposure.periods import place_diary, place_moment
from acromion.fusion.pose.rules import RULES, score_still_period, window_rejection_reason
from acromion.fusion.recording import MICROSECONDS

# Times of a recording as typed and shown: on the device's clock, or in seconds without one.


DAY_S = 86400.0
AROUND_S = 7200
"""No change of a zone repeats or omits more of the clock."""
SHOWN_US = 10_000
"""Times are shown in hundredths of a second, so a typed time may be outside the recording by this much."""


@dataclass(frozen=True, slots=True)
class DayClock:
    """The start and duration of a recording; times follow the changes of a known zone."""

    start: datetime | None
    duration_us: int

    @classmethod
    def of(cls, facts: Mapping[str, Any]) -> "DayClock":
        """Build the clock from the facts of a day file."""
        return cls(read_start(facts), int(facts["duration_us"]))

    @property
    def duration_s(self) -> float:
        """Seconds from the first sample to the end."""
        return self.duration_us / MICROSECONDS

    @property
    def changes(self) -> list[tuple[float, int]]:
        """The changes of the zone, also just outside: seconds from the first sample, and the step in s."""
        if self.start is None:
            return []
        early = read_clock(self.start, -AROUND_S * MICROSECONDS)
        found = list_zone_changes(early, self.duration_us + 2 * AROUND_S * MICROSECONDS)
        return [(at_s - AROUND_S, step_s) for at_s, step_s in found]

    @property
    def needs_date(self) -> bool:
        """Whether a time of day without a date can be ambiguous."""
        return self.duration_s >= DAY_S

    def report(self, language: Language) -> Clock:
        """Return the clock as the report writes it."""
        return Clock(self.start, language, self.duration_s)

    def format(self, elapsed_s: float) -> str:
        """Format a time for a field, so that :meth:`read` returns it, to a hundredth of a second."""
        if self.start is None:
            return f"{elapsed_s:.2f}".rstrip("0").rstrip(".")
        moment = read_clock(self.start, round(round(elapsed_s, 2) * MICROSECONDS))
        hundredths = f".{moment.microsecond // 10_000:02d}".rstrip("0").rstrip(".")
        offset = moment.isoformat()[-6:] if is_repeated(moment) else ""
        shown = "%Y-%m-%d %H:%M:%S" if self.needs_date or offset else "%H:%M:%S"
        return moment.strftime(shown) + hundredths + offset

    def show(self, elapsed_s: float, language: Language, *, with_seconds: bool = True) -> str:
        """Format a time for reading: "07:05:09"; in French "7 h 05 min 09 s"."""
        if self.start is None:
            return self.format(elapsed_s)
        moment = read_clock(self.start, round(elapsed_s) * MICROSECONDS)
        write = format_moment if self.report(language).format_day(elapsed_s) else format_clock
        shown = write(moment, language, with_seconds=with_seconds)
        return add_offset(shown, moment) if is_repeated(moment) else shown

    def show_span(self, start_s: float, end_s: float, language: Language) -> str:
        """Format both ends of a time range for reading."""
        return f"{self.show(start_s, language)} – {self.show(end_s, language)}"

    def format_bounds(self) -> str:
        """Format the allowed range of times."""
        return f"{self.format(0.0)} … {self.format(self.duration_s)}"

    def _format_readings(self, error: Exception) -> str:
        """Format both readings of a time that the zone shows twice, each with its offset; else ""."""
        facts = error.facts if isinstance(error, UnusableDiary) else {}
        if facts.get("why") != "twice" or self.start is None or self.start.tzinfo is None:
            return ""
        instants = find_instants(datetime.fromisoformat(str(facts["value"])), self.start.tzinfo)
        return ", ".join(str(instant) for instant in instants)

    def read(self, text: str, name: str) -> float:
        """Parse a typed time, in seconds from the first sample. Raises BadParameter."""
        clock, seconds = ("", text) if self.start is None else (text, "")
        try:
            moment = read_moment(0, clock, seconds)
            placed_us = place_moment(text if moment is None else moment, 0, self.start, self.duration_us)
            if not -SHOWN_US <= placed_us <= self.duration_us + SHOWN_US:
                raise ValueError
        except (UnusableDiary, ValueError) as error:
            allowed = self._format_readings(error) or self.format_bounds()
            raise BadParameter(name=name, value=text[:60], allowed=allowed) from None
        return min(max(placed_us, 0), self.duration_us) / MICROSECONDS


@dataclass(frozen=True, slots=True)
class PeriodRow:
    """A period or mark of the diary in the form; its times can be typed again."""

    kind: str
    label: str
    start: str
    end: str


def place_rows(entries: Sequence[DiaryEntry], clock: DayClock) -> list[PeriodRow]:
    """Return the rows of a diary for the form. Raises UnusableDiary."""
    placed = place_diary(entries, clock.start, clock.duration_us)
    periods = [
        PeriodRow(
            period.kind,
            period.label,
            clock.format(period.start_us / MICROSECONDS),
            clock.format(period.end_us / MICROSECONDS),
        )
        for period in placed.periods
    ]
    marks = [
        PeriodRow("mark", mark.label, clock.format(mark.time_us / MICROSECONDS), "") for mark in placed.marks
    ]
    postures = [
        PeriodRow(
            "posture",
            period.label,
            clock.format(period.start_us / MICROSECONDS),
            clock.format(period.end_us / MICROSECONDS),
        )
        for period in placed.measured
    ]
    return periods + marks + postures


def read_start(facts: Mapping[str, Any]) -> datetime | None:
    """Return the stored start of a recording, in its zone if that is stored and known."""
    start = datetime.fromisoformat(facts["start"]) if facts.get("start") else None
    return in_zone(start, facts.get("time_zone"))


# Corrections on the page of an analysis: arm, pose, window, periods of the day.

NO_POSE = "axis"
"""The form's value in place of a pose if none was held."""
Window = tuple[float, float]
COLUMNS = ("start", "end", "kind", "label")
SECONDS = ("start_s", "end_s", "kind", "label")
"""The diary columns of a recording without a clock; the form always uses COLUMNS."""
BOM = "\ufeff"

T = TypeVar("T", bound=str)


def correct_request(
    before: ReportRequest, form: Form, clock: DayClock, used_s: tuple[Window, ...] = ()
) -> ReportRequest:
    """Return the corrected request; ``used_s`` are the windows that the previous analysis used.

    Raises BadParameter, UnusableDiary or UnusableCalibration.
    """
    known = _read_pose(before, form, clock, used_s)
    hint = find_window_hint(known.pose, len(known.calibration_windows_s), known.arm_axis)
    if hint:
        raise BadParameter(name="calibration", value=str(len(known.calibration_windows_s)), allowed=hint)
    diary, (time_zone, offset_s) = read_rows(form, clock), _read_clock_settings(before, form)
    if (time_zone, offset_s) == (before.time_zone, before.clock_offset_s):
        place_rows(diary, clock)  # raises if a row cannot be placed
    held: tuple[PoseHeld, ...] = get_args(PoseHeld)
    return replace(
        read_whose(known, form),
        pose_held=_choose(held, first(form, "held"), "held") if first(form, "held") else None,
        slip_times_s=_read_times(first(form, "slips"), "slip_at", clock),
        no_slip_times_s=_read_times(first(form, "no_slips"), "no_slip_at", clock),
        diary=diary,
        reason=first(form, "reason").strip()[:MAX_TEXT],
        time_zone=time_zone,
        clock_offset_s=offset_s,
    )


def _read_clock_settings(before: ReportRequest, form: Form) -> tuple[str, float]:
    """Return the time zone and the correction of the clock; a form without these fields changes neither."""
    zone, offset = first(form, "time_zone").strip(), first(form, "clock_offset").strip()
    if "time_zone" not in form:
        return before.time_zone, before.clock_offset_s
    try:
        name = parse_time_zone(zone)
    except ValueError as error:
        raise BadParameter(name="time_zone", value=zone[:60], allowed=str(error)) from None
    try:
        return name, parse_clock_offset(offset) if offset else 0.0
    except ValueError:
        raise BadParameter(name="clock_offset", value=offset[:60], allowed=OFFSET_HINT) from None


def read_whose(before: ReportRequest, form: Form) -> ReportRequest:
    """Return the request with the subject, arm and job of the form. Raises BadParameter."""
    try:
        subject = check_subject(first(form, "subject"))
    except ValueError:
        typed = first(form, "subject")[:60]
        raise BadParameter(name="subject", value=typed, allowed=SUBJECT_HINT) from None
    sides: tuple[Side, ...] = get_args(Side)
    side = _choose(sides, first(form, "side"), "side") if first(form, "side") else None
    return replace(
        before,
        subject=subject,
        side=side,
        job_title=_read_job(form, "job_title", before.job_title),
        isco_code=_read_job(form, "isco_code", before.isco_code),
    )


def _read_job(form: Form, name: Literal["job_title", "isco_code"], before: str) -> str:
    """Return a field of the job; a form without it does not clear it. Raises BadParameter."""
    check, hint = (check_isco, ISCO_HINT) if name == "isco_code" else (check_job_title, SUBJECT_HINT)
    try:
        return check(first(form, name)) if name in form else before
    except ValueError:
        raise BadParameter(name=name, value=first(form, name)[:60], allowed=hint) from None


def read_rows(form: Form, clock: DayClock) -> tuple[DiaryEntry, ...]:
    """Return the periods of the form; rows without a start are ignored.

    Raises UnusableDiary; its ``line`` counts rows from 1, including the heading.
    """
    rows = [
        row for row in zip_longest(*(form.get(name, []) for name in COLUMNS), fillvalue="") if row[0].strip()
    ]
    return read_diary(write_csv(rows, clock)) if rows else ()


def write_csv(rows: Sequence[tuple[str, ...]], clock: DayClock, *, bom: str = "") -> bytes:
    """Format rows of start, end, kind, label as a diary that can be read again."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, delimiter=";")
    writer.writerows([COLUMNS if clock.start else SECONDS, *rows])
    return (bom + text.getvalue()).encode()


def _read_pose(
    before: ReportRequest, form: Form, clock: DayClock, used_s: tuple[Window, ...]
) -> ReportRequest:
    """Parse the calibration: by an axis along the arm, or by a pose."""
    if first(form, "pose") == NO_POSE:
        return replace(before, calibration_windows_s=(), arm_axis=_choose_axis(first(form, "axis")))
    poses: tuple[Pose, ...] = get_args(Pose)
    pose = _choose(poses, first(form, "pose"), "pose")
    windows_s = read_windows(form, "window", clock)
    if pose == "two-point":
        windows_s = [*windows_s[:1], *read_windows(form, "level", clock)]
    elif windows_s[:1] == [None] and any(windows_s) and used_s:
        windows_s[0] = used_s[0]  # in addition to the window that the software found
    given_s = tuple(window_s for window_s in windows_s if window_s is not None)
    return replace(before, pose=pose, calibration_windows_s=given_s, arm_axis=None)


def read_windows(form: Form, name: str, clock: DayClock) -> list[Window | None]:
    """Parse the typed windows; None for an empty one, which the software then selects.

    Raises BadParameter or UnusableCalibration.
    """
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
    """Parse times at which the sensor did or did not slip, separated by ";"."""
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


MAX_POINTS = 4000
MAX_SPANS = 200
MAX_TIME_S = 1e8

router = APIRouter(include_in_schema=False, prefix="/analyses/{analysis_id}")
Second = Annotated[float, Query(ge=0, le=MAX_TIME_S)]


class Piece(BaseModel):
    """A time range of a curve, and the number of pieces."""

    from_s: Annotated[float, Field(ge=0, le=MAX_TIME_S)]
    to_s: Annotated[float, Field(ge=0, le=MAX_TIME_S)]
    points: Annotated[int, Field(ge=1, le=MAX_POINTS)] = 1200


@router.get("/curve")
def curve(analysis_id: str, page: UsedPage, piece: Annotated[Piece, Query()]) -> Response:
    """Return the lowest and highest angle in each of about ``points`` pieces of a time range."""
    return cut_curve(_load_day_of(page, analysis_id)[1], piece)


def cut_curve(day: DayFile, piece: Piece) -> Response:
    """Return a time range of a curve."""
    stretches = [asdict(stretch) for stretch in day.cut(piece.from_s, piece.to_s, piece.points)]
    return JSONResponse({"stretches": stretches})


@router.get("/stillness")
def stillness(analysis_id: str, page: UsedPage, start_s: Second, end_s: Second) -> dict[str, Any]:
    """Return how still the arm was in a window, and why the calibration would reject the window.

    ``score``: 0 to 1 as in the calibration, null in a gap; ``why``: a reason of E-CALIBRATION or "".
    """
    quiet = _load_day_of(page, analysis_id)[1].measure_quiet(start_s, end_s)
    if quiet is None:
        return {"score": None, "why": "short" if end_s - start_s < RULES.shortest_window_s else "hole"}
    gravity_g, sd_g = quiet
    score = score_still_period(end_s - start_s, sd_g, np.asarray(gravity_g))
    return {
        "score": round(score, 3),
        "why": window_rejection_reason(end_s - start_s, sd_g, np.asarray(gravity_g)),
    }


@router.get("/share")
def share(
    analysis_id: str,
    page: UsedPage,
    span: Annotated[list[str], Query(min_length=1, max_length=MAX_SPANS)],
) -> dict[str, Any]:
    """Return the time above 60 deg in time ranges, each ``start,end`` in s, as for a task of the diary."""
    _, day = _load_day_of(page, analysis_id)
    valid_s = above_s = 0.0
    for text in span:
        try:
            start_s, end_s = (float(part) for part in text.split(","))
        except ValueError:
            start_s = end_s = 0.0
        if not 0.0 <= start_s < end_s <= MAX_TIME_S:
            raise BadParameter(name="span", value=text[:60], allowed="start,end (s)")
        valid, above = day.measure_above(start_s, end_s, MAIN_THRESHOLD_DEG)
        valid_s, above_s = valid_s + valid, above_s + above
    percent = 100.0 * above_s / valid_s if valid_s else None
    shown = (format_duration(above_s, page.language), format_percent(percent, page.language))
    return {"percent": percent, "words": "{} ({})".format(*shown) if valid_s else shown[1]}


@router.post("/again")
def analyse_again(analysis_id: str, page: UsedPage, form: UsedForm) -> Response:
    """Analyse the recording again with the corrections of the page; the earlier analysis does not change."""
    job, day = _load_day_of(page, analysis_id)
    used_s = tuple((start_s, end_s) for start_s, end_s, *_ in day.facts["calibration"])
    return _add_again(job, correct_request(job.request, form, DayClock.of(day.facts), used_s), page)


@router.post("/pose")
def name_pose(analysis_id: str, page: UsedPage, form: UsedForm) -> Response:
    """Analyse the recording again with one of the proposed stretches as the pose.

    A stretch after the sensor moved is added to the earlier poses; ``start`` states that the pose was held at
    the start of wear.
    """
    job, day = _load_day_of(page, analysis_id)
    return _add_again(job, choose_pose(job.request, day.facts, first(form, "choice")), page)


def choose_pose(request: ReportRequest, facts: Mapping[str, Any], choice: str) -> ReportRequest:
    """Return a request with one of the proposed stretches of a day as the pose. Raises BadParameter."""
    before_s = request.calibration_windows_s or tuple((a, b) for a, b, *_ in facts["calibration"])
    choices_s: dict[str, tuple[Window, ...]] = {START: ()}
    choices_s |= {name_choice(a, b): ((a, b),) for a, b in facts["asked"]}
    choices_s |= {
        name_choice(a, b): (*before_s, (a, b)) for *_, stills in facts.get("unread", ()) for a, b in stills
    }
    if choice not in choices_s:
        raise BadParameter(name="choice", value=choice[:60], allowed=", ".join(choices_s))
    held: PoseHeld | None = "start" if choice == START else request.pose_held
    windows_s = choices_s[choice]
    return replace(request, calibration_windows_s=windows_s, pose_held=held, arm_axis=None, reason="")


@router.post("/moved")
def answer_move(analysis_id: str, page: UsedPage, form: UsedForm) -> Response:
    """Analyse the recording again with the answer whether the sensor moved on the arm."""
    job, day = _load_day_of(page, analysis_id)
    middles_s = dict[str, float]()
    for place, (_, start_s, end_s, _) in enumerate(day.facts.get("moves", ())):
        middles_s |= dict.fromkeys((f"{place}-{YES}", f"{place}-{NO}"), float(round((start_s + end_s) / 2.0)))
    answer = first(form, "answer")
    if answer not in middles_s:
        raise BadParameter(name="answer", value=answer[:60], allowed=", ".join(middles_s))
    before, middle_s = job.request, middles_s[answer]
    slips_s, no_slips_s = before.slip_times_s, before.no_slip_times_s
    if answer.endswith(YES):
        slips_s = tuple(sorted((*slips_s, middle_s)))
    else:
        no_slips_s = tuple(sorted((*no_slips_s, middle_s)))
    answered = replace(before, slip_times_s=slips_s, no_slip_times_s=no_slips_s, reason="")
    return _add_again(job, answered, page)


@router.post("/other-pose")
def try_other_pose(analysis_id: str, page: UsedPage, form: UsedForm) -> Response:
    """Analyse again without the failed pose: by an axis, or without the windows that were set."""
    job = page.services.store.get(analysis_id)
    axis = _choose_axis(first(form, "axis")) if first(form, "axis") else None
    pose = "n-pose" if job.request.pose == "two-point" else job.request.pose
    other = replace(job.request, pose=pose, calibration_windows_s=(), arm_axis=axis, reason="")
    return _add_again(job, other, page)


def update_description(services: Services, job: Job, asked: ReportRequest, names: Sequence[str]) -> None:
    """Store the subject or side of a request on its recording, for later analyses."""
    row = services.recordings.get(job.recording_id)
    about = replace(row.about, **{name: getattr(asked, name) for name in names})
    if about != row.about:
        services.recordings.describe(row, about)


def _add_again(job: Job, corrected: ReportRequest, page: Page) -> Response:
    return page.go_to(add_correction(page.services, job, corrected), f"?before={job.id}")


def add_correction(services: Services, job: Job, corrected: ReportRequest) -> Job:
    """Analyse again with a person's correction, and store its person, arm and job on the recording.

    A corrected pose of a shift also applies to the later shifts that use it.
    """
    again = services.store.correct(job, corrected)
    changed = [name for name in DESCRIBED if getattr(corrected, name) != getattr(job.request, name)]
    update_description(services, job, corrected, changed)
    if job.request.shift and any(getattr(corrected, name) != getattr(job.request, name) for name in OF_POSE):
        _carry_pose(services, job, corrected)
    return again


MAX_SHOWN = 200
OF_POSE = ("calibration_windows_s", "pose_held", "slip_times_s", "no_slip_times_s")


def find_shifts(services: Services, recording_id: str) -> list[Job]:
    """Return the newest analysis of each current shift of a recording."""
    found = services.store.find_page(JobFilter(recording_id=recording_id), MAX_SHOWN)
    current = [job for job in found if job.replaced_by is None and job.request.reference is None]
    return list({job.request.shift: job for job in reversed(current) if job.request.shift}.values())


def find_stated_pose(services: Services, job: Job, request: ReportRequest) -> tuple[Window, ...]:
    """Return when the pose of a finished shift was held, if a person stated it for this request."""
    is_known = request.calibration_windows_s or request.pose_held != "start"
    if is_known or job.state is not JobState.SUCCEEDED:
        return request.calibration_windows_s
    return tuple((a, b) for a, b, *_ in load_day(services, job).facts["calibration"][:1])


def _carry_pose(services: Services, job: Job, corrected: ReportRequest) -> None:
    """Analyse the later shifts again that use the pose of a shift; no pose is carried over a stated slip."""
    windows_s = find_stated_pose(services, job, corrected)
    source = "" if corrected.slip_times_s else job.request.shift
    for later in find_shifts(services, job.recording_id):
        if later.request.pose_from == job.request.shift:
            carried = replace(
                later.request,
                pose_from=source,
                pose_from_windows_s=windows_s if source else (),
                pose_from_no_slip_at_s=corrected.no_slip_times_s if source else (),
                reason="",
            )
            services.store.correct(later, carried)


@router.post("/diary")
def import_diary(
    analysis_id: str, page: UsedPage, body: Annotated[bytes, Depends(read_diary_body)]
) -> list[PeriodRow]:
    """Parse a diary, CSV or Excel, and return its rows for the form; nothing is stored."""
    job = page.services.store.get(analysis_id)
    rows = job.request.choose_rows(page.services.inspector.read_diary(body))
    return place_rows(rows, DayClock.of(load_day(page.services, job).facts))


@router.post("/diary.csv")
def export_diary(analysis_id: str, page: UsedPage, form: UsedForm) -> Response:
    """Return the rows of the form as a diary file."""
    clock = DayClock.of(_load_day_of(page, analysis_id)[1].facts)
    rows = place_rows(read_rows(form, clock), clock)
    body = write_csv([(row.start, row.end, row.kind, row.label) for row in rows], clock, bom=BOM)
    return respond_with_file(body, MEDIA_TYPES["csv"], "diary.csv")


def _load_day_of(page: Page, analysis_id: str) -> tuple[Job, DayFile]:
    job = page.services.store.get(analysis_id)
    return job, load_day(page.services, job)


def load_day(services: Services, job: Job, name: str = DAY_NAME) -> DayFile:
    """Load the day of a finished analysis, or one of the two curves of a comparison.

    Raises NoSuchFile or ResultDamaged.
    """
    if job.state is not JobState.SUCCEEDED:
        raise NoSuchFile(name=name)
    with services.results.borrow(job, name) as path:
        return open_day(path)


# The view of a day: its form, the open questions, and its hours.

STILL_KINDS = {"": "still", "pose": "still", "repeat": "repeat"}
"""The proposal for each still stretch; days of earlier versions contain only proposals of poses."""
MAX_PROPOSED = 5


@dataclass(frozen=True, slots=True)
class WindowRow:
    """A calibration window in the form: the requested window, and the one the software used."""

    start: str = ""
    end: str = ""
    used_start: str = ""
    used_end: str = ""


@dataclass(frozen=True, slots=True)
class Proposal:
    """A proposed time range; ``span`` is its text."""

    kind: str
    start: str
    end: str
    span: str
    sentence: str


@dataclass(frozen=True, slots=True)
class Choice:
    """An answer: ``value`` is sent, ``label`` is shown.

    For a time range also ``start`` and ``end``, their text ``span``, and its ``name`` on the curve.
    """

    value: str
    label: str
    name: str = ""
    start: str = ""
    end: str = ""
    span: str = ""


@dataclass(frozen=True, slots=True)
class Question:
    """A question that only a person can answer.

    ``action`` and ``field`` send the answer; ``start`` to ``end`` is the time range in question, ``span``
    its text.
    """

    key: str
    action: str
    field: str
    heading: str
    lead: str
    choices: tuple[Choice, ...]
    start: str = ""
    end: str = ""
    span: str = ""


def build_day(day: DayFile, request: ReportRequest, language: Language) -> dict[str, Any]:
    """Build the view of a day and its request for the timeline."""
    clock, words = DayClock.of(day.facts), load_wording(language, "day")
    names = words["kind_name"]
    count = 1 if request.pose == "two-point" else max(1, len(request.calibration_windows_s))
    return {
        "start": str(day.facts["start"] or ""),
        "changes": clock.changes,
        "time_zone": request.time_zone,
        "clock_offset": format_clock_offset(request.clock_offset_s),
        "duration_s": clock.duration_s,
        "needs_date": clock.needs_date,
        "rows": place_rows(request.select_diary(), clock),
        "windows": tuple(_build_window(place, day, request, clock) for place in range(count)),
        "level": _build_window(1, day, request, clock) if request.pose == "two-point" else WindowRow(),
        "held": request.pose_held or "",
        "slips": "; ".join(map(clock.format, request.slip_times_s)),
        "no_slips": "; ".join(map(clock.format, request.no_slip_times_s)),
        "axis": _build_axis(day.facts, request, words, language),
        "questions": tuple(_list_questions(day.facts, request, words, clock.report(language))),
        "proposals": tuple(_list_proposals(day.facts, clock, words, language)),
        "kinds": tuple((kind, str(names[kind])) for kind in KINDS),
        "has_samples": bool(day.facts["calibration"] or day.facts.get("nearest_axis")),
    }


def _build_axis(
    facts: Mapping[str, Any], request: ReportRequest, words: Words, language: Language
) -> dict[str, Any]:
    """Return the ``asked`` axis ("" for none), the ``choices`` of the form, and the ``nearest`` axis.

    ``drawing`` names the drawing of the sensor, ``where`` describes its axes.
    """
    entry, device = words["along"], facts["device"]
    drawing = device if device in entry["where"] else "other"
    nearest, apart_deg = (None if request.arm_axis else facts.get("nearest_axis")) or ("", 0.0)
    values = {"axis": format_axis(nearest), "apart": format_angle(apart_deg, language)}
    return {
        "asked": request.arm_axis or "",
        "choices": list_axes(),
        "drawing": drawing,
        "where": str(entry["where"][drawing]),
        "nearest": fill(entry["nearest"], values) if nearest else "",
    }


def list_axes() -> tuple[tuple[str, str], ...]:
    """Return each axis that may point along the arm, and its label."""
    return tuple((axis, format_axis(axis)) for axis in ARM_AXES)


def format_axis(axis: str) -> str:
    """Format a sensor axis for display: "y", "−y"."""
    return axis.removeprefix("+").replace("-", "\u2212")


# The questions of the page: when the pose was held, whether the sensor moved, which pose came after that.

START = "start"
"""Answer instead of a stretch: the pose was held at the start of wear."""
YES, NO = "yes", "no"
"""Whether the sensor moved on the arm."""


def name_choice(start_s: float, end_s: float) -> str:
    """Return the value of a stretch in a form."""
    return f"{start_s:.2f}-{end_s:.2f}"


def _list_questions(
    facts: Mapping[str, Any], request: ReportRequest, words: Words, report_clock: Clock
) -> Iterator[Question]:
    """Yield the open questions; a pose after a move is asked for once the earlier pose is confirmed.

    The first of the stretches that may be the pose is the one in use.
    """
    clock, asked, unread = DayClock.of(facts), facts.get("asked"), facts.get("unread", ())

    def offer(key: str, start_s: float, end_s: float) -> Choice:
        time = report_clock.format(start_s, with_seconds=True)
        length = format_duration(end_s - start_s, report_clock.language)
        label = fill(words[key], {"time": time, "length": length})
        shown = _format_range(clock, round(start_s), round(end_s), report_clock.language)
        return Choice(name_choice(start_s, end_s), label, fill(words["perhaps"], {"time": time}), *shown)

    if asked:
        leads = [str(words["which_not_held"])] if facts.get("not_held") else []
        if facts.get("needs_pose"):
            apart = format_angle(facts.get("spread_deg", 0.0), report_clock.language)
            leads.append(fill(words["which_apart"], {"apart": apart}))
        leads = leads or [str(words["which_lead"])]
        leads += [fill(words["which_next"], {"time": report_clock.format(start_s)}) for start_s, *_ in unread]
        choices = [offer("choice_used", *asked[0]), *(offer("choice", *other) for other in asked[1:])]
        if request.pose_held != "start" and not facts.get("not_held"):
            choices.insert(1, Choice(START, words["held_start"]))
        yield Question("which-pose", "pose", "choice", words["which"], " ".join(leads), tuple(choices))
    for number, (kind, start_s, end_s, apart_deg) in enumerate(facts.get("moves", ())):
        span = {
            **report_clock.format_span(start_s, end_s),
            "apart": format_angle(apart_deg, report_clock.language),
        }
        heading, lead = (fill(words[key], span) for key in (kind, f"{kind}_lead"))
        yes, no = ("slipped", "no_slip") if kind == "slip" else ("moved", "same_place")
        answers = (Choice(f"{number}-{YES}", words[yes]), Choice(f"{number}-{NO}", words[no]))
        shown = _format_range(clock, round(start_s), round(end_s), report_clock.language)
        yield Question(f"move-{number}", "moved", "answer", heading, lead, answers, *shown)
    for number, (start_s, _, stills) in enumerate(() if asked else unread):
        time = {"time": report_clock.format(start_s)}
        heading, lead = (fill(words[key], time) for key in ("which_after", "which_after_lead"))
        offers = tuple(offer("choice", *still) for still in stills)
        yield Question(f"pose-after-{number}", "pose", "choice", heading, lead, offers)


def _format_range(clock: DayClock, start_s: float, end_s: float, language: Language) -> tuple[str, str, str]:
    """Return both ends of a time range for the form, and its text."""
    return clock.format(start_s), clock.format(end_s), clock.show_span(start_s, end_s, language)


def _build_window(place: int, day: DayFile, request: ReportRequest, clock: DayClock) -> WindowRow:
    chosen, used = request.calibration_windows_s, day.facts["calibration"]
    start, end = map(clock.format, chosen[place]) if place < len(chosen) else ("", "")
    used_start, used_end = map(clock.format, used[place][:2]) if place < len(used) else ("", "")
    return WindowRow(start, end, used_start, used_end)


def _list_proposals(
    facts: Mapping[str, Any], clock: DayClock, words: Words, language: Language
) -> Iterator[Proposal]:
    still = [
        (start_s, end_s, STILL_KINDS["".join(kind)], format_number(score, 2, language))
        for start_s, end_s, score, *kind in facts["still"]
    ]
    still = [*still[:MAX_PROPOSED], *(row for row in still[MAX_PROPOSED:] if row[2] == "repeat")]
    not_worn = [(start_s, end_s, "not_worn", "") for start_s, end_s in facts["not_worn"]]
    for start_s, end_s, kind, score in (*still, *not_worn):
        span = clock.show_span(round(start_s), round(end_s), language)
        sentence = fill(words[kind], {"span": span, "score": score})
        yield Proposal(kind, clock.format(start_s), clock.format(end_s), span, sentence)


def _format_hour(hour: Mapping[str, Any], language: Language) -> str:
    """Format the start of an hour; without a clock, the time since the first sample.

    Any other label was stored by an earlier version and stays unchanged.
    """
    label = str(hour["label"])
    if label.startswith("+"):
        return format_elapsed(hour["start_s"])
    try:
        moment = datetime.fromisoformat(label)
        return add_offset(format_moment(moment, language), moment)
    except ValueError:
        return label


def build_hours(results: Mapping[str, Any], language: Language) -> list[tuple[str, ...]]:
    """Return the hours as table rows: hour, analysed, median, P90, time above 60 deg.

    An hour without analysed time has no figures, such as the last if the day ends just after the full hour.
    """
    return [
        (
            _format_hour(hour, language),
            format_duration(hour["analysed_s"], language),
            format_angle(hour.get("elevation_p50_deg"), language),
            format_angle(hour.get("elevation_p90_deg"), language),
            format_percent(hour.get("time_above_60_percent"), language),
        )
        for hour in results["exposure"].get("by_hour", ())
    ]
