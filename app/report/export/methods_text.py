"""The methods of a run as a text to paste into a paper, from what was really done."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from app.report.bibliography import format_bibliography
from app.report.words.numbers import HOUR_S, format_number, format_rate
from app.report.words.wording import Language, Words, fill, load_wording
from app.version import software_revision, software_version
from fusion.devices import find_device_name as find_known_name

Results = Mapping[str, Any]


def write_methods(every: Sequence[Results], failed: int, language: Language) -> bytes:
    """Write the paragraph as Markdown; ``every`` holds the results.json of each recording analysed."""
    words = load_wording(language, "run")["methods"]
    if not every:
        return f"# {words['title']}\n\n{words['nothing']}\n".encode()
    facts = _describe_run(every, failed, words, language)
    told = ["sensor", "recordings", "fusion", "pose", "elevation", "figures", "interval"]
    if not _count(every, "calibration", "pose"):
        told.remove("pose")
    if _count(every, "calibration", "axis"):
        told.insert(told.index("elevation"), "axis")
    told += ["npose"] if "n-pose" in _count(every, "calibration", "pose") else []
    text = " ".join(fill(words[name], facts) for name in (*told, "limits", "settings"))
    sources = "\n".join(f"- {source}" for source in format_bibliography())
    cited = f"## {words['bibliography']}\n\n{sources}\n"
    return f"# {words['title']}\n\n{text}\n\n> {words['note']}\n\n{cited}".encode()


def _describe_run(every: Sequence[Results], failed: int, words: Words, language: Language) -> dict[str, str]:
    return {
        "devices": _join(_name_sensors(name, words) for name in _count(every, "recording", "device")),
        "rates": _format_rates(every, language),
        "version": software_version(),
        "revision": software_revision(),
        "analysed": str(len(every)),
        "failed": str(failed) if failed else "",
        "method": _join(_format_method(method, words) for method in _find_methods(every)),
        "n": str(_count(every, "calibration", "axis").total()),
        "poses": _join(
            fill(words["pose_named"][pose], {"n": str(number)})
            for pose, number in _count(every, "calibration", "pose").items()
        ),
        **{
            name: format_number(sum(results["time"][key] for results in every) / HOUR_S, 1, language)
            for name, key in (("hours", "analysed_s"), ("missing", "missing_s"), ("excluded", "excluded_s"))
        },
    }


def _count(every: Iterable[Results], part: str, name: str) -> Counter[str]:
    return Counter(results[part][name] for results in every if results[part] and results[part][name])


def _find_methods(every: Iterable[Results]) -> list[tuple[str, str]]:
    """Give each method and its version once; a file of ready angles has none, which stands last."""
    found = (results["method"] for results in every)
    named = {(m["name"], str(m["version"])) if m else ("none", "") for m in found}
    return sorted(named, key=lambda method: (method[0] == "none", method))


def _name_sensors(device: str, words: Words) -> str:
    named = words["device"]
    return str(named.get(device) or fill(named["known"], {"name": find_known_name(device) or device}))


def _format_method(method: tuple[str, str], words: Words) -> str:
    name, version = method
    return fill(words["fused_by"][name], {"version": version})


def _format_rates(every: Iterable[Results], language: Language) -> str:
    rates_hz = sorted({results["recording"]["rate_hz"] for results in every})
    ends = dict.fromkeys(format_rate(rate_hz, language) for rate_hz in (rates_hz[0], rates_hz[-1]))
    return f"{'–'.join(ends)} Hz"


def _join(parts: Iterable[str]) -> str:
    return "; ".join(parts)
