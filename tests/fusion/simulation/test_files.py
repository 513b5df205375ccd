"""The files of a simulated day, read here by the plainest means, against what the formats demand."""

import json
import re
import struct
import zipfile
from collections.abc import Callable
from functools import reduce
from operator import xor
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acromion.fusion.simulation import simulate_shift, write_recordings, write_shift
from acromion.fusion.simulation.files import (
    NO_STAMPS,
    ROW,
    SecondCutter,
    count_entries,
    put_rows,
    round_to_millionths,
)
from tests.simulated_shifts import play_shift

HOURS = 0.05
Record = tuple[int, int, bytes]


@pytest.fixture(scope="module")
def gt9x(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, ...]:
    return write_recordings(tmp_path_factory.mktemp("gt9x"), "gt9x", HOURS, 1)


@pytest.fixture(scope="module")
def lsm9ds1(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, ...]:
    return write_recordings(tmp_path_factory.mktemp("lsm9ds1"), "lsm9ds1", HOURS, 1)


SHIFT, OTHER = simulate_shift("gt9x", HOURS, 1), simulate_shift("lsm9ds1", HOURS, 1)


def split_log(path: Path) -> list[Record]:
    """Split log.bin into (type, time, payload), checking every checksum."""
    log = zipfile.ZipFile(path).read("log.bin")
    records, at = [], 0
    while at < len(log):
        separator, kind, time, size = struct.unpack_from("<BBIH", log, at)
        assert separator == 0x1E
        assert reduce(xor, log[at : at + 9 + size]) == 0xFF
        records.append((kind, time, log[at + 8 : at + 8 + size]))
        at += 9 + size
    return records


def read_rows(path: Path) -> list[Any]:
    """Return the rows of each second."""
    return [np.frombuffer(payload[2:], ROW) for kind, _, payload in split_log(path) if kind == 25]


def read_csv(path: Path, skipped: int, columns: range) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.loadtxt(path, delimiter=",", skiprows=skipped, usecols=columns)


def test_the_files_are_named_after_the_seed_and_the_export_may_be_left_out(
    gt9x: tuple[Path, ...], lsm9ds1: tuple[Path, ...], tmp_path: Path
) -> None:
    without = write_shift(tmp_path, simulate_shift("gt9x", 0.01, 1), actilife_csv=False)

    assert [path.name for path in gt9x] == [
        "shift_seed1.gt3x", "shift_seed1-IMU.csv", "truth.parquet", "truth.json",
    ]  # fmt: skip
    assert [path.name for path in lsm9ds1] == ["shift_seed1.csv", "truth.parquet", "truth.json"]
    assert [path.suffix for path in without] == [".gt3x", ".parquet", ".json"]


@pytest.mark.parametrize("device", ["gt9x", "lsm9ds1"])
def test_the_same_seed_gives_the_same_bytes(device: Any, tmp_path: Path) -> None:
    once = write_recordings(tmp_path / "once", device, 0.02, 3)
    again = write_recordings(tmp_path / "again", device, 0.02, 3)

    assert [path.read_bytes() for path in once] == [path.read_bytes() for path in again]


def test_a_gt3x_holds_an_uncompressed_log_and_the_device_description(gt9x: tuple[Path, ...]) -> None:
    members = [(member.filename, member.compress_type) for member in zipfile.ZipFile(gt9x[0]).infolist()]

    assert members == [("log.bin", 0), ("info.txt", 0)]


def test_every_second_has_primary_samples_and_all_but_the_last_have_about_a_hundred_rows(
    gt9x: tuple[Path, ...],
) -> None:
    records = split_log(gt9x[0])

    kinds = [kind for kind, _, _ in records]
    times = [time for kind, time, _ in records if kind == 25]
    assert (kinds.count(25), kinds.count(26)) == (180, 181)
    assert kinds.index(24) < kinds.index(25)  # the schema stands before the first rows
    assert times == list(range(times[0], times[0] + 180))
    assert {len(rows) for rows in read_rows(gt9x[0])} == {100, 101}


def test_the_rows_are_the_simulated_counts_in_order_and_the_clock_that_of_the_description(
    gt9x: tuple[Path, ...],
) -> None:
    whole, records = play_shift(SHIFT), split_log(gt9x[0])
    ticks = int(re.findall(rb"Start Date: (\d+)", zipfile.ZipFile(gt9x[0]).read("info.txt"))[0])

    rows = np.concatenate(read_rows(gt9x[0]))
    primary = np.frombuffer(next(payload for kind, _, payload in records if kind == 26), "<i2")[:3]

    assert np.array_equal(rows["acc"] / 2048, whole.acc_g[: len(rows)])
    assert np.abs(rows["gyr"] / 16.384 - whole.gyr_dps[: len(rows)]).max() < 1e-4
    assert np.abs(primary / 256 - rows["acc"][0] / 2048).max() <= 1 / 512  # the same, at lower resolution
    first_s = next(time for kind, time, _ in records if kind == 25)
    assert (ticks - 621355968000000000) / 10_000_000 == first_s


@pytest.mark.real_recordings
def test_schema_and_description_are_those_of_a_real_device(
    gt9x: tuple[Path, ...], shared_data: Callable[[str], Path]
) -> None:
    paths = (gt9x[0], shared_data("gt9x/link_imu_100hz_179s.gt3x"))

    schemas = [[payload for kind, _, payload in split_log(path) if kind == 24] for path in paths]
    ours, real = (
        {line.split(":")[0] for line in zipfile.ZipFile(path).read("info.txt").decode().splitlines()}
        for path in paths
    )

    assert schemas[0] == schemas[1]
    assert ours == real - {"Limb"}


def test_the_export_is_resampled_by_the_rule_of_actilife(gt9x: tuple[Path, ...]) -> None:
    """Written out for each second: value at k n / 100, linear between rows, held at the last."""
    expected = []
    for rows in read_rows(gt9x[0]):
        at = np.minimum(np.arange(100) * len(rows) / 100, len(rows) - 1)
        expected.append([np.interp(at, np.arange(len(rows)), rows["gyr"][:, axis]) for axis in range(3)])

    gyr_dps = read_csv(gt9x[1], 11, range(5, 8))

    assert np.abs(gyr_dps - np.concatenate(expected, axis=1).T / 16.383999).max() <= 5.1e-7


def test_the_stamps_of_the_export_step_by_ten_milliseconds(gt9x: tuple[Path, ...]) -> None:
    lines = gt9x[1].read_text().splitlines()[11:]

    assert len(lines) == 100 * 180
    assert [lines[k].split(",")[0][14:] for k in (0, 1, 99, 100, -1)] == [
        "00:00.0000000", "00:00.0100000", "00:00.9900000", "00:01.0000000", "02:59.9900000",
    ]  # fmt: skip


@pytest.mark.real_recordings
def test_the_export_begins_like_a_real_one(
    gt9x: tuple[Path, ...], shared_data: Callable[[str], Path]
) -> None:
    paths = (gt9x[1], shared_data("gt9x/link_imu_100hz_179s_actilife.csv"))

    ours, real = ([path.read_text().splitlines()[k] for k in (0, 4, 7, 9, 10)] for path in paths)

    assert ours == real


@pytest.mark.parametrize(("value", "printed"), [(0.0078125, 7813), (-0.0078125, -7813), (0.9921875, 992188)])
def test_halves_are_printed_away_from_zero_as_dot_net_does(value: float, printed: int) -> None:
    assert round_to_millionths(np.array([value]))[0] == printed


def test_a_lsm9ds1_file_tells_what_it_is_and_holds_the_simulated_samples(lsm9ds1: tuple[Path, ...]) -> None:
    whole, table = play_shift(OTHER), read_csv(lsm9ds1[0], 5, range(7))
    steps_us = np.diff(table[:, 0])

    assert lsm9ds1[0].read_text().splitlines()[:5] == [
        "# device: LSM9DS1",
        "# start: 2026-03-02T07:00:00",
        "# acc_range_g: 8",
        "# gyr_range_dps: 2000",
        "time_us,acc_x_g,acc_y_g,acc_z_g,gyr_x_dps,gyr_y_dps,gyr_z_dps",
    ]
    assert np.abs(table[:, 1:4] - whole.acc_g).max() < 1e-6
    assert np.abs(table[:, 4:7] - whole.gyr_dps).max() < 1e-4
    # The counter of the logger steps by the true period with a little jitter.
    assert steps_us.mean() == pytest.approx(1e6 / OTHER.rate_hz, abs=0.01)
    assert 1.0 < np.abs(steps_us - 1e6 / OTHER.rate_hz).max() <= 42.0


def test_the_counter_of_the_logger_wraps_at_32_bits(tmp_path: Path) -> None:
    path = write_recordings(tmp_path, "lsm9ds1", 1.3, 1, 20.0)[0]

    counter_us = read_csv(path, 5, range(1))

    assert (np.diff(counter_us) < 0).sum() == 1
    assert counter_us.max() < 2**32


@given(st.lists(st.integers(-(10**12), 10**12), min_size=1, max_size=5), st.integers(1, 7))
@settings(max_examples=40, deadline=None)
def test_numbers_are_written_with_all_their_decimals(values: list[int], decimals: int) -> None:
    out = np.empty(24 * (len(values) + 1), np.uint8)

    size = put_rows(out, NO_STAMPS, np.array([7]), 1, np.array([values]), np.full(len(values), decimals))

    one = 10**decimals
    numbers = [f"{'-' * (v < 0)}{abs(v) // one}.{abs(v) % one:0{decimals}}" for v in values]
    assert out[:size].tobytes().decode() == ",".join(["7", *numbers]) + "\n"


@pytest.mark.parametrize(("rate_hz", "counts"), [(100.0, {100}), (100.09, {100, 101}), (99.9, {99, 100})])
def test_seconds_are_cut_where_the_clock_says(rate_hz: float, counts: set[int]) -> None:
    cutter = SecondCutter(rate_hz)

    seconds = [cutter.cut(np.zeros(997, ROW)).counts for _ in range(12)]

    assert set(np.concatenate(seconds).tolist()) == counts
    assert abs(len(np.concatenate(seconds)) - 12 * 997 / rate_hz) < 1.0


def test_the_truth_lies_on_sample_instants_at_most_a_hundred_times_a_second(
    lsm9ds1: tuple[Path, ...],
) -> None:
    truth = pq.read_table(lsm9ds1[1])

    assert np.array_equal(truth["time_s"].to_numpy(), np.arange(0, OTHER.sample_count, 5) / OTHER.rate_hz)
    assert np.array_equal(truth["elevation_deg"].to_numpy(), play_shift(OTHER).elevation_deg[::5])


def test_the_true_exposure_adds_up_and_agrees_with_the_angles(gt9x: tuple[Path, ...]) -> None:
    truth, elevation_deg = json.loads(gt9x[3].read_text()), play_shift(SHIFT).elevation_deg

    assert sum(truth["exposure"]["bin_percent"]) == pytest.approx(100.0)
    assert truth["exposure"]["above_percent"][1] == pytest.approx(100.0 * (elevation_deg >= 60.0).mean())
    assert truth["sensor"]["gyr_offset_dps"] == SHIFT.errors.gyr_offset_dps.tolist()
    assert pq.read_table(gt9x[2]).num_rows == SHIFT.sample_count


@pytest.mark.parametrize(
    ("angles_deg", "entries"),
    [([70, 0, 70], 1), ([0, 62, 0], 0), ([0, 70, 58, 70], 1), ([0, 70, 54, 70], 2), ([70], 0)],
)
def test_true_entries_have_ten_degrees_of_hysteresis_from_block_to_block(
    angles_deg: list[float], entries: int
) -> None:
    first, state = count_entries(np.array(angles_deg[:2], float), 60.0, -1)

    assert first + count_entries(np.array(angles_deg[2:], float), 60.0, state)[0] == entries
