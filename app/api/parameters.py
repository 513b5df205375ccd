"""What may be asked with a recording."""

import math
import re
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field
from pydantic_core import PydanticCustomError

from app.report.wording import Language
from app.workflow import ReportRequest
from fusion.calibration import Pose
from fusion.orientation import MethodName

# Control characters, and the marks that turn the direction of text around them.
_UNPRINTABLE = re.compile(r"[\x00-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")
_LONGEST_NAME = 200


def clean_file_name(name: str) -> str:
    """Give the last part of a path as one printable line; it is only ever shown, never a path on our disk."""
    last = re.split(r"[/\\]", name)[-1]
    kept = _UNPRINTABLE.sub("", last).strip()
    stem, dot, ending = kept.rpartition(".")
    if len(kept) > _LONGEST_NAME and dot and len(ending) <= 10:
        kept = stem[: _LONGEST_NAME - len(ending) - 1] + dot + ending
    return kept[:_LONGEST_NAME] or "recording"


def _check_printable(text: str) -> str:
    if _UNPRINTABLE.search(text):
        raise PydanticCustomError("unprintable", "unprintable", {"expected": "A-Z a-z 0-9 - _"})
    return text.strip()


def _check_window(text: str) -> str:
    parse_window(text)
    return text


def parse_window(text: str) -> tuple[float, float]:
    """Read ``START_S,END_S``."""
    try:
        start_s, end_s = (float(part) for part in text.split(","))
    except ValueError:
        start_s = end_s = math.nan
    if not 0 <= start_s < end_s < math.inf:
        raise PydanticCustomError("window", "window", {"expected": "START_S,END_S"})
    return start_s, end_s


class AnalyzeParameters(BaseModel):
    """Everything that may be asked with a recording; a name that is not known is refused."""

    model_config = ConfigDict(extra="forbid")

    file_name: Annotated[str, Field(max_length=1000, description="Name of the file, for people.")] = ""
    side: Annotated[Literal["left", "right"] | None, Field(description="Which arm.")] = None
    subject: Annotated[
        str,
        Field(max_length=100, description="Subject code; never a name."),
        AfterValidator(_check_printable),
    ] = ""
    method: MethodName = "smoothed"
    pose: Pose = "n-pose"
    lang: Annotated[Language | None, Field(description="Language of the answer.")] = None
    calibration: Annotated[
        list[Annotated[str, AfterValidator(_check_window)]],
        Field(max_length=2, description="START_S,END_S; twice for two-point: hanging, level."),
    ] = []
    rate_hz: Annotated[float | None, Field(ge=1, le=10_000, description="For logs without time.")] = None

    def to_request(self, language: Language) -> ReportRequest:
        """Give the request of the one road; both languages are made, the one asked for first."""
        other: Language = "en" if language == "fr" else "fr"
        return ReportRequest(
            file_name=clean_file_name(self.file_name),
            subject=self.subject,
            side=self.side,
            method=self.method,
            pose=self.pose,
            calibration_windows_s=tuple(parse_window(text) for text in self.calibration),
            rate_hz=self.rate_hz,
            languages=(language, other),
        )
