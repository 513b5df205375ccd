"""Measure the cost of all exposure figures with intervals: time and memory beyond the angles, for 1 to 24 h.

python -m benchmarks.exposure            the cost
python -m benchmarks.exposure --oracles  the expected and the actual value of each figure
python -m benchmarks.exposure --truth    figures of simulated shifts compared with those of their exact angle;
                                         a number sets how many seeds for each device
"""

import json
import resource
import subprocess
import sys
import time
from dataclasses import asdict, dataclass
from statistics import median

import numpy as np

from acromion.fusion.elevation import Elevation, ElevationSegment
from acromion.fusion.exposure.summary import summarise_exposure
from acromion.fusion.recording import Recording, Segment
from benchmarks.exposure_oracles import main as print_oracles
from benchmarks.exposure_truth import main as print_truth

SHIFTS = ((1, 100), (2, 100), (4, 100), (8, 100), (24, 100), (8, 500))
MEBIBYTE = 1024
BLOCK_ROWS = 20_000  # little compared with the measured memory
ROUNDS = 5
SIGMA_DEG = 3.0


def make_shift(rows: int, rate_hz: float) -> tuple[Elevation, Recording]:
    """Return a shift of swings with its vertical and its samples, built in blocks to limit memory."""
    angle, valid = np.empty(rows, np.float32), np.ones(rows, np.bool_)
    vertical, rates = np.empty((rows, 3), np.float32), np.empty((rows, 3), np.float32)
    random = np.random.default_rng(0)
    for first in range(0, rows, BLOCK_ROWS):
        block = slice(first, min(first + BLOCK_ROWS, rows))
        time_s = np.arange(block.start, block.stop) / rate_hz
        swing = 30 * np.sin(2 * np.pi * 0.03 * time_s) + 15 * np.sin(2 * np.pi * 0.7 * time_s)
        angle[block] = 45 + swing + random.normal(0, 0.3, len(time_s))
        radians = np.radians(angle[block])
        vertical[block] = np.stack([np.sin(radians), np.zeros_like(radians), np.cos(radians)], axis=1)
        rates[block] = 40 * vertical[block]
    samples = Segment(0, rate_hz, vertical, rates)
    recording = Recording("other", "", None, None, samples.duration_us, (samples,))
    return Elevation((ElevationSegment(0, rate_hz, angle, valid, vertical),), None), recording


@dataclass(frozen=True, slots=True)
class Cost:
    """Median processor time of the rounds, and the peak of memory beyond the angles."""

    rows: int
    cpu_s: float
    memory_mib: float


def measure(hours: float, rate_hz: float) -> Cost:
    """Measure in this process; its memory peak is the shift's if it measures nothing else."""
    warm, warm_recording = make_shift(5000, rate_hz)
    summarise_exposure(warm, None, warm_recording, np.zeros(3), SIGMA_DEG)
    elevation, recording = make_shift(round(hours * 3600 * rate_hz), rate_hz)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    cpu_s = median(measure_once(elevation, recording) for _ in range(ROUNDS))
    above = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / MEBIBYTE
    return Cost(len(elevation.segments[0]), cpu_s, above)


def measure_once(elevation: Elevation, recording: Recording) -> float:
    started = time.process_time()
    summarise_exposure(elevation, None, recording, np.zeros(3), SIGMA_DEG)
    return time.process_time() - started


def measure_apart(hours: float, rate_hz: float) -> Cost:
    """Measure in a separate process."""
    command = [sys.executable, "-m", "benchmarks.exposure", str(hours), str(rate_hz)]
    output = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    return Cost(**json.loads(output))


def main() -> None:
    if sys.argv[1:] == ["--oracles"]:
        raise SystemExit(print_oracles())
    if sys.argv[1:2] == ["--truth"]:
        raise SystemExit(print_truth(int(sys.argv[2])) if sys.argv[2:] else print_truth())
    if len(sys.argv) == 3:
        print(json.dumps(asdict(measure(float(sys.argv[1]), float(sys.argv[2])))))
        return
    for hours, rate_hz in SHIFTS:
        cost = measure_apart(hours, rate_hz)
        cost_text = f"{cost.cpu_s:6.3f} s of CPU {cost.memory_mib:6.1f} MiB above input"
        print(f"{hours:>4} h at {rate_hz:g} Hz {cost.rows:>11,} rows {cost_text}")


if __name__ == "__main__":
    main()
