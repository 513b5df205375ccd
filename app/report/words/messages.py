"""Refusals, caveats and named columns in words."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from acromion.app.errors import InternalError
from acromion.app.report.words.numbers import format_duration, format_exact, format_number
from acromion.app.report.words.wording import MAX_TEXT, Language, Words, clean_text, fill, load_wording
from acromion.fusion.errors import Fact, split_facts

if TYPE_CHECKING:
    from acromion.fusion.recording import QualityFlag

UNKNOWN_PROBLEM = InternalError.code


@dataclass(frozen=True, slots=True)
class Problem:
    """The words of a refusal: a title, the detail, the fix, and the place."""

    title: str
    detail: str
    fix: str
    where: str | None


@dataclass(frozen=True, slots=True)
class CaveatWords:
    """A line of the data-quality box: a short name and its meaning for the figures."""

    title: str
    detail: str


def describe_problem(code: str, facts: Mapping[str, Fact], language: Language) -> Problem:
    """Return the words of a refusal. A code without words (from a newer server) reads as an internal error.

    Without facts the words are general.
    """
    words = load_wording(language)
    entry = words["problem"].get(code) or words["problem"][UNKNOWN_PROBLEM]
    first, *others = (
        {name: value for name, value in row.items() if name != "line" or value} for row in split_facts(facts)
    )  # line 0: the row is from no file
    shown = format_facts(first, language)
    others = [row | ({"cure": ""} if row.get("cure") == first.get("cure") else {}) for row in others]
    rows = (fill(entry["another"], format_facts(row, language)) for row in others)
    more = fill(entry.get("more", ""), shown)
    places = [fill(text, shown) for name, text in words["where"].items() if shown.get(name)]
    return Problem(
        title=fill(entry["title"], shown),
        detail=" ".join([fill(_choose_detail(entry, facts), shown), *rows, more]).strip(),
        fix=fill(entry["fix"], shown),
        where=", ".join(places) or None,
    )


def describe_flag(flag: "QualityFlag", language: Language) -> CaveatWords:
    """Return the words of a caveat; without words, as for a reader plug-in, return its code."""
    entry = load_wording(language)["flag"].get(flag.code)
    if entry is None:
        return CaveatWords(flag.code, "")
    shown = format_facts(flag.facts, language)
    if flag.seconds:
        shown["lasted"] = format_duration(flag.seconds, language)
    return CaveatWords(fill(entry["title"], shown), fill(_choose_detail(entry, shown), shown))


def _choose_detail(entry: Words, facts: Mapping[str, Fact]) -> str:
    """Return the sentence for this case, or the general one without facts."""
    return str(entry["detail"] if facts else entry.get("general", entry["detail"]))


def format_facts(facts: Mapping[str, Fact], language: Language) -> dict[str, str]:
    """Format facts for a sentence: numbers by the language, fixed terms of the code by its words."""
    words, shown = load_wording(language), {}
    for name, value in facts.items():
        if isinstance(value, str):
            terms = words["reason"] if name == "left_out" else words["fact"].get(name, {})
            most = 2 * MAX_TEXT if name == "allowed" else MAX_TEXT  # our list of every option
            shown[name] = str(terms.get(value) or clean_text(value, most))
        else:
            decimals = 2 if abs(value) >= 0.1 else 4
            shown[name] = format_exact(value if isinstance(value, int) else round(value, decimals), language)
    return shown


def find_flag_codes() -> tuple[str, ...]:
    """Return the code of every caveat that has words."""
    return tuple(sorted(load_wording("en")["flag"]))


# Columns named by a person.

VECTORS = ("acceleration", "angular_rate")


def format_columns(profile: str, language: Language) -> str:
    """Format a column profile: "Acceleration: p, q, r (mg) · Angular rate (gyroscope): 5, 6, 7 · Time: k"."""
    values, words = json.loads(profile), load_wording(language, "columns")
    shown = {}
    for name in filter(values.get, VECTORS):
        factor = values.get(f"{name}_factor")
        unit = f" (× {_format_factor(factor, language)})" if factor else _format_unit(values, name)
        shown[name] = _format_places(values.get(name)) + unit
    if values.get("sensor"):
        shown["sensor"] = clean_text(values["sensor"])
        shown |= {name: str(values[f"{name}_unit"]) for name in VECTORS if values.get(f"{name}_unit")}
    if values.get("time") is not None:
        shown["time"] = _format_places([values["time"]]) + _format_unit(values, "time")
    if values.get("rate_hz"):
        shown["rate"] = _format_factor(values["rate_hz"], language)
    if values.get("date_order"):
        shown["date_order"] = words.get(values["date_order"], values["date_order"])
    if values.get("pose_held"):
        shown["pose_held"] = words[values["pose_held"]]
    return " · ".join(f"{words[name]}{words['colon']} {text}" for name, text in shown.items())


def _format_unit(values: Mapping[str, Any], name: str) -> str:
    unit = values.get(f"{name}_unit")
    return f" ({unit})" if unit else ""


def _format_places(places: Sequence[str | int] | None) -> str:
    return ", ".join(clean_text(str(place)) for place in places or ())


def _format_factor(value: float, language: Language) -> str:
    decimals = len(f"{value:.6g}".partition(".")[2])
    return format_number(value, decimals, language)
