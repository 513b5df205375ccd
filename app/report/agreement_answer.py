"""The answer of a comparison in a few lines of plain text."""

from collections.abc import Mapping
from math import isfinite
from typing import Any

from app.report.numbers import NONE, format_angle, format_duration, format_number
from app.report.wording import Language, fill, load_wording


def tell_agreement(validation: Mapping[str, Any], language: Language) -> bytes:
    """Write the sentences of :func:`list_sentences` as text."""
    return ("\n".join(list_sentences(validation, language)) + "\n").encode("utf-8")


def list_sentences(validation: Mapping[str, Any], language: Language) -> tuple[str, ...]:
    """Say how far the two agree, and how their clocks were aligned."""
    words = load_wording(language, "agreement")["sentence"]
    overall, alignment = validation["overall"], validation["alignment"]
    facts = {
        "rmse": format_angle(overall["rmse_deg"], language, 2),
        "absolute": format_angle(overall["mean_absolute_error_deg"], language, 2),
        "bias": format_angle(overall["bias_deg"], language, 2),
        "low": format_angle(overall["loa_low_deg"], language, 1),
        "high": format_angle(overall["loa_high_deg"], language, 1),
        "r": tell_r(overall["r"], language),
        "duration": format_duration(overall["duration_s"], language),
        "offset": format_number(alignment["offset_s"], 3, language),
        "drift": tell_drift(alignment["drift_ppm"], alignment["drift_margin_ppm"], language),
    }
    clocks = (
        words["clocks"] if alignment["drift_fitted"] or alignment["drift_given"] else words["clocks_no_drift"]
    )
    return tuple(fill(text, facts) for text in (words["error"], words["bias"], words["r"], clocks))


def tell_drift(drift_ppm: float, margin_ppm: float | None, language: Language) -> str:
    """Write a drift with its margin, to what that bears: whole from 1 ppm on; one set by hand has none."""
    if margin_ppm is None or not isfinite(margin_ppm):
        return format_number(drift_ppm, 1, language)
    decimals = 0 if margin_ppm >= 1.0 else 1
    drift, margin = (format_number(value, decimals, language) for value in (drift_ppm, margin_ppm))
    return f"{drift}\u00a0±\u00a0{margin}"


def tell_r(r: float | None, language: Language) -> str:
    """Write a correlation; where it is not given, NA as in the paper."""
    text = format_number(r, 3, language)
    return "NA" if text == NONE else text
