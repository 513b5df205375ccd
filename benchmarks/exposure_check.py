"""Write ``docs/reference/exposure-check.md``: figures beside their formulas, shifts beside their truth.

python -m benchmarks.exposure_check oracles              write that part again (CI checks that it is current)
python -m benchmarks.exposure_check truth gt9x 10        ten seeds of a device: minutes for each
python -m benchmarks.exposure_check cost                 processor time and memory for 1 to 24 h

Each part is between two comments of the page; only that part is replaced.
"""

import re
import sys
from collections.abc import Iterator
from pathlib import Path

from benchmarks.exposure import SHIFTS, measure_apart
from benchmarks.exposure_oracles import list_oracles, tell_oracles
from benchmarks.exposure_truth import DEVICES, SEEDS, tell_device

DOCUMENT = Path(__file__).parents[1] / "docs" / "reference" / "exposure-check.md"


def find_part(document: str, name: str) -> str:
    """Return the text between the comments of a part."""
    found = re.search(_make_pattern(name), document, re.DOTALL)
    return found[1] if found else ""


def replace_part(document: str, name: str, text: str) -> str:
    """Return the document with one part replaced."""
    return re.sub(
        _make_pattern(name),
        lambda _: f"<!-- {name} -->\n{text}\n<!-- end of {name} -->",
        document,
        flags=re.DOTALL,
    )


def _make_pattern(name: str) -> str:
    return rf"<!-- {name} -->\n(.*?)\n?<!-- end of {name} -->"


def tell_cost() -> Iterator[str]:
    """Measure each length of shift in a separate process."""
    yield "| shift | rows | CPU time, median of 5 | for each million rows | memory above the angles |"
    yield "|---|---:|---:|---:|---:|"
    for hours, rate_hz in SHIFTS:
        cost = measure_apart(hours, rate_hz)
        each_s = cost.cpu_s / cost.rows * 1e6
        yield (
            f"| {hours:g} h at {rate_hz:g} Hz | {cost.rows:,} | {cost.cpu_s:.3f} s"
            f" | {each_s:.4f} s | {cost.memory_mib:.0f} MiB |"
        )


def tell_part(asked: list[str]) -> tuple[str, Iterator[str]]:
    """Return the name and the lines of the part that was asked for."""
    if asked == ["oracles"]:
        return "oracles", tell_oracles(list_oracles())
    if asked == ["cost"]:
        return "cost", tell_cost()
    for device in DEVICES:
        if asked[:2] == ["truth", device]:
            seeds = int(asked[2]) if asked[2:] else SEEDS
            return f"truth {device}", tell_device(device, seeds)
    raise SystemExit(__doc__)


def main() -> None:
    name, lines = tell_part(sys.argv[1:])
    text = "\n".join(lines)
    DOCUMENT.write_text(replace_part(DOCUMENT.read_text("utf-8"), name, text), "utf-8")


if __name__ == "__main__":
    main()
