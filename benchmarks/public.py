"""The public benchmark: ``python -m benchmarks.public [-o DIR] [--data DIR] [--hours 8] [--only PART...]``.

Writes one page, ``benchmark.html``, and the same numbers as ``benchmark.json``: accuracy on BROAD, on
recorded motion and on the ten tasks; speed and memory compared with VQF, offlineVQF, ahrs, imufusion, pandas
and polars; the machine and every version. Parts that cannot be measured name their missing requirement. The
measurements come from ``benchmarks.validation`` and ``benchmarks.readers``. Needs the extras `dev` and
`bench`.
"""

import argparse
import json
import os
import platform
import statistics
import tempfile
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np
import psutil
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from acromion.app.version import software_version, source_revision
from acromion.fusion.simulation import simulate_shift, write_shift

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT.parent / "shared" / "data"
PACKAGES = ("numpy", "scipy", "numba", "vqf", "ahrs", "imufusion", "pandas", "polars", "pyarrow")
OURS = frozenset({"smoothed", "live", "acromion", "acromion with SHA-256"})
READERS = ("acromion", "acromion with SHA-256", "pandas C", "polars", "pyarrow")
ROUNDS = 3


@dataclass(frozen=True, slots=True)
class Bar:
    """One figure of one program."""

    name: str
    value: float
    note: str = ""

    @property
    def is_ours(self) -> bool:
        """Whether the program is ours."""
        return self.name in OURS


@dataclass(frozen=True, slots=True)
class Chart:
    """Figures to compare: less is better in all of them."""

    title: str
    unit: str
    bars: tuple[Bar, ...]

    @property
    def longest(self) -> float:
        """The figure that fills the width."""
        return max((bar.value for bar in self.bars), default=1.0)


@dataclass(frozen=True, slots=True)
class Part:
    """A part of the page; ``missing`` names its missing requirement."""

    key: str
    title: str
    text: str
    charts: tuple[Chart, ...] = ()
    missing: str = ""


@dataclass(frozen=True, slots=True)
class Page:
    """The content of the page."""

    made_at: str
    software: str
    machine: Mapping[str, str]
    versions: Mapping[str, str]
    parts: tuple[Part, ...] = field(default=())


def measure_broad(data: Path) -> Part:
    """Score the vertical against optical motion capture."""
    part = Part("broad", "Against optical motion capture (BROAD)", _BROAD)
    folder = data / "broad"
    if not list(folder.glob("*.npz")):
        return _missing(
            part, "the BROAD recordings (Laidig et al. 2021) as *.npz in broad/ of the data folder"
        )
    # needs the extra `bench`
    from benchmarks.validation.peers import run_madgwick, run_mahony  # noqa: PLC0415
    from benchmarks.validation.recorded import load_both, score_all, score_untouched  # noqa: PLC0415

    filters = {"ahrs Madgwick": run_madgwick, "ahrs Mahony": run_mahony}

    charts = []
    for rate in ("286 Hz", "100 Hz"):
        scores = {**score_untouched(folder, rate), **score_all(load_both(folder)[rate], filters)}
        bars = (Bar(name, score.aligned_deg, f"raw {score.raw_deg:.2f}") for name, score in scores.items())
        charts.append(Chart(f"Error of the vertical at {rate}", "deg", _sort(bars)))
    return _fill(part, charts)


def measure_recorded(data: Path, seeds: int) -> Part:
    """Score the angle on days assembled from recorded human motion."""
    part = Part("recorded", "On recorded human motion", _RECORDED.format(n=seeds))
    from benchmarks.validation.stated import KINDS, find_missing, run  # noqa: PLC0415
    from benchmarks.validation.worn import NAMES  # noqa: PLC0415

    if find_missing(data):
        return _missing(
            part, "the motion capture of people in real_motion/ and skin_motion/ of the data folder"
        )
    scores = [one for one in run(("pose",), range(seeds), data=data) if not one.refused]
    charts = []
    for kind, title in KINDS.items():
        errors = {
            name: [one.rmse_deg for one in scores if (one.kind, one.device) == (kind, device)]
            for device, name in NAMES.items()
        }
        bars = (
            Bar(name, float(np.median(some)), f"{len(some)} days, worst {max(some):.2f}")
            for name, some in errors.items()
            if some
        )
        charts.append(Chart(f"Error of the elevation, {title}", "deg", tuple(bars)))
    return _fill(part, charts)


def measure_tasks() -> Part:
    """Score the angle on the ten tasks of a published study, simulated."""
    from benchmarks.validation.tasks import play_sessions, summarise  # noqa: PLC0415
    from tests.simulated_tasks import TITLES  # noqa: PLC0415

    results = summarise(play_sessions(seated=True))
    charts = []
    for number, title in TITLES.items():
        bars = [
            Bar(method, figures.rmse_deg, device)
            for (device, method, task), figures in results.items()
            if task == number
        ]
        charts.append(Chart(f"{number}. {title}", "deg", _sort(bars)))
    return _fill(Part("tasks", "Ten arm tasks", _TASKS), charts)


def measure_fusion() -> Part:
    """Time the estimators over eight hours."""
    from benchmarks.validation.speed import measure_rate  # noqa: PLC0415

    costs = measure_rate(100.0)
    bars = (Bar(name, cost.cpu_s, f"wall {cost.wall_s:.2f} s") for name, cost in costs.items())
    return _fill(
        Part("fusion", "Speed of the fusion", _FUSION),
        [Chart("Processor time, 8 h at 100 Hz", "s", _sort(bars))],
    )


def measure_reading(hours: float) -> Part:
    """Time the readers of a device's CSV, and measure their memory."""
    from benchmarks.readers import measure  # noqa: PLC0415

    with tempfile.TemporaryDirectory() as folder:
        made = write_shift(Path(folder), simulate_shift("gt9x", hours, seed=1))
        table = next(path for path in made if path.suffix == ".csv")
        rounds = {name: [measure(name, table) for _ in range(ROUNDS)] for name in READERS}
    spent = [
        Bar(name, statistics.median(one["seconds"] for one in found), f"{found[0]['rows']:.0f} rows")
        for name, found in rounds.items()
    ]
    peaks = [Bar(name, max(one["peak_mib"] for one in found)) for name, found in rounds.items()]
    charts = (
        Chart("Processor time", "s", _sort(spent)),
        Chart("Memory above the start", "MiB", _sort(peaks)),
    )
    return _fill(Part("reading", f"Reading {hours:g} h of a GT9X's CSV, one core", _READING), charts)


def _sort(bars: Iterable[Bar]) -> tuple[Bar, ...]:
    return tuple(sorted(bars, key=lambda bar: bar.value))


def _fill(part: Part, charts: Iterable[Chart]) -> Part:
    return Part(part.key, part.title, part.text, tuple(charts))


def _missing(part: Part, what: str) -> Part:
    return Part(part.key, part.title, part.text, missing=what)


_BROAD = """\
Seventeen trials of a hand-held sensor with optical motion capture. The figure is the root mean
square angle between the estimated and the optical vertical in motion, at the best single lag
for each estimator. None uses a magnetometer."""
_RECORDED = """\
{n} days of eight hours of each kind for each device, assembled from people's recorded arm
motion, with a simulated sensor and its errors. The figure is the root mean square error,
median of the days. The pose is held in the first 10 s but not stated. The data includes no
sensor worn by a person with a reference for the upper arm."""
_TASKS = """\
Five virtual people do the ten tasks of a published study, each five times; rigid arm, exact
truth, simulated sensor errors. published is the algorithm of that study."""
_FUSION = """\
A simulated recording in memory. smoothed, published and live compute everything up to the
angle: still moments, calibration, fusion. The peers get arrays in their units and return
quaternions. imufusion runs in its Python loop; it and ahrs (Madgwick, Mahony) run over 30 s,
scaled."""
_READING = """\
Each reader in a separate process, one thread, after a warm-up: the columns of acceleration and
angular rate as numbers. acromion also detects the columns and the time."""


def describe_machine() -> dict[str, str]:
    """Return the properties of the machine that affect speed."""
    cpu = next(
        (
            line.partition(":")[2].strip()
            for line in Path("/proc/cpuinfo").read_text("utf-8").splitlines()
            if line.startswith("model name")
        ),
        platform.processor(),
    )
    return {
        "processor": cpu,
        "cores": str(len(os.sched_getaffinity(0))),
        "memory": f"{psutil.virtual_memory().total / 2**30:.0f} GiB",
        "system": f"{platform.system()} {platform.release()}",
        "load before": f"{os.getloadavg()[0]:.1f}",
    }


def find_versions() -> dict[str, str]:
    """Return the version of every compared program, "absent" if it is not installed."""
    return {"Python": platform.python_version()} | {name: _find_version(name) for name in PACKAGES}


def _find_version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "absent"


def measure(name: str, title: str, run: Callable[[], Part]) -> Part:
    """Measure one part; if a package is missing, name it, and continue with the other parts."""
    print(f"{name} ...", flush=True)
    try:
        return run()
    except ModuleNotFoundError as absent:
        return Part(name, title, "", missing=f'the package {absent.name}: pip install ".[dev,bench]"')


def render(page: Page) -> str:
    """Return the page as one self-contained HTML file."""
    folder = FileSystemLoader(Path(__file__).parent)
    environment = Environment(loader=folder, autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    return environment.get_template("public.html.j2").render(page=page)


def main() -> None:
    """Measure, and write both files."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.public")
    parser.add_argument("-o", "--output", type=Path, default=Path("benchmark"))
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--hours", type=float, default=8.0)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--only", nargs="+", choices=("broad", "recorded", "tasks", "fusion", "reading"))
    asked = parser.parse_args()
    runs: dict[str, tuple[str, Callable[[], Part]]] = {
        "broad": ("Against optical motion capture (BROAD)", partial(measure_broad, asked.data)),
        "recorded": ("On recorded human motion", partial(measure_recorded, asked.data, asked.seeds)),
        "tasks": ("Ten arm tasks", measure_tasks),
        "fusion": ("Speed of the fusion", measure_fusion),
        "reading": ("Reading a device's CSV", partial(measure_reading, asked.hours)),
    }
    machine, versions = describe_machine(), find_versions()
    parts = tuple(measure(name, *runs[name]) for name in asked.only or runs)
    own = f"acromion {software_version()}, revision {source_revision()}"
    page = Page(datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"), own, machine, versions, parts)
    asked.output.mkdir(parents=True, exist_ok=True)
    (asked.output / "benchmark.html").write_text(render(page), "utf-8")
    (asked.output / "benchmark.json").write_text(json.dumps(asdict(page), indent=1) + "\n", "utf-8")
    for part in parts:
        if part.missing:
            print(f"{part.title}: not measured; it needs {part.missing}")
    print(f"written: {asked.output / 'benchmark.html'}, {asked.output / 'benchmark.json'}")


if __name__ == "__main__":
    main()
