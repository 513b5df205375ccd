"""Section (e): the cost of eight hours, every estimator in turn in one process; and the memory."""

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import numpy as np
import vqf

from acromion.fusion.elevation import estimate_elevation
from acromion.fusion.pose.calibrate import calibrate
from acromion.fusion.recording import MICROSECONDS, Recording, Segment
from acromion.fusion.simulation import simulate_shift
from benchmarks.validation.document import Goal, Section, draw_table, judge
from benchmarks.validation.peers import run_imufusion, run_madgwick, run_mahony, to_vqf
from benchmarks.validation.worn import wear

ROUNDS = 3
HOURS = 8.0
RATES_HZ = (100.0, 500.0)
LIMITS_S = {100.0: 0.25, 500.0: 1.0}
PIECE_S = 30.0
OURS = "smoothed"
COLD = "benchmarks.validation.cold"

PROSE = f"""\
Eight hours of a simulated recording (a quarter of an hour, repeated), float32 as from the readers. `smoothed`
is the whole elevation path: still moments, bias, accelerometer, calibration, fusion, angle. The peers get
arrays in their own units and return quaternions. All estimators run in turn, {ROUNDS} rounds after a warm-up,
in one process and one thread. The figure is the median of the processor time, with the wall time in the next
column. imufusion (its Python loop) and the filters of `ahrs` run over {PIECE_S:.0f} s only, scaled to eight
hours."""


@dataclass(frozen=True, slots=True)
class Cost:
    """Processor and wall time of one run, scaled to eight hours."""

    cpu_s: float
    wall_s: float


def compare_speed() -> Section:
    paragraphs, goals = [PROSE], list[Goal]()
    for rate_hz in RATES_HZ:
        costs = measure_rate(rate_hz)
        paragraphs += [f"### 8 h at {rate_hz:.0f} Hz", _draw_costs(costs)]
        what = f"8 h at {rate_hz:.0f} Hz, `smoothed`, one core, warm"
        goals.append(judge(what, costs[OURS].cpu_s, LIMITS_S[rate_hz], "s", 2))
    paragraphs += ["### Memory and first call, each in a separate process", *_measure_cold(goals)]
    return Section("Speed", (), tuple(goals), tuple(paragraphs))


def repeat_quarter(rate_hz: float, hours: float = HOURS) -> Recording:
    """Return many hours from a simulated quarter of an hour."""
    quarter = wear(simulate_shift("gt9x" if rate_hz < 300.0 else "lsm9ds1", 0.25, 1, rate_hz)).recording
    piece = quarter.segments[0]
    rows = round(hours * 3600 * rate_hz)
    copies = rows // len(piece) + 1
    acc_g, gyr_dps = (np.tile(table, (copies, 1))[:rows] for table in (piece.acc_g, piece.gyr_dps))
    segment = Segment(0, rate_hz, acc_g, gyr_dps)
    return Recording(quarter.device, "0" * 64, None, None, round(hours * 3600 * MICROSECONDS), (segment,))


def measure_rate(rate_hz: float) -> Mapping[str, Cost]:
    runs = _prepare(repeat_quarter(rate_hz), rate_hz)
    costs: dict[str, list[Cost]] = {name: [] for name in runs}
    for number in range(ROUNDS + 1):
        for name, (run, scale) in runs.items():
            cost = _time(run, scale)
            if number > 0:
                costs[name].append(cost)
    return {
        name: Cost(median(c.cpu_s for c in found), median(c.wall_s for c in found))
        for name, found in costs.items()
    }


def _prepare(recording: Recording, rate_hz: float) -> dict[str, tuple[Callable[[], object], float]]:
    """Return each estimator ready to run, and the ratio of eight hours to its input."""
    segment = recording.segments[0]
    gyr, acc = to_vqf(segment.acc_g.astype(np.float64), segment.gyr_dps.astype(np.float64))
    rows = slice(0, round(PIECE_S * rate_hz))
    piece = (segment.acc_g[rows].astype(np.float64), segment.gyr_dps[rows].astype(np.float64), rate_hz)
    scale = HOURS * 3600.0 / PIECE_S
    return {
        OURS: (lambda: estimate_elevation(calibrate(recording)), 1.0),
        "published": (lambda: estimate_elevation(calibrate(recording), "published"), 1.0),
        "live": (lambda: estimate_elevation(calibrate(recording), "live"), 1.0),
        "offlineVQF": (lambda: vqf.offlineVQF(gyr, acc, None, 1.0 / rate_hz), 1.0),
        "VQF": (lambda: vqf.VQF(1.0 / rate_hz).updateBatch(gyr, acc), 1.0),
        "imufusion": (lambda: run_imufusion(*piece), scale),
        "Madgwick": (lambda: run_madgwick(*piece), scale),
        "Mahony": (lambda: run_mahony(*piece), scale),
    }


def _time(run: Callable[[], object], scale: float) -> Cost:
    wall, cpu = time.perf_counter(), time.process_time()
    run()
    return Cost((time.process_time() - cpu) * scale, (time.perf_counter() - wall) * scale)


def _draw_costs(costs: Mapping[str, Cost]) -> str:
    rows = [
        [name, f"{cost.cpu_s:.2f}", f"{cost.wall_s:.2f}", f"{cost.cpu_s / costs[OURS].cpu_s:.1f}"]
        for name, cost in costs.items()
    ]
    return draw_table(("estimator", "processor s", "wall s", "times `smoothed`"), rows)


def _measure_cold(goals: list[Goal]) -> list[str]:
    """Return peak memory beyond the input, and the time of the first call with and without compiled code."""
    rows = []
    for rate_hz in RATES_HZ:
        what = f"peak above the input, 8 h at {rate_hz:.0f} Hz"
        (above_mib,) = _ask("memory", str(rate_hz))
        rows.append([what, f"{above_mib:.0f} MiB, including the result"])
        goals.append(judge(what, above_mib, 200.0, "MiB", 0))
    with tempfile.TemporaryDirectory() as cache:
        for what, limit_s in (("first call after installation", 2.0), ("first call later", 0.3)):
            call_s, whole_s = _ask("first", cache=Path(cache))
            rows.append([f"{what}, of processor time", f"{call_s:.2f} s, with all imports {whole_s:.2f} s"])
            goals.append(judge(f"{what}, `estimate_vertical`", call_s, limit_s, "s", 2))
    return [draw_table(("what", "figure"), rows)]


def _ask(*question: str, cache: Path | None = None) -> list[float]:
    """Measure a value in a new process, optionally with a separate cache of compiled code."""
    environment = os.environ | ({"NUMBA_CACHE_DIR": str(cache)} if cache else {})
    command = [sys.executable, "-m", COLD, *question]
    answer = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return [float(number) for number in answer.stdout.split()]
