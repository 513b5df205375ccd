"""The primary accelerometer of a `.gt3x`, read now and then to check the IMU and the header against it."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fusion.readers.gt3x_clock import Timeline
from fusion.readers.gt3x_info import DeviceText
from fusion.readers.samples import SampleColumns

PROBED_EVERY_S = 16
"""One second in sixteen is enough evidence and costs nothing."""
DEFAULT_SCALE = 256.0
ROW_BYTES = 6
STILL_G = 0.02
FEWEST_STILL = 2
LARGEST_DIFFERENCE_G = 0.2


@dataclass(frozen=True, slots=True, eq=False)
class PrimarySecond:
    """One second of ACTIVITY2: its stamp, rows, mean in counts, shape (3,), and largest scatter in counts."""

    unix_s: int
    rows: int
    mean: NDArray[np.float64]
    scatter: float


@dataclass(slots=True)
class PrimarySeconds:
    """The seconds that were looked at."""

    seen: list[PrimarySecond] = field(default_factory=list)

    def note(self, unix_s: int, payload: bytes) -> None:
        """Take the payload of an ACTIVITY2 record: little-endian int16, x y z."""
        rows = len(payload) // ROW_BYTES
        counts = np.frombuffer(payload, "<i2", 3 * rows).reshape(rows, 3).astype(np.float64)
        scatter = float(counts.std(axis=0).max())
        self.seen.append(PrimarySecond(unix_s, rows, counts.mean(axis=0), scatter))


def measure_bias_g(
    seen: Sequence[PrimarySecond], text: DeviceText, timeline: Timeline, columns: SampleColumns
) -> float | None:
    """How far the two accelerometers are apart at rest, median over still seconds; None without any.

    Both share one frame (measured on a Link: apart by 0.04 g in every pose).
    """
    scale = text.number("Acceleration Scale") or DEFAULT_SCALE
    seconds = timeline.seconds
    places = {int(unix_s): k for k, unix_s in enumerate(seconds.unix_s)}
    apart = []
    for second in seen:
        if second.unix_s not in places or second.scatter > STILL_G * scale:
            continue
        k = places[second.unix_s]
        rows = columns.acc[seconds.first_row[k] : seconds.first_row[k] + seconds.n_rows[k]].astype(np.float64)
        if rows.std(axis=0).max() <= STILL_G:
            apart.append(float(np.linalg.norm(rows.mean(axis=0) - second.mean / scale)))
    return float(np.median(apart)) if len(apart) >= FEWEST_STILL else None


def contradicts_header(seen: Sequence[PrimarySecond], header_rate_hz: float | None) -> bool:
    """Whether the header's rate is absent, zero, or not that of the primary accelerometer it speaks of."""
    if not header_rate_hz:
        return True
    rows = float(np.median([second.rows for second in seen])) if seen else header_rate_hz
    return abs(rows - header_rate_hz) > 0.05 * header_rate_hz
