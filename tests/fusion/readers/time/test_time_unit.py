"""A unit of time that cannot be is set aside where one other can; where only the readings tell, by these."""

import io
import math

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from fusion.errors import UnknownRate
from fusion.readers import read_recording
from fusion.readers.tables.columns import TimeUnit, find_time_unit, guess_exponent, measure_roughness
from tests.badfiles import signal_files as s
from tests.badfiles.table_files import every_ten_seconds, misnamed
from tests.fusion.readers.tables.table_builder import HEADER, read_text

WRONG = [("ms", 1, "s"), ("s", 1000, "ms"), ("us", 1000, "ms"), ("ms", 1_000_000, "us"), ("s", 10**9, "ns")]


@pytest.mark.parametrize(("named", "per_s", "true"), WRONG)
def test_times_under_another_unit_are_read_and_it_is_said(named: str, per_s: int, true: str) -> None:
    recording = read_text(misnamed(named, per_s))

    (flag,) = recording.flags
    assert recording.duration_us == 60_000_000
    assert (flag.code, flag.facts["unit"], flag.facts["read_as"]) == ("W-UNITS", named, true)


def test_so_are_those_of_parquet() -> None:
    columns = dict(zip(HEADER.split(",")[1:], s.readings().T, strict=True))
    file = io.BytesIO()
    pq.write_table(pa.table({"time_us": np.arange(6000) * 10} | columns), file)

    recording = read_recording(file, file_name="shift.parquet")

    (flag,) = recording.flags
    assert (recording.duration_us, flag.facts["read_as"]) == (60_000_000, "ms")


def test_rows_of_ten_seconds_are_no_rows_of_ten_milliseconds() -> None:
    with pytest.raises(UnknownRate) as refusal:
        read_text(every_ten_seconds())

    assert refusal.value.facts == {
        "m": 0.1, "unit": "s", "other_unit": "ms", "other_hz": 100.0, "cure": "time unit",
    }  # fmt: skip


def test_an_epoch_keeps_its_unit_however_slowly_the_rows_come() -> None:
    first_s = 1_772_438_220.0

    assert find_time_unit([math.nan, *(first_s + 10.0 * k for k in range(9))], "s") == TimeUnit(6)


@pytest.mark.parametrize(("step", "exponent"), [(0.01, 6), (10.0, 3), (10_000.0, 0), (1e7, -3), (0.2, None)])
def test_a_rate_of_8_to_2000_hz_has_one_unit_at_most(step: float, exponent: int | None) -> None:
    assert guess_exponent([step * k for k in range(50)]) == exponent


def test_an_arm_is_smooth_from_row_to_row_and_unrelated_readings_are_not() -> None:
    arm = s.readings()[:, :3].astype(np.float32)
    chance = np.random.default_rng(3).normal(size=(6000, 3)).astype(np.float32)

    assert measure_roughness(arm) < 0.05
    assert measure_roughness(chance) == pytest.approx(1.0, abs=0.05)


def test_a_rate_that_no_unit_explains_is_told_with_its_cure() -> None:
    with pytest.raises(UnknownRate) as refusal:
        read_text(
            "time_s," + ",".join(HEADER.split(",")[1:]) + "\n" + "0.2,0,0,1,0,0,0\n0.4,0,0,1,0,1,0\n" * 1
        )

    assert refusal.value.facts == {"m": 5.0, "cure": "time unit"}
