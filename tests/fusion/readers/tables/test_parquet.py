"""Parquet tables with columns named as in our CSV."""

import io
from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from acromion.fusion.errors import (
    DamagedFile,
    FusionError,
    NoGyroscope,
    UnknownColumns,
    UnknownRate,
    UnsafeArchive,
    UnusableTime,
)
from acromion.fusion.readers import read_recording
from acromion.fusion.recording import Recording
from tests.badfiles.arm import minute
from tests.fusion.readers.seen import codes, spans_s

NAMES = ("acc_x_g", "acc_y_g", "acc_z_g", "gyr_x_dps", "gyr_y_dps", "gyr_z_dps")
MICROS = np.arange(6000) * 10_000


def columns(rows: int = 6000) -> dict[str, Any]:
    acc_g, gyr_dps = minute()
    return dict(zip(NAMES, np.hstack([acc_g, gyr_dps])[:rows].T, strict=True))


def write(table: Mapping[str, Any]) -> bytes:
    file = io.BytesIO()
    pq.write_table(pa.table(dict(table)), file)
    return file.getvalue()


def read(content: bytes, rate_hz: float | None = None) -> Recording:
    return read_recording(io.BytesIO(content), file_name="shift.parquet", rate_hz=rate_hz)


@pytest.mark.parametrize(
    ("name", "stamps"),
    [
        ("time_us", MICROS),
        ("time_s", np.arange(6000) / 100),
        (
            "timestamp",
            [datetime(2026, 3, 2, 8, tzinfo=UTC) + timedelta(milliseconds=10 * k) for k in range(6000)],
        ),
    ],
    ids=["microseconds", "seconds", "timestamps"],
)
def test_every_sample_arrives(name: str, stamps: Any) -> None:
    recording = read(write({name: stamps, **columns()}))

    (segment,) = recording.segments
    assert recording.duration_us == 60_000_000
    assert segment.acc_g == pytest.approx(minute()[0], abs=1e-6)
    assert segment.gyr_dps == pytest.approx(minute()[1], abs=1e-4)


@pytest.mark.parametrize("name", ["gyr_x_dps", "time_s"])
def test_rows_without_a_number_are_missing(name: str) -> None:
    values = {"time_s": np.arange(6000) / 100, **columns()}
    values[name] = values[name].copy()
    values[name][2000:2100] = np.nan

    recording = read(write(values))

    assert spans_s(recording) == [(0.0, 2000), (21.0, 3900)]
    assert codes(recording) == ["W-NAN", "W-GAP"]


@pytest.mark.parametrize("kind", [pa.int64(), pa.float64(), pa.timestamp("us")], ids=str)
def test_rows_without_a_time_are_missing(kind: pa.DataType) -> None:
    absent = np.isin(np.arange(6000), [0, *range(2000, 2100)])
    stamps = pa.array(MICROS, mask=absent).cast(kind)

    recording = read(write({"time_us": stamps, **columns()}))

    assert spans_s(recording) == [(0.0, 1999), (20.99, 3900)]
    assert [(flag.code, flag.count) for flag in recording.flags[:2]] == [("W-NAN", 101), ("W-GAP", 1)]


def test_without_time_the_person_tells_the_rate() -> None:
    content = write(columns())

    assert read(content, rate_hz=50.0).duration_us == 120_000_000
    with pytest.raises(UnknownRate):
        read(content)


def test_a_file_that_unpacks_to_far_more_than_it_holds_is_refused() -> None:
    zeros = np.zeros(3_000_000, np.float32)

    with pytest.raises(UnsafeArchive):
        read(write({"time_us": np.zeros(3_000_000, np.int64), **dict.fromkeys(NAMES, zeros)}))


@pytest.mark.parametrize(
    ("content", "error"),
    [
        (write({"time_us": MICROS, **dict(list(columns().items())[:3])}), NoGyroscope),
        (write({"a": [1], "b": [2]}), UnknownColumns),
        (write(columns())[:-100], DamagedFile),
        (write({"time_us": MICROS[::-1], **columns()}), UnusableTime),
    ],
    ids=["no gyroscope", "unknown columns", "cut", "newest first"],
)
def test_what_is_no_recording_is_refused(content: bytes, error: type[FusionError]) -> None:
    with pytest.raises(error):
        read(content)


def test_a_counter_of_32_bits_is_carried_on() -> None:
    recording = read(write({"time_us": (2**32 - 20_000_000 + MICROS) % 2**32, **columns()}))

    assert (recording.duration_us, codes(recording)) == (60_000_000, ["W-WRAP"])


STAMPS = 1_772_438_280_255_000 + MICROS


@pytest.mark.parametrize(
    ("name", "stamps"),
    [
        ("timestamp", pa.array(STAMPS, pa.timestamp("us"))),
        ("time_s", STAMPS / 1e6),
        ("timestamp", STAMPS // 1000),
        ("time_ns", STAMPS * 1000),
        ("__index_level_0__", pa.array(STAMPS * 1000, pa.timestamp("ns"))),
        ("time", pa.array(STAMPS, pa.timestamp("us")).cast(pa.string())),
        ("time", pa.array(MICROS * 1000, pa.duration("ns"))),
    ],
    ids=["timestamps", "seconds", "no unit", "nanoseconds", "index", "words", "durations"],
)
def test_milliseconds_of_the_second_beside_a_time_are_not_the_time(name: str, stamps: Any) -> None:
    recording = read(write({"ms": (STAMPS // 1000 % 1000).astype(np.int64), name: stamps, **columns()}))

    assert recording.duration_us == 60_000_000
    assert recording.rate_hz == pytest.approx(100.0)


def test_milliseconds_of_the_second_alone_are_no_time() -> None:
    with pytest.raises(UnusableTime) as refusal:
        read(write({"ms": (STAMPS // 1000 % 1000).astype(np.int64), **columns()}))

    assert refusal.value.facts["why"] == "form"
