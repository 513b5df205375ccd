"""Parquet tables out of order are put right as text is."""

import io

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from fusion.errors import UnusableTime
from fusion.readers import read_recording
from fusion.recording import Recording
from tests.badfiles.arm import minute
from tests.fusion.readers.tables.table_builder import codes

ACC_G, GYR_DPS = minute()
NAMES = ("ax_g", "ay_g", "az_g", "gx_dps", "gy_dps", "gz_dps")


def read_rows(order: list[int], stamps: pa.Array, name: str = "time_us") -> Recording:
    readings = np.hstack([ACC_G, GYR_DPS])[order]
    columns = dict(zip(NAMES, readings.T, strict=True))
    file = io.BytesIO()
    pq.write_table(pa.table({name: stamps.take(pa.array(order)), **columns}), file)
    return read_recording(file, file_name="shift.parquet")


def test_rows_with_the_newest_first_are_refused() -> None:
    with pytest.raises(UnusableTime):
        read_rows(list(range(5999, -1, -1)), pa.array(range(0, 60_000_000, 10_000)))


def test_a_counter_of_32_bits_is_carried_on() -> None:
    stamps = [(2**32 - 20_000_000 + us) % 2**32 for us in range(0, 60_000_000, 10_000)]

    recording = read_rows(list(range(6000)), pa.array(stamps))

    assert (recording.duration_us, codes(recording)) == (60_000_000, ["W-WRAP"])
