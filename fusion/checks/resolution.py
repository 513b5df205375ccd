"""Readings so coarse that a held arm looks as if it moved, or a moving one as if a channel stuck."""

from collections.abc import Sequence

import numpy as np

from fusion.caveats import Caveat
from fusion.checks.stopped import Values
from fusion.recording import QualityFlag, Recording
from fusion.still_limits import MOMENT, POSE

COARSE_G, COARSE_DPS = 1.5 * POSE.acc_sd_g, 2.0 * MOMENT.gyro_sd_dps
"""Between two values, readings at rest scatter by half a step: with an arm's own sway, or alone, past the
limit of stillness. Parts in use have 0.1 to 2.5 mg and 0.004 to 0.6 deg/s; ten bits of 16 g and 2000 deg/s
are 31 mg and 3.9 deg/s."""
SMALLEST_PART = 0.01
LOOKED_AT_ROWS = 20_000


def flag_resolution(recording: Recording) -> tuple[QualityFlag, ...]:
    """Flag steps from one value to the next that hide stillness (W-RESOLUTION)."""
    acc_g = measure_step([segment.acc_g for segment in recording.segments])
    gyr_dps = measure_step([segment.gyr_dps for segment in recording.segments])
    facts: dict[str, str | int | float] = {}
    if acc_g > COARSE_G:
        facts["step_mg"] = round(1000.0 * acc_g, 1)
    if gyr_dps > COARSE_DPS:
        facts["step_dps"] = round(gyr_dps, 2)
    return (QualityFlag(Caveat.RESOLUTION, facts=facts),) if facts else ()


def measure_step(samples: Sequence[Values]) -> float:
    """Return the smallest change from row to row, but for one in a hundred, of the coarsest axis.

    Rows that a program put in between are few; noise that was not rounded changes by far less.
    """
    stride = max(2, sum(map(len, samples)) // LOOKED_AT_ROWS)
    pairs = [(values[1::stride], values[: len(values) - 1 : stride]) for values in samples]
    changes = np.abs(np.concatenate([after - before for after, before in pairs]))
    return max(
        (float(np.quantile(axis[axis > 0.0], SMALLEST_PART)) for axis in changes.T if axis.any()), default=0.0
    )
