"""The output of `acromion inspect` as text lines; its JSON contains the same figures."""

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from acromion.app.report.words.messages import describe_flag, format_facts
from acromion.app.report.words.numbers import (
    format_exact,
    format_interval,
    format_long_duration,
    format_number,
)
from acromion.app.report.words.wording import (
    Language,
    Words,
    clean_text,
    fill,
    find_device_name,
    load_wording,
)
from acromion.fusion.caveats import Caveat
from acromion.fusion.clocks import find_time_zone
from acromion.fusion.recording import QualityFlag

_MOST_LINES = 10
_TOLD_ABOVE = frozenset({"jitter_us", "time_exponent", "left_gyr_factor"})
"""Facts of the reader that another line already shows."""
_NUMBER = re.compile(r"-?\d+(\.\d+)?")
_NUMBERS = frozenset(
    {"samples", "records", "missing_seconds", "nominal_rate_hz", "rate_hz", "t_pose_elevation_deg"}
)


def describe_inspection(facts: Mapping[str, Any], language: Language) -> str:
    """Format the facts as text lines."""
    words, sanity = load_wording(language, "run")["inspection"], facts["sanity"]
    scale = str(words["unseen"])
    if sanity["gyro_scale"] is not None:
        ends = (format_number(sanity[name], 3, language) for name in ("gyro_scale", "gyro_scale_margin"))
        scale = " ± ".join(ends)
    corrected = (warning["facts"] for warning in facts["warnings"] if warning["code"] == Caveat.UNITS)
    lists = {  # corrections: values that were wrong or not stated, and were corrected
        "corrections": [fill(words["correction"], format_facts(each, language)) for each in corrected],
        "gaps": [_format_stretch(gap["start_s"], gap["length_s"], words, language) for gap in facts["gaps"]],
        "warnings": [_format_warning(warning, language) for warning in facts["warnings"]],
        "proposals": [_format_proposal(each, words, language) for each in facts["calibration_proposals"]],
        "nonwear": [
            _format_stretch(each["start_s"], each["duration_s"], words, language)
            for each in facts["nonwear_proposals"]
        ],
        "shifts": [
            format_interval(each, language, find_time_zone(facts["time_zone"]))
            for each in facts["shift_proposals"]
        ],
    }
    shown = {
        name: _join(lines, words, facts["gap_count"] if name == "gaps" else 0)
        for name, lines in lists.items()
    }
    rows = [
        (words["device"], find_device_name(load_wording(language), facts["device"])),
        (words["start"], facts["start"] or words["no_clock"]),
        (words["rate"], f"{format_number(facts['rate_hz'], 3, language)} Hz"),
        (words["recorded"], format_long_duration(facts["recorded_s"])),
        (words["segments"], format_exact(facts["segments"], language)),
        (words["jitter"], _format_number(facts["jitter_us"], "µs", words, language)),
        (words["rest"], _format_number(sanity["rest_g"], "g", words, language)),
        (words["handedness"], _format_number(sanity["handedness"], "", words, language)),
        (words["axes"], sanity["axes"] or words["unseen"]),
        (words["gyro_scale"], scale),
        (words["corrections"], shown.pop("corrections")),
        *((f"  {name}", value) for name, value in describe_understood(facts["understood"], language)),
        *((words[name], text) for name, text in shown.items()),
    ]
    width = max(len(name) for name, _ in rows)
    return "\n".join(f"{name:<{width}}  {value}" for name, value in rows)


def describe_understood(understood: Mapping[str, Any], language: Language) -> Iterator[tuple[str, str]]:
    """Return the reader's interpretation of the file as names and values in the language."""
    words = load_wording(language, "run")["inspection"]
    for name, value in understood.items():
        if value and name not in _TOLD_ABOVE:
            shown = words["term"].get(name, {}).get(value) or clean_text(str(value))
            if name in _NUMBERS and _NUMBER.fullmatch(shown):
                shown = format_exact(float(shown), language)
            yield words["understood"].get(name, name), shown


def _format_number(value: float | None, unit: str, words: Words, language: Language) -> str:
    return str(words["unseen"]) if value is None else f"{format_number(value, 3, language)} {unit}".rstrip()


def _join(lines: Sequence[str], words: Words, count: int) -> str:
    """Join the first ten; ``count`` is the total if not all are given."""
    further = max(len(lines), count) - len(lines[:_MOST_LINES])
    more = [fill(words["more"], {"n": str(further)})] if further else []
    return "; ".join([*lines[:_MOST_LINES], *more]) or str(words["none"])


def _format_stretch(start_s: float, length_s: float, words: Words, language: Language) -> str:
    facts = {"start": format_exact(start_s, language), "length": format_exact(length_s, language)}
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
