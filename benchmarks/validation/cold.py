"""Measure one value in a separate process: `python -m benchmarks.validation.cold memory 100` (or first).

memory: peak MiB beyond the input while eight hours are converted to elevation; first: processor seconds of
the first call of estimate_vertical, then of the same with all imports. Reads the peak from /proc, so only on
Linux.
"""

import sys
import time
from pathlib import Path

import numpy as np

OWN = Path("/proc/self")
KIBIBYTES = 1024.0


def measure_memory(rate_hz: float) -> float:
    from acromion.fusion.elevation import estimate_elevation  # noqa: PLC0415
    from acromion.fusion.pose.calibrate import calibrate  # noqa: PLC0415
    from benchmarks.validation.speed import repeat_quarter  # noqa: PLC0415 (the other question must not pay)

    warming, recording = repeat_quarter(rate_hz, 0.1), repeat_quarter(rate_hz)
    estimate_elevation(calibrate(warming))
    (OWN / "clear_refs").write_text("5")
    before = _read_mib("VmRSS")
    estimate_elevation(calibrate(recording))
    return _read_mib("VmHWM") - before


def measure_first() -> tuple[float, float]:
    began = time.process_time()
    from acromion.fusion import estimate_vertical  # noqa: PLC0415 (its import is a part of what is measured)

    imported = time.process_time()
    estimate_vertical(np.tile([0.0, 0.0, 1.0], (1000, 1)), np.zeros((1000, 3)), 100.0)
    ended = time.process_time()
    return ended - imported, ended - began


def _read_mib(field: str) -> float:
    line = next(line for line in (OWN / "status").read_text().splitlines() if line.startswith(field))
    return float(line.split()[1]) / KIBIBYTES


def main() -> None:
    question = sys.argv[1]
    print(*([measure_memory(float(sys.argv[2]))] if question == "memory" else measure_first()))


if __name__ == "__main__":
    main()
