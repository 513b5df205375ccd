"""What may be asked with a recording."""

from collections.abc import Callable
from datetime import datetime
from typing import Annotated, Any, Literal, Self, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator
from pydantic_core import PydanticCustomError

from app.api.analysis_models import PeriodView
from app.errors import BadParameter
from app.report.words.subject import MAX_TEXT, clean_text
from app.report.words.wording import Language
from app.request import (
    SUBJECT_ALLOWED,
    WINDOW_ALLOWED,
    Paper,
    ReportRequest,
    check_subject,
    clean_file_name,
    list_window_counts,
    parse_window,
)
from fusion.conventions import MethodName, Pose

T = TypeVar("T")
CLOCK_ALLOWED = "2026-03-02, 2026-03-02T07:58"


def take_subject(text: str) -> str:
    """Take a subject code, or say what is allowed."""
    return _take(check_subject, text, SUBJECT_ALLOWED)


def take_device_clock(text: str) -> str:
    """Take a date or a time of the device's clock, which has no zone, or say what is allowed."""
    return _take(_read_device_clock, text, CLOCK_ALLOWED) if text else ""


def _read_device_clock(text: str) -> str:
    """Write it as starts are written.

    Raises
    ------
    ValueError
        Also for a time with a zone: compared with a clock that has none, it would find others.
    """
    moment = datetime.fromisoformat(text)
    if moment.tzinfo is not None:
        raise ValueError
    return moment.isoformat()


def _check_window(text: str) -> str:
    _take(parse_window, text, WINDOW_ALLOWED)
    return text


def _take(read: Callable[[str], T], text: str, allowed: str) -> T:
    try:
        return read(text)
    except ValueError:
        raise PydanticCustomError("value", "value", {"expected": allowed}) from None


class Wishes(BaseModel):
    """What may be asked of an analysis; a name that is not known is refused."""

    model_config = ConfigDict(extra="forbid")

    side: Annotated[Literal["left", "right"] | None, Field(description="Which arm.")] = None
    subject: Annotated[
        str,
        Field(description="Subject code; never a name."),
        AfterValidator(take_subject),
    ] = ""
    method: MethodName = "smoothed"
    pose: Pose = "n-pose"
    lang: Annotated[Language | None, Field(description="Language of the answer.")] = None
    paper: Annotated[Paper | None, Field(description="Paper of the PDF; else the server's.")] = None
    calibration: Annotated[
        list[Annotated[str, AfterValidator(_check_window)]],
        Field(max_length=2, description="START_S,END_S; twice for two-point: hanging, level."),
    ] = []
    rate_hz: Annotated[float | None, Field(ge=1, le=10_000, description="For logs without time.")] = None

    @model_validator(mode="after")
    def _count_windows(self) -> Self:
        allowed = list_window_counts(self.pose)
        if len(self.calibration) not in allowed:
            raise BadParameter(
                name="calibration",
                value=str(len(self.calibration)),
                allowed=f"{self.pose}: {'|'.join(map(str, allowed))} x {WINDOW_ALLOWED}",
            )
        return self

    def ask(self, file_name: str, language: Language, paper: Paper) -> ReportRequest:
        """Give the request of the one road; both languages are made, the one asked for first.

        ``language`` and ``paper`` are taken where nothing was asked.
        """
        first = self.lang or language
        return ReportRequest(
            file_name=file_name,
            subject=self.subject,
            side=self.side,
            method=self.method,
            pose=self.pose,
            calibration_windows_s=tuple(parse_window(text) for text in self.calibration),
            rate_hz=self.rate_hz,
            languages=(first, "en" if first == "fr" else "fr"),
            paper=self.paper or paper,
        )


class AnalyzeParameters(Wishes):
    """What may be asked with a recording."""

    file_name: Annotated[str, Field(max_length=1000, description="Name of the file, for people.")] = ""
    external_id: Annotated[
        str, Field(description="Its name in your own system."), AfterValidator(take_subject)
    ] = ""
    again: Annotated[bool, Field(description="Analyse anew what has been analysed alike.")] = False

    def to_request(self, language: Language, paper: Paper) -> ReportRequest:
        """Give the request of the one road."""
        return self.ask(clean_file_name(self.file_name), language, paper)


class AnalysisSettings(Wishes):
    """What may be asked of a stored recording; what is left out is as the recording says."""

    source: Annotated[
        Literal["samples", "angles"], Field(description="Samples of a sensor, or ready angles.")
    ] = "samples"
    profile: Annotated[
        dict[str, Any] | None, Field(description="What the columns mean, for tables that do not tell.")
    ] = None
    periods: Annotated[
        list[PeriodView] | None, Field(max_length=10_000, description="In place of the recording's periods.")
    ] = None
    reason: Annotated[
        str,
        Field(max_length=MAX_TEXT, description="Why it is analysed anew; the report says it."),
        AfterValidator(clean_text),
    ] = ""
