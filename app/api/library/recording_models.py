"""Recordings as the API takes and gives them."""

import base64
import binascii
from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import Annotated, Literal, TypeVar
from urllib.parse import urlencode

from fastapi import Request, Response
from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from app.api.library.analysis_models import parse_device_clock, parse_subject
from app.errors import BadParameter
from app.jobs.recordings import Description, Place, RecordingFilter, StoredRow
from app.report.words.wording import Language
from app.request import clean_file_name
from fusion.caveats import Caveat
from fusion.conventions import Side

# Long lists, page by page.


T = TypeVar("T")


def write_cursor(place: Place) -> str:
    """Write where a page ended, as text that nobody need understand."""
    return base64.urlsafe_b64encode("|".join(place).encode()).decode().rstrip("=")


def read_cursor(text: str) -> Place | None:
    """Read what :func:`write_cursor` wrote; None for "". Raises BadParameter."""
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
    """Give the rows of the page and the cursor of the next, from one row more than asked for.

    The answer also gets ``Link: <...>; rel="next"`` (RFC 8288).
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
    """What people say about a recording; a name that is not known is refused."""

    model_config = ConfigDict(extra="forbid")

    file_name: Annotated[str, Field(max_length=1000, description="Name of the file, for people.")] = ""
    subject: Annotated[
        str, Field(description="Subject code; never a name."), AfterValidator(parse_subject)
    ] = ""
    side: Annotated[Side | None, Field(description="Which arm.")] = None
    external_id: Annotated[Text, Field(description="Its name in your own system.")] = ""
    note: Note = ""

    def describe(self) -> Description:
        """Give the words to the rows."""
        return Description(
            clean_file_name(self.file_name), self.subject, self.side, self.external_id, self.note
        )


class RecordingPatch(BaseModel):
    """A JSON merge patch (RFC 7396): what is absent stays, null takes the value away."""

    model_config = ConfigDict(extra="forbid")

    file_name: Annotated[str, Field(max_length=1000)] | None = None
    subject: Annotated[str, AfterValidator(parse_subject)] | None = None
    side: Side | None = None
    external_id: Text | None = None
    note: Note | None = None

    def merge(self, about: Description) -> Description:
        """Give the words after the change."""
        named = {name: getattr(self, name) for name in self.model_fields_set}
        emptied = {name: "" if value is None and name != "side" else value for name, value in named.items()}
        return RecordingWords(**(asdict(about) | emptied)).describe()


class RecordingView(BaseModel):
    """A stored recording. ``start`` is known once it has been inspected."""

    id: str
    file_name: str
    subject: str
    side: Literal["left", "right"] | None
    external_id: str
    note: str
    sha256: str
    size_bytes: int
    duplicate_of: str | None
    warnings: list[str]
    damage: str | None = Field(
        None, description="E-STORE-DAMAGED where the stored bytes are gone or altered."
    )
    start: str | None
    period_count: int
    version: int
    state: Literal["stored", "trashed"]
    hold: str | None = Field(None, description="Why it may not be deleted for good; null where it may.")
    created_at: str
    links: dict[str, str]


class RecordingQuery(BaseModel):
    """Which recordings are listed; what is left out asks for any."""

    model_config = ConfigDict(extra="forbid")

    subject: str = ""
    external_id: str = ""
    sha256: str = ""
    begin: Annotated[
        str,
        Field(alias="from", description="First start, ISO 8601, by the device's clock: without a zone."),
        AfterValidator(parse_device_clock),
    ] = ""
    end: Annotated[
        str,
        Field(alias="to", description="Start before this, by the same clock."),
        AfterValidator(parse_device_clock),
    ] = ""
    trashed: bool = False
    limit: Annotated[int, Field(ge=1, le=500)] = 50
    cursor: str = ""
    lang: Language | None = None

    def wanted(self) -> RecordingFilter:
        """Give the filter of the rows."""
        return RecordingFilter(
            self.subject, self.external_id, self.sha256, self.begin, self.end, self.trashed
        )


class RecordingList(BaseModel):
    """A page of recordings; ``next_cursor`` asks for the next, null ends."""

    items: list[RecordingView]
    next_cursor: str | None


def view_recording(row: StoredRow) -> RecordingView:
    """Show a recording."""
    own = f"/api/v1/recordings/{row.id}"
    links = {"self": own} | {part: f"{own}/{part}" for part in ("file", "inspection", "periods")}
    about = {name: value for name, value in asdict(row.about).items() if value is not None}
    return RecordingView(
        id=row.id,
        **{"side": None} | about,
        sha256=row.sha256,
        size_bytes=row.size_bytes,
        duplicate_of=row.duplicate_of,
        warnings=[SENT_BEFORE] if row.duplicate_of else [],
        start=row.start,
        period_count=len(row.diary),
        version=row.version,
        state=row.state,
        hold=row.hold or None,
        created_at=row.created_at,
        links=links | {"analyses": f"/api/v1/analyses?recording_id={row.id}"},
    )
