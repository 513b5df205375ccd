"""Reports of several analyses: both arms of a shift, two days compared, several days of people."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Annotated, Any, Literal, Self, TypeVar

from fastapi import APIRouter, Query, Request, Response
from pydantic import BaseModel, ConfigDict, Field, model_validator

from acromion.app.errors import BadParameter
from acromion.app.http.api.library.files import serve_bytes
from acromion.app.http.middleware.problems import PROBLEM_RESPONSES
from acromion.app.library.report_cache import AnyReportJobs, ReportJobs
from acromion.app.report.words.wording import Language
from acromion.app.request import (
    LONGEST_OFFSET_S,
    MIN_HOURS,
    PairClockSource,
    PairRequest,
    Paper,
    ProfileRequest,
)
from acromion.app.services import Services, UsedLanguage, UsedServices

router = APIRouter(
    prefix="/api/v1", responses=PROBLEM_RESPONSES, tags=["pairs"], default_response_class=Response
)

R = TypeVar("R", PairRequest, ProfileRequest)
Side = Literal["left", "right"]
Offset = Annotated[float | None, Field(ge=-LONGEST_OFFSET_S, le=LONGEST_OFFSET_S)]
SameSubject = Annotated[bool, Field(description="All are of one person, although a subject code is missing.")]
MixedMethods = Annotated[bool, Field(description="Allow analyses by different methods or method versions.")]
OnePersonView = Annotated[
    Literal["codes", "person", "no"],
    Field(
        description="Whether all are of one person: codes (the subject codes match, or it is one recording), "
        "person (the request states `same_subject`), or no (unknown)."
    ),
]
PaperChoice = Annotated[
    Paper | None, Field(description="Paper of the PDF; default: that of the first analysis.")
]


class FigureView(BaseModel):
    """A figure before and after. ``detectable``: the smallest change that exceeds day-to-day variation."""

    name: str
    before: float
    after: float
    change: float
    detectable: float | None
    verdict: str


class _Exact(BaseModel):
    model_config = ConfigDict(extra="forbid")


class SourceView(_Exact):
    """One of the analyses. ``start``: by the device's clock; null if the clock was never set."""

    report_id: str
    sha256: str
    file_name: str
    subject: str
    side: Side | None
    start: str | None
    analysed_s: float
    verdict: Literal["good", "caution", "poor"]


class MatchView(_Exact):
    """The relation of two clocks in the movement that both sensors share.

    ``margin_s``: 95 % limit of the error in the common time. ``windows``: minutes that agree, of those
    ``searched``.
    """

    offset_s: float
    drift_ppm: float
    margin_s: float
    windows: int
    searched: int


class ClockView(_Exact):
    """When a recording started, in seconds after the left arm's, and the source of this.

    ``drift_ppm``: how much faster its clock runs, as corrected. ``match``: null if the movement gives no
    certain relation; beside clocks it only confirms or contradicts. ``differs_s``: how far it is from the
    clocks at most.
    """

    offset_s: float
    stated_by: Annotated[Literal["clocks", "person", "signals"], Field(alias="from")]
    certainty: Literal["person", "signals", "clocks", "confirmed", "doubtful"]
    differs_s: float
    drift_ppm: float
    match: MatchView | None


class ArmView(_Exact):
    """One arm over the time that both share; keys are percentiles, or angles in degrees."""

    percentiles_deg: dict[str, float]
    time_above_percent: dict[str, float]


class RatioView(_Exact):
    """Right arm divided by left; null if the left is 0."""

    time_above_60: float | None
    elevation_p50: float | None


class TrunkView(_Exact):
    """An arm's elevation minus the trunk's inclination; ``limit`` states the limits of this difference."""

    limit: str
    shared_s: float
    percentiles_deg: dict[str, float] | None


class LevelView(_Exact):
    """A proposed level beside a figure and its range; ``reason`` states why nothing is compared."""

    key: Literal["above_30", "above_60", "velocity"]
    at_most: float
    measured: float | None
    low: float | None
    high: float | None
    low_pose: float | None
    high_pose: float | None
    standing: Literal["below", "above", "cannot tell"] | None
    reason: Literal["", "short", "poor", "not computed"]


class MeanLevelView(LevelView):
    """A proposed level beside the mean of the days; ``days_above``: days that read above it."""

    days_above: int
    days: int


class PairView(_Exact):
    """The figures of both arms of one shift; ``intervals`` are 95 % ranges."""

    layout: Annotated[Literal["acromion.pair/1"], Field(alias="schema")]
    left: SourceView
    right: SourceView
    trunk: SourceView | None
    one_person: OnePersonView
    clock: ClockView
    trunk_clock: ClockView | None
    shared_s: float
    arms: dict[Side, ArmView]
    both_above_60_percent: float
    right_to_left: RatioView
    intervals: dict[str, tuple[float, float]]
    levels: dict[Side, list[LevelView]]
    trunk_relative: dict[Side, TrunkView]


class ChangeView(_Exact):
    """The figures of one day compared with an earlier one."""

    layout: Annotated[Literal["acromion.comparison/1"], Field(alias="schema")]
    before: SourceView
    after: SourceView
    one_person: OnePersonView
    figures: list[FigureView]
    differences: list[str]
    source: str


MAX_DAYS = 300
"""Most analyses in one profile, on each side of a change."""
Stage = Literal["all", "before", "after"]
Ends = tuple[float, float]


class RangeView(_Exact):
    """The range of a figure on one day, without and with the N-pose error."""

    low: float
    high: float
    low_pose: float | None
    high_pose: float | None


class DayView(SourceView):
    """One day. ``left_out``: why it is excluded from mean and spread; null if it is included."""

    device: str
    method: str | None
    pose: str | None
    left_out: Literal["short", "long"] | None
    job_title: str
    isco_code: str
    figures: dict[str, float | None]
    ranges: dict[str, RangeView | None]


class MeanView(_Exact):
    """The mean of a figure over the days of one arm; ranges are 95 % ranges, null for a single day.

    ``low_pose`` and ``high_pose`` are means of the days' values; null unless every day has them.
    """

    days: int
    mean: float
    sd: float | None
    mean_range: Ends | None
    sd_range: Ends | None
    low_pose: float | None
    high_pose: float | None


class TellingView(_Exact):
    """Days needed to detect a change of half the time above 60 deg, and the source of the deviation used."""

    sd: float
    sd_from: Literal["person", "published"]
    days: int
    more_days: int
    detectable: float
    detectable_range: Ends | None


class TrendView(_Exact):
    """One person's time above 60 deg from the first day to the last.

    ``outside``: later days that differ from the first by more than ``detectable``.
    """

    first: float
    last: float
    change: float
    detectable: float
    sd_from: Literal["person", "published"]
    outside: int


class BandView(_Exact):
    """A quarter hour of the clock over the days; null if too few days have data in it."""

    clock: str
    days: int
    p10_deg: float | None
    p25_deg: float | None
    p50_deg: float | None
    p75_deg: float | None
    p90_deg: float | None


class ArmDaysView(_Exact):
    """One arm of one person, on one side of a change ("all" without a change)."""

    subject: str
    side: Side | None
    stage: Stage
    days: list[DayView]
    figures: dict[str, MeanView]
    levels: list[MeanLevelView]
    telling: TellingView | None
    trend: TrendView | None
    overlay: list[BandView]


class SpreadView(_Exact):
    """A figure over a group: standard deviations between and within people, with their 95 % ranges."""

    people: int
    days: int
    mean: float
    mean_range: Ends | None
    within_sd: float | None
    between_sd: float | None
    within_range: Ends | None
    between_range: Ends | None
    low_pose: float | None
    high_pose: float | None


class GroupView(_Exact):
    """The spread of a group, for one arm on one side of a change."""

    side: Side | None
    stage: Stage
    figures: dict[str, SpreadView]
    levels: list[MeanLevelView]


class JobView(_Exact):
    """The spread of the people of one job; without a title and a code, of the pooled jobs."""

    side: Side | None
    stage: Stage
    job_title: str | None
    isco_code: str | None
    figures: dict[str, SpreadView]


class PeopleChangeView(_Exact):
    """After minus before, for people with days on both sides; ``detectable`` applies to a single person."""

    people: int
    before: float
    after: float
    change: float
    change_range: Ends | None
    detectable: float | None
    verdict: Literal["larger", "not larger", "unknown"]


class SideChangeView(_Exact):
    """The change of one arm."""

    side: Side | None
    figures: dict[str, PeopleChangeView]


class ProfileView(_Exact):
    """Several days of a person, or of a group."""

    layout: Annotated[Literal["acromion.profile/1"], Field(alias="schema")]
    one_person: OnePersonView
    differences: list[str]
    arms: list[ArmDaysView]
    group: list[GroupView]
    jobs: list[JobView]
    change: list[SideChangeView]
    rules: dict[str, float]
    source: str


def get_asked_jobs(
    services: Services, ids: Iterable[str], request: R, paper: Paper | None = None
) -> ReportJobs[R]:
    """Return the analyses of a request; the paper defaults to that of the first analysis.

    Raises NotHere.
    """
    jobs = tuple(map(services.store.get, ids))
    return ReportJobs(jobs, replace(request, paper=paper or jobs[0].request.paper))


class ChangeQuery(_Exact):
    """The two analyses, the earlier first, and the paper of their report."""

    analysis: Annotated[list[str], Field(min_length=2, max_length=2, description="Twice: before, after.")]
    same_subject: SameSubject = False
    lang: Language | None = None
    mixed_methods: MixedMethods = False
    paper: PaperChoice = None

    def find(self, services: Services) -> ReportJobs[PairRequest]:
        """Return the analyses. Raises NotHere."""
        request = PairRequest("compare", same_subject=self.same_subject, mixed_methods=self.mixed_methods)
        return get_asked_jobs(services, self.analysis, request, self.paper)


class PairQuery(_Exact):
    """The analyses of both arms and, if measured, of the trunk."""

    left: Annotated[str, Field(description="Analysis of the left arm.")]
    right: Annotated[str, Field(description="Analysis of the right arm.")]
    trunk: Annotated[str, Field(description="Analysis of a recording of the trunk.")] = ""
    offset_s: Annotated[
        Offset,
        Field(
            description="When the right recording started, in seconds after the left; default: by the clocks."
        ),
    ] = None
    trunk_offset_s: Annotated[Offset, Field(description="The same for the trunk's recording.")] = None
    clock: Annotated[
        PairClockSource,
        Field(
            description="What gives the offsets not stated: the devices' clocks, or the shared movement "
            "(signals); an uncertain match is refused with E-PAIR."
        ),
    ] = "devices"
    same_subject: SameSubject = False
    mixed_methods: MixedMethods = False
    paper: PaperChoice = None
    lang: Language | None = None

    @model_validator(mode="after")
    def _check_trunk(self) -> Self:
        if self.trunk_offset_s is not None and not self.trunk:
            raise BadParameter(name="trunk", value="", allowed="trunk_offset_s + trunk")
        return self

    def find(self, services: Services) -> ReportJobs[PairRequest]:
        """Return the analyses. Raises NotHere."""
        request = PairRequest(
            "pair",
            self.offset_s,
            self.trunk_offset_s,
            clock=self.clock,
            same_subject=self.same_subject,
            mixed_methods=self.mixed_methods,
        )
        ids = (self.left, self.right, *filter(None, [self.trunk]))
        return get_asked_jobs(services, ids, request, self.paper)


class ProfileQuery(_Exact):
    """The analyses of the days; with ``after``, those before a change and those after it."""

    analysis: Annotated[list[str], Field(min_length=1, max_length=MAX_DAYS, description="Once per day.")]
    after: Annotated[list[str], Field(max_length=MAX_DAYS, description="Once per day after a change.")] = []
    min_hours: Annotated[
        float, Field(ge=0, le=24, description="Least analysed hours of a day that counts.")
    ] = MIN_HOURS
    same_subject: SameSubject = False
    mixed_methods: MixedMethods = False
    paper: PaperChoice = None
    lang: Language | None = None

    def find(self, services: Services) -> ReportJobs[ProfileRequest]:
        """Return the analyses. Raises NotHere."""
        request = ProfileRequest(
            len(self.analysis) if self.after else None,
            same_subject=self.same_subject,
            mixed_methods=self.mixed_methods,
            min_hours=self.min_hours,
            has_drawings=True,
        )
        return get_asked_jobs(services, (*self.analysis, *self.after), request, self.paper)


PairChoice = Annotated[PairQuery, Query()]
ProfileChoice = Annotated[ProfileQuery, Query()]
ChangeChoice = Annotated[ChangeQuery, Query()]
ReportName = Literal["report.html", "report.pdf", "answer.txt"]
REPORT_RESPONSE: dict[int | str, dict[str, Any]] = {
    200: {"content": {kind: {} for kind in ("text/html", "application/pdf", "text/plain")}}
}


@router.get("/compare/comparison.json", responses={200: {"model": ChangeView}})
def get_change(request: Request, services: UsedServices, asked: ChangeChoice) -> Response:
    """Return every figure of the change, byte for byte as ``acromion compare`` writes it."""
    return _serve_figures(request, services, asked.find(services))


@router.get("/compare/{name}", responses=REPORT_RESPONSE)
def get_change_report(
    name: ReportName, request: Request, services: UsedServices, language: UsedLanguage, asked: ChangeChoice
) -> Response:
    """Return the report on the change between two days, or its answer in five lines."""
    return _serve_report(request, services, asked.find(services), name, language)


@router.get("/pair/pair.json", responses={200: {"model": PairView}})
def get_pair(request: Request, services: UsedServices, asked: PairChoice) -> Response:
    """Return every figure of both arms of one shift, byte for byte as ``acromion pair`` writes it."""
    return _serve_figures(request, services, asked.find(services))


@router.get("/pair/{name}", responses=REPORT_RESPONSE)
def get_pair_report(
    name: ReportName, request: Request, services: UsedServices, language: UsedLanguage, asked: PairChoice
) -> Response:
    """Return the report of both arms of one shift, or its answer in five lines."""
    return _serve_report(request, services, asked.find(services), name, language)


@router.get("/profile/profile.json", responses={200: {"model": ProfileView}})
def get_profile(request: Request, services: UsedServices, asked: ProfileChoice) -> Response:
    """Return every figure of several days, byte for byte as ``acromion profile`` writes it."""
    return _serve_figures(request, services, asked.find(services))


@router.get("/profile/{name}.csv", responses={200: {"content": {"text/csv": {}}}})
def get_profile_table(
    name: Literal["profile", "overlay"], request: Request, services: UsedServices, asked: ProfileChoice
) -> Response:
    """Return a row per day, or per quarter hour of the clock."""
    found = asked.find(services)
    body = services.pairs.make(found).read(f"{name}.csv")
    return serve_bytes(request, body, build_pair_download_name(found, f"{name}.csv"))


@router.get("/profile/{name}", responses=REPORT_RESPONSE)
def get_profile_report(
    name: ReportName, request: Request, services: UsedServices, language: UsedLanguage, asked: ProfileChoice
) -> Response:
    """Return the report of several days of a person or of a group, or its answer in a few lines."""
    return _serve_report(request, services, asked.find(services), name, language)


def build_pair_download_name(asked: AnyReportJobs, ending: str) -> str:
    """Build the name of a download from its subject: ``S012_pair.en.pdf``; "group" for several subjects."""
    codes = {job.request.subject for job in asked.jobs} - {""}
    code = "group" if len(codes) > 1 else "".join(codes)
    subject = "".join(c for c in code if c.isalnum() or c in "-_") or "report"
    return f"{subject}_{asked.request.kind}.{ending}"


def _serve_figures(request: Request, services: Services, asked: AnyReportJobs) -> Response:
    body = services.pairs.make(asked).read(asked.request.figures_name)
    return serve_bytes(request, body, build_pair_download_name(asked, "json"))


def _serve_report(
    request: Request, services: Services, asked: AnyReportJobs, name: str, language: Language
) -> Response:
    stem, _, kind = name.partition(".")
    report = services.pairs.make(asked)
    body = report.read(report.find(stem, kind, language))
    return serve_bytes(request, body, build_pair_download_name(asked, f"{language}.{kind}"))
