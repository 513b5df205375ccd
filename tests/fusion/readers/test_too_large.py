"""How many rows a file may hold: refused before they fill the memory, by what the first of them foretell."""

import gzip
import io
from functools import cache

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from acromion.fusion.angle_files import read_angle_file
from acromion.fusion.errors import RefusedXml, TooLong, UnsafeArchive
from acromion.fusion.readers import read_recording, samples
from acromion.fusion.readers.samples import check_rows
from tests.fusion.readers.cwa.cwa_builder import blocks, header
from tests.fusion.readers.tables.table_builder import HEADER

MILLION = 1_000_000
HOUR_100_HZ = 360_000


@pytest.mark.parametrize(
    ("rows", "row_bytes"),
    [
        (24 * 3600 * 500, 20),  # a day at 500 Hz, packed
        (24 * 3600 * 500, 60),  # as text
        (168 * HOUR_100_HZ, 13),  # a week of an AX6
        (14 * 24 * HOUR_100_HZ, 19),  # two weeks, packed
        (16 * MILLION, 0),  # few enough: not asked
    ],
)
def test_what_a_device_records_is_taken(rows: int, row_bytes: int) -> None:
    check_rows(rows // 2, rows // 2 * row_bytes, rows * row_bytes)


def test_more_rows_than_any_device_records_are_refused_while_they_are_few() -> None:
    with pytest.raises(TooLong) as refusal:
        check_rows(17 * MILLION, 17 * 14 * MILLION, 250 * 14 * MILLION)

    assert refusal.value.facts == {"rows": 250, "most": 134}


def test_rows_that_are_packed_as_those_of_no_sensor_are_refused() -> None:
    with pytest.raises(UnsafeArchive) as refusal:
        check_rows(17 * MILLION, 5 * MILLION, 34 * MILLION)

    assert refusal.value.facts["reason"] == "ratio"


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Limits so small that a test's file reaches them."""
    monkeypatch.setattr(samples, "UNASKED_ROWS", 70_000)
    monkeypatch.setattr(samples, "MOST_ROWS", 140_000)


@cache
def write_rows() -> bytes:
    rows = np.random.default_rng(1).integers(100, 999, (200_000, 6))
    lines = (f"{10_000 * k},{','.join(f'0.{value}' for value in row)}" for k, row in enumerate(rows))
    return "\n".join([HEADER, *lines, ""]).encode()


@pytest.mark.usefixtures("few")
def test_a_table_of_too_many_rows_is_refused() -> None:
    with pytest.raises(TooLong):
        read_recording(io.BytesIO(write_rows()))


@pytest.mark.usefixtures("few")
def test_a_packed_table_is_judged_by_its_packed_bytes() -> None:
    with pytest.raises(TooLong):
        read_recording(io.BytesIO(gzip.compress(write_rows(), 1)))


@pytest.mark.usefixtures("few")
def test_a_table_packed_beyond_any_sensor_is_refused() -> None:
    rows = b"0,0.1,0.2,0.9,1.5,2.5,3.5\n" * 2000
    packed = gzip.compress(HEADER.encode() + b"\n") + gzip.compress(rows) * 100

    with pytest.raises(UnsafeArchive):
        read_recording(io.BytesIO(packed))


def write_parquet(rows: int, **options: object) -> io.BytesIO:
    file = io.BytesIO()
    table = {name: np.full(rows, k, np.float32) for k, name in enumerate(HEADER.split(",")[1:])}
    pq.write_table(pa.table({"time_us": np.arange(rows) * 10_000, **table}), file, **options)
    file.seek(0)
    return file


@pytest.mark.usefixtures("few")
def test_a_parquet_of_too_many_rows_is_refused_by_its_index() -> None:
    with pytest.raises(TooLong):
        read_recording(write_parquet(200_000, compression="none", use_dictionary=False))


def test_pages_that_unpack_beyond_any_sensor_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("acromion.fusion.readers.tables.parquet.FREE_PAGE_BYTES", 100_000)
    file = io.BytesIO()
    columns = {name: np.zeros(20_000) for name in HEADER.split(",")}
    pq.write_table(pa.table(columns), file, compression="zstd", use_dictionary=False)
    file.seek(0)

    with pytest.raises(UnsafeArchive):
        read_recording(file)


@pytest.mark.usefixtures("few")
def test_a_cwa_of_too_many_rows_is_refused() -> None:
    with pytest.raises(TooLong):
        read_recording(io.BytesIO(header() + blocks(range(1))[0] * 12_000))


@pytest.mark.usefixtures("few")
def test_an_angle_series_of_too_many_rows_is_refused() -> None:
    rows = "".join(f"{k / 100},{k % 90}\n" for k in range(200_000))

    with pytest.raises(TooLong):
        read_angle_file(io.BytesIO(f"time_s,elevation_deg\n{rows}".encode()), "angles.csv")


def test_an_angle_series_is_read_alike_in_one_piece_and_in_many() -> None:
    rows = [(k / 100, (k * 7 % 900) / 10) for k in range(200_000)]  # 2.4 MB: several pieces
    text = "time_s,elevation_deg\n" + "".join(f"{time_s},{angle_deg}\n" for time_s, angle_deg in rows)

    read = read_angle_file(io.BytesIO(text.encode()), "angles.csv")

    assert read.time_s.tolist() == [time_s for time_s, _ in rows]
    assert read.elevation_deg is not None
    assert read.elevation_deg.tolist() == [float(np.float32(angle_deg)) for _, angle_deg in rows]


MVNX = '<mvnx version="4"><subject frameRate="60">'


@pytest.mark.parametrize(
    "rest",
    [
        "<a>" * 100,
        "<segment label='x'/>" * 5000,
        "<orientation>" + "1 0 0 0 " * 200_000,
        "<!-- " + "x" * (30 << 20),
        "<segments a='" + "x" * (30 << 20),
    ],
    ids=["deep", "labels", "numbers", "comment", "attribute"],
)
def test_an_element_that_no_export_holds_is_refused(rest: str) -> None:
    with pytest.raises(RefusedXml) as refusal:
        read_angle_file(io.BytesIO((MVNX + rest).encode()), "capture.mvnx")

    assert refusal.value.facts["reason"] == "broken"


@pytest.mark.usefixtures("few")
def test_a_capture_of_too_many_frames_is_refused() -> None:
    padded = "<frame" + " " * 37 + "/>"  # 93,000 in the first piece of 4 MiB
    frames = "<frames>" + padded * 186_000 + "</frames></subject></mvnx>"

    with pytest.raises(TooLong):
        read_angle_file(io.BytesIO((MVNX + frames).encode()), "capture.mvnx")
