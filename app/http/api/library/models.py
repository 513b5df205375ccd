"""Recordings and analyses in API requests and responses, typed for the OpenAPI document."""

import base64
import binascii
import csv
import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from datetime import date, datetime
from typing import Annotated, Any, Literal, Self, TypeVar
from urllib.parse import urlencode

from fastapi import Request, Response
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    RootModel,
    StrictBool,
    StrictFloat,
    WithJsonSchema,
    model_validator,
)
from pydantic_core import PydanticCustomError

from acromion.app.errors import BadParameter
from acromion.app.http.middleware.problems import ProblemView, view_problem
from acromion.app.library.recordings import DESCRIBED, Description, RecordingFilter, StoredRow
from acromion.app.library.rows import Job, Place
from acromion.app.report.export.tables import encode_table
from acromion.app.report.words.wording import (
    MAX_TEXT,
    Language,
    check_conclusion,
    clean_text,
    find_other_language,
)
from acromion.app.request import (
    ISCO_HINT,
    LONGEST_CONCLUSION,
    LONGEST_SUBJECT,
    SHIFT_HINT,
    SUBJECT_HINT,
    WINDOW_HINT,
    Paper,
    ReportRequest,
    check_interval,
    check_isco,
    check_job_title,
    check_shift,
    check_subject,
    clean_file_name,
    clean_folder,
    find_window_hint,
    parse_window,
    write_profile,
)
from acromion.app.settings import Settings
from acromion.fusion.caveats import Caveat
from acromion.fusion.clocks import (
    INTERVAL_HINT,
    OFFSET_HINT,
    ZONE_HINT,
    correct_start,
    parse_clock_offset,
    parse_time_zone,
)
from acromion.fusion.conventions import AXIS_HINT, ArmAxis, MethodName, Pose, PoseHeld, Side, parse_arm_axis
from acromion.fusion.diary import MOST_ROWS, DiaryEntry, Kind, read_diary, refuse_slips, split_times
from acromion.fusion.errors import UnusableDiary
from acromion.fusion.exposure.periods import close_rows, find_contradictions, place_diary
from acromion.fusion.recording import MICROSECONDS

T = TypeVar("T")

# Periods of a recording, as rows of JSON or as a diary file.


COLUMNS = ["start", "end", "start_s", "end_s", "kind", "label", "left_out", "file"]
SECONDS = {"start_s", "end_s"}
_YES_NO: Mapping[bool | None, str] = {None: "", True: "yes", False: "no"}


ClockText = Annotated[
    StrictFloat | str | None,
    Field(description="10:20, 10h20 or 2026-03-02T10:20:30; a number is refused with E-DIARY."),
    WithJsonSchema({"anyOf": [{"type": "string"}, {"type": "null"}]}),
]


class PeriodView(BaseModel):
    """A period of the day, as clock times (``start``) or in seconds from the first sample (``start_s``)."""

    model_config = ConfigDict(extra="forbid")

    start: ClockText = None
    end: ClockText = None
    start_s: StrictFloat | None = None
    end_s: StrictFloat | None = None
    kind: Kind
    label: Annotated[str, Field(max_length=200)] = ""
    left_out: StrictBool | None = None


class PeriodList(RootModel[Annotated[list[PeriodView], Field(max_length=MOST_ROWS)]]):
    """The periods of a recording."""


def view_periods(diary: tuple[DiaryEntry, ...]) -> list[PeriodView]:
    """Convert a diary to rows."""
    return [
        PeriodView(**split_times(e), kind=e.kind, label=e.label, left_out=e.left_out)  # type: ignore[arg-type]
        for e in diary
    ]


def write_periods(diary: tuple[DiaryEntry, ...]) -> bytes:
    """Format a diary as a CSV file that :func:`acromion.fusion.diary.read_diary` can read."""
    rows = [asdict(e) | split_times(e) | {"left_out": _YES_NO[e.left_out]} for e in diary]
    unused = {name for name in SECONDS if all(row[name] is None for row in rows)}
    return encode_table([name for name in COLUMNS if name not in unused], rows)


def read_periods(rows: list[PeriodView]) -> tuple[DiaryEntry, ...]:
    """Validate rows by the rules of the diary file (:func:`acromion.fusion.diary.read_diary`).

    Raises UnusableDiary; its line is the number of the row plus 1, because a file's header is line 1.
    """
    if not rows:
        return ()
    numbers = [
        UnusableDiary(line=line, why="number", cure="number", value=f"{moment:g}")
        for line, row in enumerate(rows, 2)
        for moment in (row.start, row.end)
        if isinstance(moment, float)
    ]
    refuse_slips(numbers)
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS[:-1])
    writer.writeheader()
    for row in rows:
        cells = {"label": " ".join(row.label.split()), "left_out": _YES_NO[row.left_out]}
        writer.writerow(row.model_dump() | cells)
    return read_diary(text.getvalue().encode())


def check_periods(
    diary: Sequence[DiaryEntry],
    found: Mapping[str, Any] | None,
    time_zone: str = "",
    clock_offset_s: float = 0.0,
) -> None:
    """Place the periods on the recording as the analysis will; ``found`` is the result of the inspection.

    Without an inspection (None), the rows are only compared with one another. Raises UnusableDiary if a row
    ends before it starts, overlaps another or is outside of the recording, and UnusableClock if the stated
    clock cannot be right.
    """
    if found is None:
        refuse_slips(find_contradictions(diary))
        return
    start = datetime.fromisoformat(found["start"]) if found["start"] else None
    start = correct_start(start, time_zone, clock_offset_s)
    duration_us = round(found["recorded_s"] * MICROSECONDS)
    if place_diary(diary, start, duration_us).flags:
        for entry in close_rows(diary):
            place_diary((entry,), start, duration_us)


# Options of an analysis.

MAX_WINDOWS = 100
CLOCK_HINT = "2026-03-02, 2026-03-02T07:58"


def parse_subject(text: str) -> str:
    """Check a subject code; the error contains a validation hint."""
    return _parse(check_subject, text, SUBJECT_HINT)


def parse_device_clock(text: str) -> str:
    """Check a date or time of the device's clock and return it in ISO format; the error contains a hint.

    A time zone is refused, because recording starts have none and could not be compared with it.
    """
    moment = _parse(datetime.fromisoformat, text, CLOCK_HINT) if text else None
    if moment is not None and moment.tzinfo is not None:
        raise PydanticCustomError("value", "value", {"expected": CLOCK_HINT})
    return moment.isoformat() if moment else ""


def check_clock_offset(text: str) -> str:
    """Check a correction of the clock; the error contains a hint."""
    if text:
        _parse(parse_clock_offset, text, OFFSET_HINT)
    return text


def _parse(read: Callable[[str], T], text: str, hint: str) -> T:
    try:
        return read(text)
    except ValueError:
        raise PydanticCustomError("value", "value", {"expected": hint}) from None


SubjectCode = Annotated[str, AfterValidator(parse_subject)]
DeviceClock = Annotated[str, AfterValidator(parse_device_clock)]
JobTitle = Annotated[
    str,
    Field(max_length=LONGEST_SUBJECT, description="Title of the person's job."),
    AfterValidator(lambda text: _parse(check_job_title, text, SUBJECT_HINT) if text else ""),
]
IscoCode = Annotated[
    str,
    Field(max_length=4, description="Code of the job in ISCO-08, one to four digits."),
    AfterValidator(lambda text: _parse(check_isco, text, ISCO_HINT) if text else ""),
]
SlipTimes = list[Annotated[float, Field(ge=0, le=1e8)]]


class AnalysisOptions(BaseModel):
    """Options of an analysis; unknown names are refused."""

    model_config = ConfigDict(extra="forbid")

    side: Annotated[Side | None, Field(description="Which arm.")] = None
    subject: Annotated[SubjectCode, Field(description="Subject code; never a name.")] = ""
    job_title: JobTitle = ""
    isco_code: IscoCode = ""
    method: MethodName = "smoothed"
    pose: Pose = "n-pose"
    lang: Annotated[Language | None, Field(description="Language of the response.")] = None
    paper: Annotated[Paper | None, Field(description="Paper of the PDF; default: the server's.")] = None
    appendix: Annotated[
        bool | None, Field(description="Whether the PDF has its appendix; default: the server's.")
    ] = None
    calibration: Annotated[
        list[Annotated[str, AfterValidator(lambda text: _parse(parse_window, text, WINDOW_HINT) and text)]],
        Field(
            max_length=MAX_WINDOWS,
            description="START_S,END_S: when the pose was held, once or more; two-point: hanging, level.",
        ),
    ] = []
    pose_held: Annotated[
        PoseHeld | None,
        Field(
            description="The pose was held at the start of wear; no: not held, even if the file states it."
        ),
    ] = None
    axis: Annotated[
        ArmAxis | None,
        BeforeValidator(lambda text: _parse(parse_arm_axis, text, AXIS_HINT) if text else None),
        Field(description="Without a pose: the sensor's axis along the arm, towards the shoulder."),
    ] = None
    slip_at: Annotated[
        SlipTimes, Field(max_length=MAX_WINDOWS, description="When the sensor slipped, seconds.")
    ] = []
    no_slip_at: Annotated[
        SlipTimes,
        Field(max_length=MAX_WINDOWS, description="When it did not slip although it may seem so, seconds."),
    ] = []
    shift: Annotated[
        str,
        AfterValidator(lambda text: _parse(check_interval, text, INTERVAL_HINT) if text else ""),
        Field(
            max_length=100,
            description="START/END, clock times of one shift of a longer recording; seconds count from it.",
        ),
    ] = ""
    rate_hz: Annotated[float | None, Field(ge=1, le=10_000, description="For files without timestamps.")] = (
        None
    )
    time_zone: Annotated[
        str,
        Field(max_length=60, description="Zone of clock times, such as Europe/Paris; default: the file's."),
        AfterValidator(lambda text: _parse(parse_time_zone, text, ZONE_HINT)),
    ] = ""
    clock_offset: Annotated[
        str,
        Field(
            max_length=30,
            description="Added to the device's clock, if it was wrong: -1:02:00 or -3720 (s).",
        ),
        AfterValidator(check_clock_offset),
    ] = ""
    sensor: Annotated[
        str,
        Field(max_length=200, description="Which sensor of a table or archive of several is on the arm."),
    ] = ""
    date_order: Annotated[
        Literal["dmy", "mdy"] | None,
        Field(description="Order of day, month and year in dates that can be read both ways."),
    ] = None

    @property
    def columns(self) -> dict[str, str]:
        """The options that a column profile holds."""
        stated = {"sensor": self.sensor, "date_order": self.date_order}
        return {name: value for name, value in stated.items() if value}

    def complete(self, about: Description) -> Self:
        """Fill in subject, side and job from the recording if the options do not set them."""
        known = {name: getattr(about, name) for name in DESCRIBED}
        return self.model_validate(known | self.model_dump(exclude_unset=True))

    @model_validator(mode="after")
    def _count_windows(self) -> Self:
        count = len(self.calibration)
        hint = find_window_hint(self.pose, count, self.axis)
        if hint:
            raise BadParameter(name="calibration", value=str(count), allowed=hint)
        return self

    def build_request(self, file_name: str, language: Language, settings: Settings) -> ReportRequest:
        """Build the request; the report is made in both languages, the requested one first.

        ``language`` and the server's ``settings`` are defaults for the options.
        """
        first = self.lang or language
        return ReportRequest(
            file_name=file_name,
            subject=self.subject,
            side=self.side,
            job_title=self.job_title,
            isco_code=self.isco_code,
            method=self.method,
            pose=self.pose,
            calibration_windows_s=tuple(parse_window(text) for text in self.calibration),
            arm_axis=self.axis,
            slip_times_s=tuple(self.slip_at),
            no_slip_times_s=tuple(self.no_slip_at),
            pose_held=self.pose_held,
            shift=self.shift,
            rate_hz=self.rate_hz,
            time_zone=self.time_zone,
            clock_offset_s=parse_clock_offset(self.clock_offset) if self.clock_offset else 0.0,
            profile=write_profile(self.columns) if self.columns else "",
            languages=(first, find_other_language(first)),
            paper=self.paper or settings.paper,
            appendix=settings.appendix if self.appendix is None else self.appendix,
        )


StudyName = Annotated[
    SubjectCode, Field(description="Name of a study to join; the first analysis creates it.")
]


class DeclaredOptions(AnalysisOptions):
    """Options of an analysis that is declared before its recording is uploaded."""

    study: StudyName = ""


class AnalyzeParameters(DeclaredOptions):
    """Options of an analysis sent with its recording."""

    file_name: Annotated[str, Field(max_length=1000, description="Name of the file, for display.")] = ""
    external_id: Annotated[SubjectCode, Field(description="Its identifier in your own system.")] = ""
    again: Annotated[bool, Field(description="Analyse again even if the same analysis exists.")] = False


class ConclusionView(BaseModel):
    """The conclusion of a clinician, with name and date; the report prints it unchanged."""

    model_config = ConfigDict(extra="forbid")

    text: Annotated[str, Field(max_length=LONGEST_CONCLUSION), AfterValidator(check_conclusion)]
    name: Annotated[str, Field(min_length=1, max_length=LONGEST_SUBJECT), AfterValidator(clean_text)]
    date: date


class ConclusionDraftView(ConclusionView):
    """A conclusion from an earlier version that is not confirmed for this one; no report prints it."""

    version: Annotated[int, Field(description="The version for which it was written.")]
    changes: Annotated[
        list[str],
        Field(description="Settings that differ since then; engine: the software; empty: the same figures."),
    ]


class AnalysisSettings(AnalysisOptions):
    """Options of an analysis of a stored recording; defaults come from the recording."""

    shift: Annotated[
        str,
        AfterValidator(lambda text: _parse(check_shift, text, f"{INTERVAL_HINT}, {SHIFT_HINT}")),
        Field(
            max_length=100,
            description="START/END: one shift of a longer recording; 07:00-15:30 or diary: each of them.",
        ),
    ] = ""
    source: Annotated[
        Literal["samples", "angles"], Field(description="Samples of a sensor, or computed angles.")
    ] = "samples"
    profile: Annotated[
        dict[str, Any] | None, Field(description="Meaning of the columns, for tables that do not state it.")
    ] = None
    periods: Annotated[
        list[PeriodView] | None,
        Field(max_length=MOST_ROWS, description="Replaces the recording's periods."),
    ] = None
    reason: Annotated[
        str,
        Field(max_length=MAX_TEXT, description="Why it is analysed again; printed in the report."),
        AfterValidator(clean_text),
    ] = ""
    conclusion: Annotated[ConclusionView | None, Field(description="The conclusion of a clinician.")] = None


# Responses.

RESULT_NAMES = (
    "results.json",
    "report.html",
    "report.pdf",
    "answer.txt",
    "elevation.parquet",
    "elevation.csv.gz",
    "hours.csv",
    "periods.csv",
    "tasks.csv",
    "postures.csv",
    "marks.csv",
    "summary.csv",
    "summary_fr.csv",
    "summary.xlsx",
    "summary.parquet",
    "dictionary.csv",
    "datapackage.json",
    "redcap_import.csv",
    "redcap_dictionary.csv",
    "fhir.json",
    "settings.yaml",
    "bundle.zip",
)


class AnalysisView(BaseModel):
    """An analysis: its state, the reason if it failed, and the links of its files."""

    id: str
    recording_id: str
    state: Literal["queued", "running", "succeeded", "failed", "cancelled"]
    stage: str | None
    progress: float
    attempts: int
    file_name: str
    size_bytes: int
    sha256: str
    settings: dict[str, Any]
    created_at: str
    started_at: str | None
    ended_at: str | None
    links: dict[str, str]
    batch_id: str | None = None
    replaced_by: str | None = None
    interruptions: int = 0
    asked_by: str | None = None
    conclusion: ConclusionView | None = None
    conclusion_draft: ConclusionDraftView | None = None
    duplicate_of: str | None = None
    problem: ProblemView | None = None


class AnalysisQuery(BaseModel):
    """Filters of the analyses; an omitted one matches all."""

    model_config = ConfigDict(extra="forbid")

    state: Literal["queued", "running", "succeeded", "failed", "cancelled"] | None = None
    batch_id: str = ""
    recording_id: str = ""
    limit: Annotated[int, Field(ge=1, le=500)] = 100
    cursor: str = ""
    lang: Language | None = None


class AnalysisList(BaseModel):
    """A page of analyses, newest first; ``next_cursor`` requests the next page, null on the last one."""

    items: list[AnalysisView]
    next_cursor: str | None


class StartedAnalyses(AnalysisView):
    """The first of the requested analyses, and all of them in order."""

    items: list[AnalysisView]


SAME = (
    *("id", "recording_id", "stage", "attempts", "file_name", "size_bytes", "sha256"),
    *("batch_id", "replaced_by", "interruptions"),
)


SETTINGS = (
    *("subject", "side", "job_title", "isco_code", "method", "pose", "calibration_windows_s"),
    *("pose_held", "arm_axis"),
    *("slip_times_s", "no_slip_times_s", "shift", "rate_hz", "time_zone", "clock_offset_s"),
    *("source", "paper", "appendix"),
)


def view_analysis(job: Job, language: Language) -> AnalysisView:
    """Build the view of a job."""
    conclusion, draft = job.request.conclusion, job.request.draft
    concluded = ConclusionView.model_validate(asdict(conclusion)) if conclusion else None
    drafted = None
    if draft is not None:
        origin = {"version": draft.version, "changes": list(draft.changes)}
        drafted = ConclusionDraftView.model_validate(asdict(draft.conclusion) | origin)
    periods = [period.model_dump() for period in view_periods(job.request.diary)]
    view = AnalysisView(
        **{name: getattr(job, name) for name in SAME},
        state=job.state.value,
        progress=round(job.progress, 3),
        asked_by=job.asked_by or None,
        settings={name: getattr(job.request, name) for name in SETTINGS} | {"periods": periods},
        created_at=job.created_at.isoformat(),
        started_at=job.started_at.isoformat() if job.started_at else None,
        ended_at=job.ended_at.isoformat() if job.ended_at else None,
        links=dict(describe_links(job)),
        conclusion=concluded,
        conclusion_draft=drafted,
    )
    if job.problem_code is not None:
        view.problem = view_problem(job.problem_code, job.problem_facts, language, view.links["self"])
    return view


def describe_links(job: Job) -> Mapping[str, str]:
    """Return the links of an analysis: its actions, its page, its recording and its files."""
    own = f"/api/v1/analyses/{job.id}"
    if job.request.reference is not None:  # a comparison has its own routes
        return {"self": own, "validation": f"/api/v1/validations/{job.id}"}
    files = {name.replace(".", "_"): f"{own}/{name}" for name in RESULT_NAMES}
    steps = {name: f"{own}/{name}" for name in ("cancel", "retry", "events")}
    about = {"page": f"/analyses/{job.id}", "recording": f"/api/v1/recordings/{job.recording_id}"}
    return {"self": own, **steps, **about, **files}


# Pagination.


def write_cursor(place: Place) -> str:
    """Encode the position where a page ended as an opaque text."""
    return base64.urlsafe_b64encode("|".join(place).encode()).decode().rstrip("=")


def read_cursor(text: str) -> Place | None:
    """Decode a cursor from :func:`write_cursor`; None for "". Raises BadParameter."""
    if not text:
        return None
    try:
        decoded = base64.urlsafe_b64decode(text + "=" * (-len(text) % 4)).decode("utf-8")
        moment, identity = decoded.split("|")
    except (binascii.Error, ValueError):
        raise BadParameter(name="cursor", value=text[:60], allowed="next_cursor") from None
    return moment, identity


def cut_page(
    rows: Sequence[T], limit: int, place: Callable[[T], Place], asked: Request, answer: Response
) -> tuple[Sequence[T], str | None]:
    """Return the rows of a page and the cursor of the next; ``rows`` has ``limit + 1`` rows if more follow.

    The response also gets ``Link: <...>; rel="next"`` (RFC 8288).
    """
    if len(rows) <= limit:
        return rows, None
    cursor = write_cursor(place(rows[limit - 1]))
    others = [(name, value) for name, value in asked.query_params.multi_items() if name != "cursor"]
    answer.headers["Link"] = f'<{asked.url.path}?{urlencode([*others, ("cursor", cursor)])}>; rel="next"'
    return rows[:limit], cursor


Text = Annotated[str, Field(max_length=200), AfterValidator(parse_subject)]
SENT_BEFORE = Caveat.DUP_UPLOAD
Note = Annotated[str, Field(max_length=2000)]


class RecordingWords(BaseModel):
    """The description of a recording; unknown names are refused."""

    model_config = ConfigDict(extra="forbid")

    file_name: Annotated[str, Field(max_length=1000, description="Name of the file, for display.")] = ""
    subject: Annotated[SubjectCode, Field(description="Subject code; never a name.")] = ""
    side: Annotated[Side | None, Field(description="Which arm.")] = None
    external_id: Annotated[Text, Field(description="Its identifier in your own system.")] = ""
    note: Note = ""
    folder: Annotated[
        str, Field(max_length=1000, description="Folders the file was in; they may suggest whose arm it is.")
    ] = ""
    job_title: JobTitle = ""
    isco_code: IscoCode = ""

    def describe(self) -> Description:
        """Return the description as it is stored."""
        cleaned = {"file_name": clean_file_name(self.file_name), "folder": clean_folder(self.folder)}
        return Description(**self.model_dump() | cleaned)


class RecordingPatch(BaseModel):
    """A JSON merge patch (RFC 7396): an absent field does not change, null clears it."""

    model_config = ConfigDict(extra="forbid")

    file_name: Annotated[str, Field(max_length=1000)] | None = None
    subject: SubjectCode | None = None
    side: Side | None = None
    external_id: Text | None = None
    note: Note | None = None
    job_title: JobTitle | None = None
    isco_code: IscoCode | None = None

    def merge(self, about: Description) -> Description:
        """Return the description after the change."""
        named = {name: getattr(self, name) for name in self.model_fields_set}
        emptied = {name: "" if value is None and name != "side" else value for name, value in named.items()}
        return RecordingWords(**(asdict(about) | emptied)).describe()


class RecordingView(BaseModel):
    """A stored recording. ``start`` is known after its inspection."""

    id: str
    file_name: str
    subject: str
    side: Side | None
    external_id: str
    note: str
    job_title: str
    isco_code: str
    sha256: str
    size_bytes: int
    duplicate_of: str | None
    warnings: list[str]
    damage: str | None = Field(
        None, description="E-STORE-DAMAGED if the stored bytes are missing or altered."
    )
    start: str | None
    period_count: int
    version: int
    state: Literal["stored", "trashed"]
    hold: str | None = Field(None, description="Why it may not be deleted permanently; null if it may.")
    created_at: str
    links: dict[str, str]


class RecordingQuery(BaseModel):
    """Filters of the recordings; an omitted one matches all."""

    model_config = ConfigDict(extra="forbid")

    subject: str = ""
    external_id: str = ""
    sha256: str = ""
    begin: Annotated[
        DeviceClock,
        Field(
            alias="from", description="Earliest start, ISO 8601, by the device's clock (without a time zone)."
        ),
    ] = ""
    end: Annotated[DeviceClock, Field(alias="to", description="Start before this, by the same clock.")] = ""
    trashed: bool = False
    limit: Annotated[int, Field(ge=1, le=500)] = 50
    cursor: str = ""
    lang: Language | None = None

    def wanted(self) -> RecordingFilter:
        """Return the filter of the rows."""
        return RecordingFilter(
            self.subject, self.external_id, self.sha256, self.begin, self.end, self.trashed
        )


class RecordingList(BaseModel):
    """A page of recordings; ``next_cursor`` requests the next page, null on the last one."""

    items: list[RecordingView]
    next_cursor: str | None


def view_recording(row: StoredRow) -> RecordingView:
    """Build the view of a recording."""
    own = f"/api/v1/recordings/{row.id}"
    links = {"self": own} | {part: f"{own}/{part}" for part in ("file", "inspection", "periods")}
    about = {name: value for name, value in asdict(row.about).items() if value is not None}
    return RecordingView(
        **{name: getattr(row, name) for name in ("id", "sha256", "size_bytes", "duplicate_of", "start")},
        **{"side": None} | about,
        warnings=[SENT_BEFORE] if row.duplicate_of else [],
        period_count=len(row.diary),
        version=row.version,
        state=row.state,
        hold=row.hold or None,
        created_at=row.created_at,
        links=links | {"analyses": f"/api/v1/analyses?recording_id={row.id}"},
    )
