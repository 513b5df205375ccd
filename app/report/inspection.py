"""The output of `acromion inspect` as lines for people; its JSON holds every figure too."""

import re
from collections.abc import Iterable, Mapping
from typing import Any

from app.report.words.messages import describe_flag, format_facts
from app.report.words.numbers import format_exact, format_long_duration, format_number
from app.report.words.subject import clean_text
from app.report.words.wording import Language, Words, fill, find_device_name, load_wording
from fusion.caveats import Caveat
from fusion.recording import QualityFlag

_MOST_LINES = 10
_CORRECTION = Caveat.UNITS
_TOLD_ABOVE = frozenset({"jitter_us", "time_exponent", "left_gyr_factor"})
"""Facts that the reader found and another line gives already."""
_NUMBER = re.compile(r"-?\d+(\.\d+)?")
_NUMBERS = frozenset(
    {"samples", "records", "missing_seconds", "nominal_rate_hz", "rate_hz", "t_pose_elevation_deg"}
)


def describe_inspection(facts: Mapping[str, Any], language: Language) -> str:
    """Write the facts as lines for people."""
    words = load_wording(language, "run")["inspection"]
    rows = [
        (words["device"], find_device_name(load_wording(language), facts["device"])),
        (words["start"], facts["start"] or words["no_clock"]),
        (words["rate"], f"{format_number(facts['rate_hz'], 3, language)} Hz"),
        (words["recorded"], format_long_duration(facts["recorded_s"])),
        (words["segments"], format_exact(facts["segments"], language)),
        (words["jitter"], _format_number(facts["jitter_us"], "µs", words, language)),
        (words["rest"], _format_number(facts["sanity"]["rest_g"], "g", words, language)),
        (words["handedness"], _format_number(facts["sanity"]["handedness"], "", words, language)),
        (words["axes"], facts["sanity"]["axes"] or words["unseen"]),
        (words["gyro_scale"], _format_scale(facts["sanity"], words, language)),
        (words["corrections"], _format_corrections(facts["warnings"], words, language)),
        *_format_understood(facts["understood"], words, language),
        (
            words["gaps"],
            _join((_format_gap(gap, words, language) for gap in facts["gaps"]), words, facts["gap_count"]),
        ),
        (words["warnings"], _join((_format_warning(w, language) for w in facts["warnings"]), words)),
        (
            words["proposals"],
            _join((_format_proposal(p, words, language) for p in facts["calibration_proposals"]), words),
        ),
        (
            words["nonwear"],
            _join((_format_gap(p, words, language) for p in facts["nonwear_proposals"]), words),
        ),
    ]
    width = max(len(name) for name, _ in rows)
    return "\n".join(f"{name:<{width}}  {value}" for name, value in rows)


def _format_understood(
    understood: Mapping[str, Any], words: Words, language: Language
) -> Iterable[tuple[str, str]]:
    """Give what the reader took the file for, in the words and numbers of the language."""
    for name, value in understood.items():
        if value and name not in _TOLD_ABOVE:
            told = words["term"].get(name, {}).get(value) or clean_text(str(value))
            if name in _NUMBERS and _NUMBER.fullmatch(told):
                told = format_exact(float(told), language)
            yield f"  {words['understood'].get(name, name)}", told


def _format_corrections(warnings: Iterable[Mapping[str, Any]], words: Words, language: Language) -> str:
    """Write each axis, sign, order, unit and scale that was wrong or not stated, and was put right."""
    found = (warning["facts"] for warning in warnings if warning["code"] == _CORRECTION)
    return _join((fill(words["correction"], format_facts(facts, language)) for facts in found), words)


def _format_scale(sanity: Mapping[str, Any], words: Words, language: Language) -> str:
    if sanity["gyro_scale"] is None:
        return str(words["unseen"])
    scale, margin = (format_number(sanity[name], 3, language) for name in ("gyro_scale", "gyro_scale_margin"))
    return f"{scale} ± {margin}"


def _format_number(value: float | None, unit: str, words: Words, language: Language) -> str:
    return str(words["unseen"]) if value is None else f"{format_number(value, 3, language)} {unit}".rstrip()


def _join(lines: Iterable[str], words: Words, count: int = 0) -> str:
    """Write the first ten; ``count`` tells how many there are where not all are given."""
    every = list(lines)
    shown = every[:_MOST_LINES]
    if max(len(every), count) > len(shown):
        shown.append(fill(words["more"], {"n": str(max(len(every), count) - len(shown))}))
    return "; ".join(shown) or str(words["none"])


def _format_gap(gap: Mapping[str, float], words: Words, language: Language) -> str:
    facts = {
        "length": format_exact(gap["length_s"], language),
        "start": format_exact(gap["start_s"], language),
    }
    return fill(words["gap"], facts)


def _format_warning(warning: Mapping[str, Any], language: Language) -> str:
    flag = QualityFlag(warning["code"], warning["count"], facts=warning.get("facts", {}))
    return f"{flag.code} {describe_flag(flag, language).title} ({format_exact(flag.count, language)})"


def _format_proposal(proposal: Mapping[str, Any], words: Words, language: Language) -> str:
    facts = {
        "start": format_number(proposal["start_s"], 1, language),
        "end": format_number(proposal["start_s"] + proposal["duration_s"], 1, language),
        "score": format_number(proposal["score"], 2, language),
        "again": words["again"] if proposal["kind"] == "repeat" else "",
    }
    return fill(words["proposal"], facts)
