"""The columns that a person named, in one line: for the report and for the pages."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

from app.report.words.numbers import format_number
from app.report.words.subject import clean_text
from app.report.words.wording import Language, load_wording

VECTORS = ("acceleration", "angular_rate")


def format_columns(profile: str, language: Language) -> str:
    """Write a column profile: "Acceleration: p, q, r (mg) · Angular rate (gyroscope): 5, 6, 7 · Time: k"."""
    values, words = json.loads(profile), load_wording(language, "columns")
    told = {name: _format_vector(values, name, language) for name in VECTORS if values.get(name)}
    if values.get("sensor"):
        told["sensor"] = clean_text(values["sensor"])
        told |= {name: str(values[f"{name}_unit"]) for name in VECTORS if values.get(f"{name}_unit")}
    if values.get("time") is not None:
        told["time"] = _format_places([values["time"]]) + _format_unit(values, "time")
    if values.get("rate_hz"):
        told["rate"] = _format_factor(values["rate_hz"], language)
    if values.get("date_order"):
        told["date_order"] = words.get(values["date_order"], values["date_order"])
    if values.get("pose_held"):
        told["pose_held"] = words[values["pose_held"]]
    return " · ".join(f"{words[name]}{words['colon']} {text}" for name, text in told.items())


def _format_vector(values: Mapping[str, Any], name: str, language: Language) -> str:
    factor = values.get(f"{name}_factor")
    unit = f" (× {_format_factor(factor, language)})" if factor else _format_unit(values, name)
    return _format_places(values.get(name)) + unit


def _format_unit(values: Mapping[str, Any], name: str) -> str:
    unit = values.get(f"{name}_unit")
    return f" ({unit})" if unit else ""


def _format_places(places: Sequence[str | int] | None) -> str:
    return ", ".join(clean_text(str(place)) for place in places or ())


def _format_factor(value: float, language: Language) -> str:
    decimals = len(f"{value:.6g}".partition(".")[2])
    return format_number(value, decimals, language)
