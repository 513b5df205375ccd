"""Publications cited by the report and a paper, with their DOIs, and the methods text of a run.

They are context for a reader: no figure about a person is derived from them.
"""

import tomllib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from acromion.app.report.words.numbers import HOUR_S, format_number, format_rate
from acromion.app.report.words.wording import Language, Words, fill, load_wording
from acromion.app.request import MIN_HOURS
from acromion.fusion.conventions import CONFIRMED, UNHELD
from acromion.fusion.devices import find_device_name as find_known_name


@dataclass(frozen=True, slots=True)
class Publication:
    """A publication as cited in the text and in full; ``doi`` is empty if unknown."""

    cited: str
    full: str
    doi: str = ""


_LISTED = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
BIBLIOGRAPHY = tuple(Publication(cited, **fields) for cited, fields in _LISTED.items())


def format_bibliography() -> tuple[str, ...]:
    """Return every publication in full, ordered by first author."""
    return tuple(f"{one.full} doi:{one.doi}" if one.doi else one.full for one in BIBLIOGRAPHY)


# The methods text of a run.

Results = Mapping[str, Any]


def write_methods(
    every: Sequence[Results], failed: int, language: Language, min_hours: float = MIN_HOURS
) -> bytes:
    """Return the methods paragraph as Markdown; ``every`` contains the results.json of each recording.

    ``min_hours``: the least analysed time of a day that counts.
    """
    words = load_wording(language, "run")["methods"]
    trunks = sum(one["recording"]["side"] == "trunk" for one in every)
    every = [one for one in every if one["recording"]["side"] != "trunk"]
    if not every:
        return f"# {words['title']}\n\n{words['nothing']}\n".encode()
    axes = _count(every, "calibration", "axis")
    posed = [one for one in every if one["calibration"] and one["calibration"]["state"] not in UNHELD]
    assumed = [one for one in posed if one["calibration"]["state"] not in CONFIRMED]
    confirmed = (one for one in posed if one["calibration"]["state"] in CONFIRMED)
    poses = _count(confirmed, "calibration", "pose")
    unposed = [one for one in every if one["calibration"] and one["calibration"]["state"] == "none"]
    parts = ["sensor", "recordings", "fusion"]
    parts += ["pose"] if poses else []
    parts += ["assumed"] if assumed else []
    parts += ["unposed"] if unposed else []
    parts += ["axis"] if axes else []
    parts += ["elevation", "figures", "days", "interval"]
    parts += ["npose"] if any(one["calibration"]["pose"] == "n-pose" for one in posed) else []
    facts = _describe_run(every, words, language) | {
        "failed": str(failed) if failed else "",
        "n": str(axes.total()),
        "trunks": str(trunks),
        "min_hours": f"{min_hours:g}" if language == "en" else f"{min_hours:g}".replace(".", ","),
        "unposed": str(len(unposed)),
        "poses": _name_poses(poses, words),
        "assumed": _name_poses(_count(assumed, "calibration", "pose"), words),
    }
    parts += ["limits_with_trunk" if trunks else "limits", "settings"]
    text = " ".join(fill(words[name], facts) for name in parts)
    sources = "\n".join(f"- {source}" for source in format_bibliography())
    cited = f"## {words['bibliography']}\n\n{sources}\n"
    return f"# {words['title']}\n\n{text}\n\n> {words['note']}\n\n{cited}".encode()


def _describe_run(every: Sequence[Results], words: Words, language: Language) -> dict[str, str]:
    devices = []
    for device in _count(every, "recording", "device"):
        known = fill(words["device"]["known"], {"name": find_known_name(device) or device})
        devices.append(str(words["device"].get(device) or known))
    # Each method and its version once; files with angles have none, which comes last.
    found = (results["method"] for results in every)
    named = {(m["name"], str(m["version"])) if m else ("none", "") for m in found}
    methods = sorted(named, key=lambda method: (method[0] == "none", method))
    rates_hz = [results["recording"]["rate_hz"] for results in every]
    rates = dict.fromkeys(format_rate(rate_hz, language) for rate_hz in (min(rates_hz), max(rates_hz)))
    amounts = {"hours": "analysed_s", "missing": "missing_s", "excluded": "excluded_s"}
    return {
        "devices": "; ".join(devices),
        "rates": f"{'–'.join(rates)} Hz",
        "software": "; ".join(
            dict.fromkeys(fill(words["software"], results["software"]) for results in every)
        ),
        "analysed": str(len(every)),
        "method": "; ".join(fill(words["fused_by"][name], {"version": version}) for name, version in methods),
        **{
            name: format_number(sum(results["time"][key] for results in every) / HOUR_S, 1, language)
            for name, key in amounts.items()
        },
    }


def _name_poses(poses: Counter[str], words: Words) -> str:
    return "; ".join(fill(words["pose_named"][pose], {"n": str(number)}) for pose, number in poses.items())


def _count(every: Iterable[Results], part: str, name: str) -> Counter[str]:
    return Counter(results[part][name] for results in every if results[part] and results[part][name])
