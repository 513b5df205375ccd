"""Where rows come at another rate for a while, the time around them stays what it was."""

import io
import math

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from numpy.typing import NDArray

from acromion.fusion.errors import TooShort, UnknownRate, UnusableTime
from acromion.fusion.readers import read_recording
from acromion.fusion.readers.tables.columns import TimeUnit, find_time_unit, guess_exponent, measure_roughness
from acromion.fusion.readers.time.grid import estimate_period_us
from acromion.fusion.recording import Recording
from tests.badfiles import signal_files as s
from tests.badfiles.order_files import ordered, thinned, thinned_at_random
from tests.fusion.readers.seen import codes
from tests.fusion.readers.tables.table_builder import HEADER, line, read_text, table


def spans(recording: Recording) -> list[tuple[int, int, float]]:
    return [(s.start_us, s.end_us, round(s.rate_hz, 2)) for s in recording.segments]


def test_a_stretch_of_half_the_rate_is_a_segment_of_its_own() -> None:
    recording = read_text(ordered(thinned(2000, 4000, 2)))

    (flag,) = recording.flags
    assert spans(recording) == [
        (0, 20_000_000, 100.0),
        (20_000_000, 40_000_000, 50.0),
        (40_000_000, 60_000_000, 100.0),
    ]
    assert (flag.code, flag.count, flag.facts) == ("W-RATE-CHANGE", 1, {"rate_hz": 50.0})
    assert flag.spans_s == ((20.0, 40.0),)


@pytest.mark.parametrize(("hz", "other_hz"), [(100, 119), (104, 208), (476, 952), (119, 59.5)])
def test_uneven_stamps_hide_no_change_of_rate(hz: float, other_hz: float) -> None:
    random = np.random.default_rng(7)
    times_s = np.concatenate([np.arange(0, 30, 1 / hz), np.arange(30, 60, 1 / other_hz)])
    stamps = np.round(times_s * 1e6 + random.uniform(-100, 100, len(times_s))).astype(int)

    recording = read_text(table(stamps.tolist()))

    assert recording.duration_us == pytest.approx(60_000_000, abs=20_000)
    assert [round(s.rate_hz, 1) for s in recording.segments] == [hz, other_hz]
    assert codes(recording) == ["W-RATE-CHANGE"]


def test_for_a_short_while_lost_rows_are_bridged_as_ever() -> None:
    recording = read_text(ordered(thinned(2000, 2600, 2)))

    (segment,) = recording.segments
    assert (len(segment), len(segment.bridged)) == (6000, 300)
    assert codes(recording) == ["W-GAP"]


def test_a_table_of_nothing_but_uneven_steps_is_refused() -> None:
    with pytest.raises(UnusableTime) as refusal:
        read_text(ordered(thinned_at_random(0, 6000)))

    assert refusal.value.facts == {"why": "irregular"}


@pytest.mark.parametrize("slow_s", [60, 12])
def test_a_clock_of_whole_seconds_hides_no_change_of_rate(slow_s: int) -> None:
    """At 100 Hz, then at 50: before, half of each second was missing, and the rest went twice as fast."""
    fast = 100 - slow_s
    seconds = [s for s in range(100) for _ in range(100 if s < fast else 50)]

    recording = read_text(table(1_000_000 * s for s in seconds))

    assert spans(recording) == [(0, fast * 1_000_000, 100.0), (fast * 1_000_000, 100_000_000, 50.0)]
    assert codes(recording) == ["W-JITTER", "W-RATE-CHANGE"]


def test_a_second_with_fewer_rows_is_a_hole_and_no_change_of_rate() -> None:
    seconds = [s for s in range(30) for _ in range(60 if s == 15 else 100)]

    recording = read_text(table(1_000_000 * s for s in seconds))

    assert codes(recording) == ["W-JITTER", "W-GAP"]
    assert spans(recording) == [(0, 15_600_000, 100.0), (16_000_000, 30_000_000, 100.0)]


# The sample period is found however many rows are lost, so that what is lost is missing.


def stamp(rate_hz: float, lost: float, jitter_us: float, clock_us: int) -> NDArray[np.int64]:
    random = np.random.default_rng(1)
    kept = np.flatnonzero(random.random(6000) >= lost)
    exact = kept * 1e6 / rate_hz + random.uniform(-jitter_us, jitter_us, len(kept))
    return (np.floor(exact / clock_us) * clock_us).astype(np.int64)


@pytest.mark.parametrize("rate_hz", [100.0, 119.0, 952.0])
@pytest.mark.parametrize("lost", [0.0, 0.2])
@pytest.mark.parametrize("jitter_us", [0.0, 200.0])
def test_lost_rows_do_not_lengthen_the_period(rate_hz: float, lost: float, jitter_us: float) -> None:
    period_us = estimate_period_us(stamp(rate_hz, lost, jitter_us, clock_us=1))

    assert period_us == pytest.approx(1e6 / rate_hz, rel=2e-3)


@pytest.mark.parametrize("rate_hz", [119.0, 499.7])
@pytest.mark.parametrize("lost", [0.0, 0.2])
def test_a_millisecond_clock_is_fine_enough_up_to_500_hz(rate_hz: float, lost: float) -> None:
    period_us = estimate_period_us(stamp(rate_hz, lost, 0.0, clock_us=1000))

    assert period_us == pytest.approx(1e6 / rate_hz, rel=2e-3)


def test_every_tenth_row_lost_is_no_slower_sensor() -> None:
    rows = np.arange(6000)

    period_us = estimate_period_us((rows[rows % 10 != 9] * 10_000).astype(np.int64))

    assert period_us == 10_000.0


# A unit of time that cannot be is set aside where one other can; where only the readings tell, by these.


def test_so_are_those_of_parquet() -> None:
    columns = dict(zip(HEADER.split(",")[1:], s.readings().T, strict=True))
    file = io.BytesIO()
    pq.write_table(pa.table({"time_us": np.arange(6000) * 10} | columns), file)

    recording = read_recording(file, file_name="shift.parquet")

    (flag,) = recording.flags
    assert (recording.duration_us, flag.facts["read_as"]) == (60_000_000, "ms")


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


# Exports that number their packets and hold no time: MT Manager's, and what a preamble says of the rate.

NAMES = "\t".join(
    ["PacketCounter", "SampleTimeFine", *(f"Acc_{a}_g" for a in "XYZ"), *(f"Gyr_{a}_dps" for a in "XYZ")]
)
PREAMBLE = "// Start Time: Unknown\n// Update Rate: 100.0Hz\n// Firmware Version: 4.0.2\n"


def export(numbers: list[int], preamble: str = PREAMBLE) -> str:
    rows = (f"{n:05d}\t\t" + line(k).replace(",", "\t") for k, n in enumerate(numbers))
    return preamble + NAMES + "\n" + "\n".join(rows) + "\n"


def test_the_rate_of_the_file_goes_before_that_of_the_person() -> None:
    assert read_text(export(list(range(2000))), rate_hz=60.0).rate_hz == pytest.approx(100.0)


def test_a_rate_that_no_logger_has_is_not_believed() -> None:
    text = export(list(range(2000)), "// Update Rate: 100000 Hz\n")

    assert read_text(text, rate_hz=50.0).rate_hz == pytest.approx(50.0)


def test_packets_that_were_lost_are_missing() -> None:
    recording = read_text(export([*range(1000), *range(1300, 2300)]))

    gap = next(flag for flag in recording.flags if flag.code == "W-GAP")
    assert [len(segment) for segment in recording.segments] == [1000, 1000]
    assert recording.segments[1].start_us == 13_000_000
    assert (gap.first_s, gap.seconds) == (10.0, 3.0)


def test_packets_lost_while_the_counter_starts_over_are_missing() -> None:
    numbers = [*range(64_000, 65_500), *range(65_700, 67_000)]

    recording = read_text(export([n % 65_536 for n in numbers]))

    assert recording.duration_us == 30_000_000
    assert sum(flag.seconds for flag in recording.flags if flag.code == "W-GAP") == 2.0


def test_a_column_that_does_not_count_up_is_no_packet_counter() -> None:
    recording = read_text(export([7] * 2000))

    assert recording.duration_us == 20_000_000
    assert recording.understood["time"] == "row number"


def test_less_than_a_second_of_an_unknown_unit_is_too_short() -> None:
    with pytest.raises(TooShort):
        read_text(export([*range(3)], "").replace("_g", "").replace("_dps", ""), rate_hz=100.0)


# Rows without a time that cannot be read.


@pytest.mark.parametrize("damage", ["nan,nan,nan,nan,nan,nan", ",0,1,0,0,0", "x,0,1,0,0,0"])
def test_single_rows_that_are_missing_are_bridged_without_a_time_too(damage: str) -> None:
    """Every fortieth of 2000 rows at 100 Hz."""
    rows = [damage if k % 40 == 20 else line(k) for k in range(2000)]

    recording = read_text(",".join(HEADER.split(",")[1:]) + "\n" + "\n".join(rows) + "\n", rate_hz=100.0)

    (segment,) = recording.segments
    (gap,) = [flag for flag in recording.flags if flag.code == "W-GAP"]
    assert (len(segment), len(segment.bridged)) == (2000, 50)
    assert gap.count == 50
    assert gap.seconds == pytest.approx(0.5)
    assert segment.gyr_dps[41, 2] == pytest.approx(41.5)


def test_many_rows_in_a_row_that_are_missing_stay_missing_without_a_time() -> None:
    rows = ["nan,nan,nan,nan,nan,nan" if 1000 <= k < 1006 else line(k) for k in range(2000)]

    recording = read_text(",".join(HEADER.split(",")[1:]) + "\n" + "\n".join(rows) + "\n", rate_hz=100.0)

    assert spans(recording) == [(0, 10_000_000, 100.0), (10_060_000, 20_000_000, 100.0)]
