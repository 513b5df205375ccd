"""elevation.parquet: the angle series for those who compute on."""

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

from app.report.export.parquet import write_elevation
from fusion.elevation import Elevation, ElevationSegment


def make_segment(start_us: int, rate_hz: float, rows: int) -> ElevationSegment:
    angle = np.arange(rows, dtype=np.float32)
    return ElevationSegment(start_us, rate_hz, angle, np.ones(rows, np.bool_))


def write(folder: Path, *segments: ElevationSegment) -> pq.ParquetFile:
    write_elevation(Elevation(segments, None), folder / "elevation.parquet")
    return pq.read_table(folder / "elevation.parquet")


def test_a_100_hz_sensor_keeps_every_sample(tmp_path: Path) -> None:
    table = write(tmp_path, make_segment(0, 100.09, 500))

    assert table.num_rows == 500


def test_500_hz_is_thinned_to_every_fifth_sample(tmp_path: Path) -> None:
    table = write(tmp_path, make_segment(0, 500.0, 20))

    assert table["elevation_deg"].to_pylist() == [0, 5, 10, 15]


def test_time_runs_from_the_first_sample_across_holes(tmp_path: Path) -> None:
    table = write(tmp_path, make_segment(0, 100.0, 2), make_segment(5_000_000, 100.0, 2))

    assert table["time_s"].to_pylist() == [0.0, 0.01, 5.0, 5.01]


def test_the_columns_are_those_of_the_contract(tmp_path: Path) -> None:
    table = write(tmp_path, make_segment(0, 100.0, 2))

    assert table.column_names == ["time_s", "elevation_deg", "valid"]
