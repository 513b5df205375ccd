"""What comes out of the API, typed for the people who read the OpenAPI document."""

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from datetime import datetime
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, RootModel, StrictBool, StrictFloat

from app.api.problems import ProblemView, view_problem
from app.jobs.job import Job
from app.report.export.csv import encode_table
from app.report.words.wording import Language
from app.request import ReportRequest
from fusion.diary import DiaryEntry, place_diary, read_diary
from fusion.recording import MICROSECONDS

# Periods of a recording, inwards and outwards: as rows of JSON or as a diary file.


COLUMNS = ["start", "end", "kind", "label", "left_out", "file"]
LONGEST_US = 366 * 86_400 * MICROSECONDS
_YES_NO: Mapping[bool | None, str] = {None: "", True: "yes", False: "no"}


class PeriodView(BaseModel):
    """A stretch of the day: seconds from the first sample, or the clock as text (ISO 8601 or HH:MM)."""

    model_config = ConfigDict(extra="forbid")

    start: StrictFloat | str
    end: StrictFloat | str | None = None
    kind: Literal["shift", "work", "task", "seated", "supported", "break", "outside", "not_worn"]
    label: Annotated[str, Field(max_length=200)] = ""
    left_out: StrictBool | None = None


class PeriodList(RootModel[list[PeriodView]]):
    """The periods of a recording."""


def view_periods(diary: tuple[DiaryEntry, ...]) -> list[PeriodView]:
    """Show a diary as rows."""
    return [
        PeriodView(start=e.start, end=e.end, kind=e.kind, label=e.label, left_out=e.left_out) for e in diary
    ]


def write_periods(diary: tuple[DiaryEntry, ...]) -> bytes:
    """Write a diary as the CSV that is read again."""
    return encode_table(COLUMNS, [asdict(e) | {"left_out": _YES_NO[e.left_out]} for e in diary])


def read_periods(rows: list[PeriodView]) -> tuple[DiaryEntry, ...]:
    """Check rows by the very rules of the diary file (:func:`fusion.diary.read_diary`).

    Raises
    ------
    fusion.errors.UnusableDiary
        Its line is the place of the row, counted from 2: the header of a file would be line 1.
    """
    if not rows:
        return ()
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(COLUMNS[:5])
    for row in rows:
        label = " ".join(row.label.split())
        writer.writerow(
            [row.start, "" if row.end is None else row.end, row.kind, label, _YES_NO[row.left_out]]
        )
    return read_diary(text.getvalue().encode())


def check_periods(diary: Sequence[DiaryEntry], found: Mapping[str, Any] | None) -> None:
    """Place the periods on the recording as its analysis will; ``found`` is what an inspection told of it.

    Where nothing could be told (None), rows in seconds are compared with one another.

    Raises
    ------
    fusion.errors.UnusableDiary
        When a row ends before it begins, overlaps another or lies outside of the recording.
    """
    if found is None:
        numbered = [e for e in diary if isinstance(e.start, float) and isinstance(e.end, float)]
        place_diary(numbered, None, LONGEST_US)
        return
    start = datetime.fromisoformat(found["start"]) if found["start"] else None
    duration_us = round(found["recorded_s"] * MICROSECONDS)
    if place_diary(diary, start, duration_us).flags:
        for entry, following in zip(diary, [*diary[1:], None], strict=True):
            end = following.start if entry.end is None and following else entry.end
            place_diary((replace(entry, end=end),), start, duration_us)


RESULT_NAMES = (
    "results.json",
    "report.html",
    "report.pdf",
    "answer.txt",
    "elevation.parquet",
    "elevation.csv.gz",
    "periods.csv",
    "summary.csv",
    "summary_fr.csv",
    "summary.xlsx",
    "summary.parquet",
    "dictionary.csv",
    "redcap_import.csv",
    "redcap_dictionary.csv",
    "fhir.json",
    "settings.yaml",
    "bundle.zip",
)


class AnalysisView(BaseModel):
    """An analysis: where it is, why it failed if it did, and where its files are."""

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
    duplicate_of: str | None = None
    problem: ProblemView | None = None


class AnalysisQuery(BaseModel):
    """Which analyses are listed; what is left out asks for any."""

    model_config = ConfigDict(extra="forbid")

    state: Literal["queued", "running", "succeeded", "failed", "cancelled"] | None = None
    batch_id: str = ""
    recording_id: str = ""
    limit: Annotated[int, Field(ge=1, le=500)] = 100
    cursor: str = ""
    lang: Language | None = None


class AnalysisList(BaseModel):
    """A page of analyses, newest first; ``next_cursor`` asks for the next, null ends."""

    items: list[AnalysisView]
    next_cursor: str | None


class StartedAnalyses(AnalysisView):
    """The first of the analyses that were asked for, and all of them in order."""

    items: list[AnalysisView]


def view_analysis(job: Job, language: Language) -> AnalysisView:
    """Show a job."""
    view = AnalysisView(
        id=job.id,
        recording_id=job.recording_id,
        state=job.state.value,
        stage=job.stage,
        progress=round(job.progress, 3),
        attempts=job.attempts,
        file_name=job.file_name,
        size_bytes=job.size_bytes,
        sha256=job.sha256,
        settings=view_settings(job.request),
        created_at=job.created_at.isoformat(),
        started_at=job.started_at.isoformat() if job.started_at else None,
        ended_at=job.ended_at.isoformat() if job.ended_at else None,
        links=dict(list_links(job)),
        batch_id=job.batch_id,
        replaced_by=job.replaced_by,
        interruptions=job.interruptions,
    )
    if job.problem_code is not None:
        view.problem = view_problem(job.problem_code, job.problem_facts, language, view.links["self"])
    return view


def list_links(job: Job) -> Mapping[str, str]:
    """Say where an analysis, what can be done with it and its files are."""
    own = f"/api/v1/analyses/{job.id}"
    if job.request.reference is not None:  # its files are those of a comparison
        return {"self": own, "validation": f"/api/v1/validations/{job.id}"}
    files = {name.replace(".", "_"): f"{own}/{name}" for name in RESULT_NAMES}
    steps = {name: f"{own}/{name}" for name in ("cancel", "retry", "events")}
    about = {"page": f"/analyses/{job.id}", "recording": f"/api/v1/recordings/{job.recording_id}"}
    return {"self": own, **steps, **about, **files}


def view_settings(request: ReportRequest) -> dict[str, Any]:
    """Show what was asked."""
    names = ("subject", "side", "method", "pose", "calibration_windows_s", "rate_hz", "source", "paper")
    periods = [period.model_dump() for period in view_periods(request.diary)]
    return {name: getattr(request, name) for name in names} | {"periods": periods}
