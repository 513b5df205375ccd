"""elevation.parquet: the angle series for those who compute on."""

import csv
import gzip
import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from acromion.app.analysis.run import make_report
from acromion.app.report.export.all import (
    build_flags,
    build_nullable_numbers,
    build_nullable_texts,
    build_numbers,
)
from acromion.app.report.export.angles import encode_elevation_csv, write_elevation
from acromion.app.request import ReportRequest
from acromion.fusion import read_elevation
from acromion.fusion.angle_files import AngleFile, read_angle_file
from acromion.fusion.comparison.movement import read_movement
from acromion.fusion.elevation import Elevation, ElevationSegment
from acromion.fusion.errors import UnknownColumns, UnreadableFile, UnusableTime
from acromion.fusion.exposure.summary import summarise_exposure
from acromion.fusion.recording import Segment, Span


def make_segment(start_us: int, rate_hz: float, rows: int) -> ElevationSegment:
    angle = np.arange(rows, dtype=np.float32)
    return ElevationSegment(start_us, rate_hz, angle, np.ones(rows, np.bool_))


def lay(angles_deg: list[float], bridged: tuple[tuple[int, int], ...] = ()) -> ElevationSegment:
    valid = np.ones(len(angles_deg), np.bool_)
    for first, stop in bridged:
        valid[first:stop] = False
    return ElevationSegment(0, 100.0, np.array(angles_deg, np.float32), valid, bridged=bridged)


def write(folder: Path, *segments: ElevationSegment) -> Path:
    write_elevation(Elevation(segments, None), folder / "elevation.parquet")
    return folder / "elevation.parquet"


def write_and_read(folder: Path, *segments: ElevationSegment) -> pa.Table:
    return pq.read_table(write(folder, *segments))


# ------------------------------------------------------------------ what is written


# Of 500 Hz every fifth row is kept: 0, 5, 10 and 15, of which 4 to 10 were put in.
BRIDGED = replace(make_segment(0, 500.0, 20), bridged=((4, 11),))


@pytest.mark.parametrize(
    ("segments", "column", "told"),
    [
        ([make_segment(0, 100.09, 5)], "elevation_cdeg", [0, 100, 200, 300, 400]),
        ([make_segment(0, 500.0, 20)], "elevation_cdeg", [0, 500, 1000, 1500]),
        ([BRIDGED], "elevation_cdeg", [0, None, None, 1500]),
        ([lay([0.0, 12.344, 12.346, 180.0])], "elevation_cdeg", [0, 1234, 1235, 18000]),
        ([make_segment(0, 30.0, 3)], "time_us", [0, 33_333, 66_667]),
        (
            [make_segment(0, 100.0, 2), make_segment(5_000_000, 100.0, 2)],
            "time_us",
            [0, 10_000, 5_000_000, 5_010_000],
        ),
    ],
    ids=["100 Hz", "500 Hz", "500 Hz bridged", "hundredths", "between microseconds", "across a hole"],
)
def test_rows_are_thinned_to_100_hz_and_rounded_to_microseconds_and_hundredths(
    tmp_path: Path, segments: list[ElevationSegment], column: str, told: list[int | None]
) -> None:
    assert write_and_read(tmp_path, *segments)[column].to_pylist() == told


def test_the_columns_and_the_version_are_those_of_the_contract(tmp_path: Path) -> None:
    path = write(tmp_path, make_segment(0, 100.0, 2))
    schema = pq.read_table(path).schema

    assert dict(zip(schema.names, schema.types, strict=True)) == {
        "time_us": pa.int64(),
        "elevation_cdeg": pa.int16(),
        "valid": pa.bool_(),
        "analysed": pa.bool_(),
        "acceleration_cg": pa.int16(),
    }
    assert pq.read_metadata(path).metadata[b"schema"] == b"acromion.elevation/2"


# 2.5 blocks of 0.1 s: 1 g, 2 g and, in the last five rows, 3 g.
SIZES_G = np.repeat([1.0, 2.0, 3.0], [10, 10, 5])


@pytest.mark.parametrize("per_row", [1, 2], ids=["100 Hz", "200 Hz"])
def test_the_first_row_of_each_tenth_of_a_second_has_its_mean_acceleration(
    tmp_path: Path, per_row: int
) -> None:
    acc_g = np.zeros((25 * per_row, 3), np.float32)
    acc_g[:, 2] = -np.repeat(SIZES_G, per_row)
    samples = Segment(0, 100.0 * per_row, acc_g, np.zeros_like(acc_g))
    path = tmp_path / "elevation.parquet"
    write_elevation(Elevation((make_segment(0, 100.0, 25),), None), path, samples=(samples,))

    told = pq.read_table(path)["acceleration_cg"].to_pylist()

    assert {row: value for row, value in enumerate(told) if value is not None} == {0: 100, 10: 200, 20: 300}


def test_angles_without_samples_have_no_acceleration(tmp_path: Path) -> None:
    path = write(tmp_path, make_segment(0, 100.0, 25))

    assert pq.read_table(path)["acceleration_cg"].null_count == 25
    assert read_movement(path) == ()


def test_the_acceleration_is_read_at_the_middle_of_its_rows_and_a_hole_ends_a_run(tmp_path: Path) -> None:
    acc_g = np.ones((50, 3), np.float32)
    holes = [Segment(start_us, 100.0, acc_g, acc_g) for start_us in (0, 60_000_000)]
    path = tmp_path / "elevation.parquet"
    angles = tuple(make_segment(hole.start_us, 100.0, 50) for hole in holes)
    write_elevation(Elevation(angles, None), path, samples=holes)

    runs = read_movement(path)

    assert [(run.start_s, run.rate_hz, len(run)) for run in runs] == [(0.05, 10.0, 5), (60.05, 10.0, 5)]
    assert runs[0].values.tolist() == pytest.approx([1.73] * 5)


def test_a_bridge_and_a_row_without_an_angle_are_missing_and_an_untrusted_row_is_not(tmp_path: Path) -> None:
    angle = np.array([10.0, 11.0, np.nan, 12.0, 13.0], np.float32)
    valid = np.array([True, False, True, True, False])
    table = write_and_read(tmp_path, ElevationSegment(0, 100.0, angle, valid, bridged=((1, 2),)))

    assert table["elevation_cdeg"].to_pylist() == [1000, None, None, 1200, 1300]
    assert table["valid"].to_pylist() == [True, False, False, True, False]


def test_a_row_in_a_break_is_valid_but_not_analysed(tmp_path: Path) -> None:
    segment = lay([10.0, 11.0, 12.0, 13.0], bridged=((3, 4),))
    path = tmp_path / "elevation.parquet"
    write_elevation(Elevation((segment,), None), path, (Span(10_000, 10_000, "break"),))
    table = pq.read_table(path)

    assert table["valid"].to_pylist() == [True, True, True, False]
    assert table["analysed"].to_pylist() == [True, False, True, False]


def test_many_short_segments_share_a_group_of_rows(tmp_path: Path) -> None:
    path = write(tmp_path, *(make_segment(start * 5_000_000, 100.0, 2) for start in range(50)))

    assert pq.read_metadata(path).num_row_groups == 1


def test_a_moving_arm_takes_at_most_one_byte_a_row(tmp_path: Path) -> None:
    # An arm that swings over 60 deg at 0.5 Hz, with 0.05 deg of noise.
    time_s = np.arange(100_000) / 100.09
    noise_deg = np.random.default_rng(1).normal(0.0, 0.05, len(time_s))
    angle = (60.0 + 30.0 * np.sin(np.pi * time_s) + noise_deg).astype(np.float32)
    path = write(tmp_path, ElevationSegment(0, 100.09, angle, np.ones(len(angle), np.bool_)))

    assert path.stat().st_size <= 1.05 * len(angle)


# ------------------------------------------------------------------ what is read back


def tell(elevation: Elevation) -> list[tuple[int, list[float], list[bool]]]:
    return [(s.start_us, s.elevation_deg.tolist(), s.valid.tolist()) for s in elevation.segments]


def test_what_was_written_is_read_back_from_a_path_and_an_open_file(tmp_path: Path) -> None:
    path = write(tmp_path, make_segment(0, 100.0, 3), make_segment(5_000_000, 100.0, 1))
    segments = [(0, [0.0, 1.0, 2.0], [True] * 3), (5_000_000, [0.0], [True])]

    with path.open("rb") as file:
        assert tell(read_elevation(path)) == tell(read_elevation(file)) == segments


def test_the_rate_is_read_back_to_a_millionth(tmp_path: Path) -> None:
    path = write(tmp_path, make_segment(0, 100.09, 5000))

    assert read_elevation(path).segments[0].rate_hz == pytest.approx(100.09, rel=1e-6)


def test_missing_stays_missing(tmp_path: Path) -> None:
    path = write(tmp_path, lay([10.0, 11.0, 12.0], bridged=((1, 2),)))

    assert np.isnan(read_elevation(path).segments[0].elevation_deg).tolist() == [False, True, False]


def test_a_table_of_other_columns_is_refused(tmp_path: Path) -> None:
    pq.write_table(pa.table({"time_s": [0.0], "angle": [1.0]}), tmp_path / "a.parquet")

    with pytest.raises(UnknownColumns):
        read_elevation(tmp_path / "a.parquet")


def test_a_file_that_is_no_parquet_is_refused() -> None:
    with pytest.raises(UnreadableFile):
        read_elevation(io.BytesIO(b"PAR1 and no more"))


def test_a_column_whose_name_is_no_text_is_refused(tmp_path: Path) -> None:
    body = write(tmp_path, lay([10.0, 11.0])).read_bytes().replace(b"elevation_cdeg", b"elevation_\xffdeg")

    with pytest.raises(UnreadableFile):
        read_elevation(io.BytesIO(body))


def test_times_that_do_not_rise_are_refused(tmp_path: Path) -> None:
    columns = {"time_us": [10, 0], "elevation_cdeg": [1, 2], "valid": [True, True]}
    pq.write_table(pa.table(columns), tmp_path / "a.parquet")

    with pytest.raises(UnusableTime):
        read_elevation(tmp_path / "a.parquet")


def read_reference(path: Path) -> AngleFile:
    with path.open("rb") as file:
        return read_angle_file(file)


def test_as_a_reference_it_lacks_what_is_missing_or_not_valid(tmp_path: Path) -> None:
    file = read_reference(write(tmp_path, lay([10.0, 11.0, 12.5, 13.0], bridged=((1, 2),))))

    assert file.time_s.tolist() == [0.0, 0.02, 0.03]
    assert file.elevation_deg is not None
    assert file.elevation_deg.tolist() == [10.0, 12.5, 13.0]


def test_the_figures_of_the_file_are_those_of_the_results(shift_gt3x: Path, tmp_path: Path) -> None:
    make_report(shift_gt3x, ReportRequest("a.gt3x", kinds=(), languages=("en",)), tmp_path)
    told = json.loads((tmp_path / "results.json").read_text("utf-8"))["exposure"]

    found = summarise_exposure(read_elevation(tmp_path / "elevation.parquet"))

    assert [f"{x.percent:.1f}" for x in found.bins] == [f"{x['percent']:.1f}" for x in told["bins"]]
    assert [x.count for x in found.entries] == [x["count"] for x in told["entries"]]
    assert [f"{x:.1f}" for x in found.percentiles_deg.values()] == [
        f"{x:.1f}" for x in told["percentiles_deg"].values()
    ]


# ------------------------------------------------------------------ as text


def list_rows(path: Path) -> list[list[str]]:
    return list(csv.reader(gzip.decompress(encode_elevation_csv(path)).decode("utf-8").splitlines()))


def test_the_text_is_in_seconds_and_degrees(tmp_path: Path) -> None:
    path = write(tmp_path, lay([10.0, 11.0, 12.346], bridged=((1, 2),)))

    assert list_rows(path) == [
        ["time_s", "elevation_deg", "valid", "analysed"],
        ["0", "10", "true", "true"],
        ["0.01", "", "false", "false"],
        ["0.02", "12.35", "true", "true"],
    ]


# Columns laid out by ourselves hold what they were given.


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_numbers_keep_their_type(kind: type) -> None:
    column = build_numbers(np.array([0.5, -1.25, 180.0], kind))

    assert column.equals(pa.array([0.5, -1.25, 180.0], pa.from_numpy_dtype(kind)))


def test_every_second_number_of_a_longer_array_is_laid_close() -> None:
    column = build_numbers(np.arange(6.0)[::2])

    assert column.to_pylist() == [0.0, 2.0, 4.0]


def test_more_flags_than_a_byte_holds_stay_in_order() -> None:
    flags = [True, False, False, True, True, False, True, False, True]

    assert build_flags(np.array(flags)).to_pylist() == flags


def test_a_number_that_is_not_there_is_null() -> None:
    column = build_nullable_numbers([1.5, None, 3])

    assert column.equals(pa.array([1.5, None, 3.0], pa.float64()))


def test_a_text_that_is_not_there_is_null_and_an_empty_one_is_empty() -> None:
    column = build_nullable_texts(["é", None, "", "S012"])

    assert column.equals(pa.array(["é", None, "", "S012"], pa.string()))
