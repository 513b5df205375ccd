"""Columns of an unknown table: proposed from its first rows, chosen by a person."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from fastapi import APIRouter, Request, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import RedirectResponse

from app.errors import BadParameter
from app.report.words.wording import load_wording
from app.services import UsedLanguage, UsedServices
from app.storage.store import borrow_recording
from app.web.forms import Form, first, read_form
from app.web.rendering import find_base, render_page

AXES = ("x", "y", "z")
VECTORS = ("acceleration", "angular_rate")
UNITS: Mapping[str, Sequence[str]] = {
    "acceleration_unit": ("g", "mg", "m/s2"),
    "angular_rate_unit": ("dps", "mdps", "rad/s"),
    "time_unit": ("s", "ms", "us", "ns"),
}
DATE_ORDERS = ("dmy", "mdy")

router = APIRouter(include_in_schema=False, prefix="/analyses/{analysis_id}/columns")


@dataclass(frozen=True, slots=True)
class Choice:
    """A field of the form: which column, counted from 1; 0 for none."""

    name: str
    vector: str
    axis: str
    chosen: int


@router.get("")
def ask_columns(
    analysis_id: str, request: Request, services: UsedServices, language: UsedLanguage
) -> Response:
    """Ask which column is what, with the first rows and a proposal by their names."""
    job = services.store.get(analysis_id)
    with borrow_recording(services.storage, job.recording_id, job.sha256) as log:
        found = services.inspector.propose_columns(log, job.request)
    values = {
        "job": job,
        "found": found,
        "choices": [choice for vector in VECTORS for choice in _build_choices(vector, found)],
        "time": _find_column(found["time"], found["columns"]),
        "units": UNITS,
        "orders": DATE_ORDERS,
        "c": load_wording(language, "columns"),
    }
    return render_page(request, "columns.html", language, values)


@router.post("")
async def take_columns(analysis_id: str, request: Request, services: UsedServices) -> Response:
    """Analyse the recording by the chosen columns."""
    form = await read_form(request)
    job = await run_in_threadpool(services.store.get, analysis_id)
    asked = replace(job.request, profile=json.dumps(read_profile(form), sort_keys=True))
    recording = (job.recording_id, job.sha256)
    again = await run_in_threadpool(services.store.add_analysis, recording, asked, "web")
    return RedirectResponse(f"{find_base(request)}/analyses/{again.id}", status_code=303)


def read_profile(form: Form) -> dict[str, Any]:
    """Give the profile of the form, as :func:`fusion.readers.parse_profile` reads it.

    Raises
    ------
    BadParameter
    """
    profile: dict[str, Any] = {
        vector: [_read_column(first(form, f"{vector}_{axis}"), f"{vector}_{axis}") for axis in AXES]
        for vector in VECTORS
    }
    profile |= {name: first(form, name) for name in UNITS if first(form, name)}
    time, rate = first(form, "time"), first(form, "rate_hz")
    if time not in ("", "0"):
        profile["time"] = _read_column(time, "time")
    if rate:
        profile["rate_hz"] = _read_rate(rate)
    if first(form, "date_order"):
        profile["date_order"] = first(form, "date_order")
    return profile


def _read_column(text: str, name: str) -> int:
    if not text.isdecimal() or not 1 <= int(text) <= 1000:
        raise BadParameter(name=name, value=text[:60], allowed="1 … 1000")
    return int(text)


def _read_rate(text: str) -> float:
    try:
        return float(text.replace(",", "."))
    except ValueError:
        raise BadParameter(name="rate_hz", value=text[:60], allowed="100") from None


def _build_choices(vector: str, found: Mapping[str, Any]) -> list[Choice]:
    places = found[vector] or (None, None, None)
    return [
        Choice(f"{vector}_{axis}", vector, axis, _find_column(place, found["columns"]))
        for axis, place in zip(AXES, places, strict=True)
    ]


def _find_column(place: int | str | None, columns: Sequence[str]) -> int:
    """Give the number of a column, which a proposal names where its name is its own."""
    if isinstance(place, str):
        return columns.index(place) + 1 if place in columns else 0
    return place or 0
