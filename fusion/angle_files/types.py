"""What a file holds that gives angles without a fusion of ours."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from fusion.readers.source import Source, hash_source
from fusion.recording import Float64Array, QualityFlag

Up = NDArray[np.float32]
"""The unit vector to the zenith in the frame of the segment or sensor, shape (n, 3)."""


@dataclass(frozen=True, slots=True, eq=False)
class AngleFile:
    """Rows in the file's own clock, missing ones absent.

    ``device``: "mvn", "dot", "other" (MT Manager) or "angles".
    ``time_s``: shape (n,), rising. The file's own time column; where it has none, seconds from its first row.
    ``first_s``, ``last_s``: the file's clock at its first and its last row, missing ones counted.
    ``elevation_deg``: shape (n,), float32: 0 hanging, 90 level, 180 overhead; None as long as the arm's axis
    is not known.
    ``up``: shape (n, 3), float32: the unit vector to the zenith in the frame of the segment or sensor; None
    where the file holds ready angles.
    ``axis``: shape (3,), unit: along the upper arm towards the shoulder in that frame; None where it is not
    known.
    ``understood``: what the reader took the file for, for people.
    """

    device: str
    sha256: str
    time_s: Float64Array
    first_s: float
    last_s: float
    elevation_deg: NDArray[np.float32] | None = None
    up: Up | None = None
    axis: Float64Array | None = None
    start: datetime | None = None
    flags: tuple[QualityFlag, ...] = ()
    understood: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class AngleFileOptions:
    """What the person says about a file.

    ``side``: which arm of an MVNX, the right one where nothing is said; ``rate_hz``: for files without time.
    """

    side: str | None = None
    rate_hz: float | None = None


def keep_orientation(
    device: str,
    source: Source,
    time_s: Float64Array,
    up: Up,
    understood: Mapping[str, str],
    start: datetime | None = None,
) -> AngleFile:
    """Keep the rows, times (n,) and zenith (n, 3), that hold an orientation."""
    present = np.isfinite(up).all(axis=1)
    return AngleFile(
        device=device,
        sha256=hash_source(source),
        time_s=time_s[present],
        first_s=float(time_s[0]),
        last_s=float(time_s[-1]),
        up=up[present],
        start=start,
        understood=understood,
    )
