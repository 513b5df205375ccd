"""Columns of an unknown table: proposed from its first rows, confirmed by a person."""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from fastapi import APIRouter, Response

from acromion.app.errors import BadParameter
from acromion.app.http.api.library.analyses import check_queue
from acromion.app.http.pages.rendering import Form, Page, UsedForm, UsedPage, first
from acromion.app.http.pages.views import build_problem, format_stored_time
from acromion.app.library.mappings import UNNAMED
from acromion.app.library.rows import Job, JobState
from acromion.app.report.words.messages import format_columns
from acromion.app.report.words.wording import clean_text, cut_text
from acromion.app.request import write_profile
from acromion.app.services import Services
from acromion.app.store.folder import borrow_recording

AXES = ("x", "y", "z")
VECTORS = ("acceleration", "angular_rate")
UNITS: Mapping[str, Sequence[str]] = {
    "acceleration_unit": ("g", "mg", "m/s2"),
    "angular_rate_unit": ("dps", "mdps", "rad/s"),
    "time_unit": ("s", "ms", "us", "ns"),
}
DATE_ORDERS = ("dmy", "mdy")
MAX_NAME_LENGTH = 60

router = APIRouter(include_in_schema=False)


@dataclass(frozen=True, slots=True)
class Choice:
    """A field of the form; ``chosen``: the column number from 1; 0 for none."""

    name: str
    vector: str
    axis: str
    chosen: int


@dataclass(frozen=True, slots=True)
class Offer:
    """Columns that were named before for files with the same header.

    ``waiting``: how many other recordings with this header need columns. ``is_unnamed``: the file has no
    column names, so the columns are offered for every file instead of being applied automatically.
    """

    header: str
    columns: str
    when: str
    waiting: int
    is_unnamed: bool


@router.get("/analyses/{analysis_id}/columns")
def show_columns(analysis_id: str, page: UsedPage) -> Response:
    """Ask for the meaning of the columns, with the first rows and a proposal from the column names."""
    services = page.services
    job = services.store.get(analysis_id)
    with borrow_recording(services.storage, job.recording_id, job.sha256) as log:
        found = services.inspector.propose_columns(log, job.request)
    header, columns = found["header"], found["columns"]
    profile = json.loads(job.request.profile or "{}")
    named = {"sensor": "", "rate_hz": "", "date_order": ""} | found | profile
    time = profile.get("time") if job.request.profile else named["time"]
    return page.render(
        "recording/columns.html",
        job=job,
        problem=build_problem(job, page.language),
        found=named,
        rate=named["rate_hz"],
        offer=find_offer(page, job, header),
        waiting=_count_others(services, job, header),
        is_unnamed=header.startswith(UNNAMED),
        choices=[
            Choice(f"{vector}_{axis}", vector, axis, _find_column(place, columns))
            for vector in VECTORS
            for axis, place in zip(AXES, named[vector] or (None, None, None), strict=True)
        ],
        time=_find_column(time, columns),
        units=UNITS,
        orders=DATE_ORDERS,
    )


@router.post("/analyses/{analysis_id}/columns")
def save_columns(analysis_id: str, page: UsedPage, form: UsedForm) -> Response:
    """Store the columns for the header and analyse the recording and, if requested, other waiting ones."""
    services = page.services
    job = services.store.get(analysis_id)
    profile, header = write_profile(read_profile(form)), _read_header(form)
    is_confirmed = bool(first(form, "everywhere"))
    waiting_for = header if is_confirmed else ""
    check_queue(services, 1 + (services.mappings.count_waiting(header) if waiting_for else 0))
    if header:
        names = name_columns(form.get("column", []))
        services.mappings.put(header, names, profile, is_confirmed=is_confirmed)
    again = services.mappings.analyse(job, profile, waiting_for)
    return page.go(f"/analyses/{again.id}")


@router.post("/analyses/{analysis_id}/columns/use")
def use_columns(analysis_id: str, page: UsedPage, form: UsedForm) -> Response:
    """Use the stored columns for this file, for all waiting files, and for future files."""
    header, services = _read_header(form), page.services
    job, mapping = services.store.get(analysis_id), services.mappings.get(header)
    check_queue(services, 1 + services.mappings.count_waiting(header))
    services.mappings.change(header, is_confirmed=1)
    again = services.mappings.analyse(job, mapping.profile, header)
    return page.go(f"/analyses/{again.id}")


def name_columns(columns: Sequence[str]) -> str:
    """Name a mapping by its columns and not by a file name, so that a purged recording leaves no trace."""
    named = ", ".join(filter(None, columns))
    return cut_text(clean_text(named), MAX_NAME_LENGTH) or f"({len(columns)})"


def find_offer(page: Page, job: Job, header: str) -> Offer | None:
    """Return the stored columns of a header, unless the analysis has already used them."""
    mapping = page.services.mappings.find(header) if header else None
    if mapping is None or mapping.profile == job.request.profile:
        return None
    return Offer(
        header,
        format_columns(mapping.profile, page.language),
        format_stored_time(mapping.created_at, page.language),
        _count_others(page.services, job, header),
        header.startswith(UNNAMED),
    )


def _count_others(services: Services, job: Job, header: str) -> int:
    """Count the other recordings with a header that need columns."""
    return max(0, services.mappings.count_waiting(header) - (job.state is JobState.FAILED)) if header else 0


def _read_header(form: Form) -> str:
    header = first(form, "header")
    if not re.fullmatch(r"-?[0-9a-f]{16}|", header):
        raise BadParameter(name="header", value=header[:60], allowed="0-9, a-f")
    return header


def read_profile(form: Form) -> dict[str, Any]:
    """Build the profile of the form for :func:`acromion.fusion.readers.parse_profile`.

    Raises BadParameter.
    """
    names = form.get("column", [])
    stated: dict[str, Any] = {name: first(form, name) for name in UNITS if first(form, name)}
    if rate := first(form, "rate_hz"):
        try:
            stated["rate_hz"] = float(rate.replace(",", "."))
        except ValueError:
            raise BadParameter(name="rate_hz", value=rate[:60], allowed="100") from None
    if first(form, "date_order"):
        stated["date_order"] = first(form, "date_order")
    if first(form, "sensor"):
        return {"sensor": first(form, "sensor")} | stated
    if first(form, "is_pair"):
        return stated
    profile: dict[str, Any] = {
        vector: [_read_column(first(form, f"{vector}_{axis}"), f"{vector}_{axis}", names) for axis in AXES]
        for vector in VECTORS
    }
    time = first(form, "time")
    if time not in ("", "0"):
        profile["time"] = _read_column(time, "time", names)
    return profile | stated


def _read_column(text: str, name: str, names: Sequence[str]) -> int | str:
    """Parse a column number; return the column's name if it is unique."""
    if not text.isdecimal() or not 1 <= int(text) <= 1000:
        raise BadParameter(name=name, value=text[:60], allowed="1 … 1000")
    number = int(text)
    own = names[number - 1] if number <= len(names) else ""
    return own if own and names.count(own) == 1 else number


def _find_column(place: int | str | None, columns: Sequence[str]) -> int:
    """Return the number of a column that is given by number or name; 0 for none."""
    if isinstance(place, str):
        return columns.index(place) + 1 if place in columns else 0
    return place or 0


# Column mappings: list, rename and delete.


@router.get("/columns")
def list_mappings(page: UsedPage) -> Response:
    """List the column mappings."""
    rows = [
        (
            mapping,
            format_stored_time(mapping.created_at, page.language),
            format_columns(mapping.profile, page.language),
        )
        for mapping in page.services.mappings.find_all()
    ]
    return page.render("library/mappings.html", rows=rows, unnamed=UNNAMED)


@router.post("/columns/{header}")
def change_mapping(header: str, page: UsedPage, form: UsedForm) -> Response:
    """Rename a mapping, or set whether further files are read without asking (a form without scripts)."""
    values: dict[str, str | int] = {"is_confirmed": int(bool(first(form, "everywhere")))}
    if name := clean_text(first(form, "name")):
        values["name"] = name
    page.services.mappings.change(header, **values)
    return page.go("/columns")


@router.post("/columns/{header}/delete")
def forget_mapping(header: str, page: UsedPage) -> Response:
    """Delete the columns of a header; reports that used them stay."""
    page.services.mappings.drop(header)
    return page.go("/columns")
