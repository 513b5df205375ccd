"""Put gravity back that a phone or a watch removed from the acceleration and wrote in separate columns."""

import numpy as np

from fusion.errors import NoGravity
from fusion.readers.samples import SampleColumns
from fusion.readers.tables.columns import Column

LOOKED_AT_ROWS = 20_000
STEADY_PART = 0.05
"""What is called gravity keeps its length within this part, at nine of ten rows; else it is not used."""
NEAR_ONE = 0.1
CORE_MOTION = "rotationrate"
"""Core Motion's word for the gyroscope. Its gravity points down, and at rest so does the sum."""


def put_back_gravity(
    columns: SampleColumns, gravity: SampleColumns, scale_g: float, acc: Column, gyr: Column
) -> bool:
    """Add gravity to an acceleration that lacks it, in place; return whether it did.

    Both were read by ``scale_g``. The unit does not depend on what it is called: gravity is 1 g long, and the
    acceleration beside it is in the same unit. Rows without gravity are left out. Core Motion's readings, in
    g, are turned over: the sum is then what an accelerometer measures.

    Raises
    ------
    NoGravity
        The acceleration lacks gravity by its name, and the columns hold none.
    """
    order = np.argsort(gravity.stamps, kind="stable")
    stamps = gravity.stamps[order]
    place = np.searchsorted(stamps, columns.stamps).clip(max=max(len(stamps) - 1, 0))
    has_gravity = stamps[place] == columns.stamps if len(stamps) else np.zeros(columns.rows, np.bool_)
    looked_at = np.flatnonzero(has_gravity)[:: max(1, columns.rows // LOOKED_AT_ROWS)]
    parts_g, acc_g = gravity.acc[order[place[looked_at]]], columns.acc[looked_at]
    lengths_g = np.linalg.norm(parts_g, axis=1)
    low, length_g, high = np.quantile(lengths_g, [0.05, 0.5, 0.95]) if len(looked_at) else np.zeros(3)
    if length_g == 0.0 or high - low > STEADY_PART * length_g:
        if acc.channel == "linear":
            raise NoGravity
        return False
    without_g = np.median(np.linalg.norm(acc_g - parts_g, axis=1))
    if acc.channel != "linear" and without_g < np.median(np.linalg.norm(acc_g, axis=1)):
        return False  # gravity is in it
    is_core_motion = CORE_MOTION in gyr.name.lower() and abs(length_g / scale_g - 1.0) < NEAR_ONE
    columns.acc[:] += gravity.acc[order[place]]
    columns.acc[:] *= np.float32((-1.0 if is_core_motion else 1.0) / length_g)
    columns.keep(has_gravity)
    return True
