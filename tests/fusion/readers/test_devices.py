"""Layouts of known devices, made of one motion: each is read unaided, to the same samples."""

import gzip
import io
import re
from datetime import UTC
from functools import cache

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from acromion.fusion.devices import KNOWN_DEVICES, find_device_name, find_known_device
from acromion.fusion.errors import NoGravity, SeveralSensors, UnknownRate
from acromion.fusion.readers import ColumnProfile, identify_header, read_recording
from acromion.fusion.readers.preview import Preview, preview_head
from acromion.fusion.recording import STANDARD_GRAVITY, Recording
from tests.fusion.readers.device_layouts import (
    ACC_G,
    ACC_MS2,
    GYR_DPS,
    GYR_RAD,
    MOTION,
    RATE_HZ,
    START_S,
    TABLES,
    TIME_S,
    axes,
    mt_manager,
    pack,
    rows,
    sensor_logger,
    shimmer,
)
from tests.fusion.readers.seen import codes, counts
from tests.fusion.readers.tables.table_builder import read_text


@cache
def read_layout(name: str) -> Recording:
    content = TABLES[name]()
    return read_text(content, "arm.zip" if isinstance(content, bytes) else "arm.csv")


@pytest.mark.parametrize("name", TABLES)
def test_every_layout_is_read_unaided_to_the_same_samples(name: str) -> None:
    recording = read_layout(name)

    (segment,) = recording.segments
    changes = [
        flag.facts["evidence"] for flag in recording.flags if flag.code in ("W-UNITS", "W-ROWS-DROPPED")
    ]
    np.testing.assert_allclose(segment.acc_g, ACC_G, atol=2e-6)
    np.testing.assert_allclose(segment.gyr_dps, GYR_DPS, atol=1e-4)
    assert segment.rate_hz == pytest.approx(RATE_HZ, abs=1e-3)
    assert set(changes) <= ({"rest", "motion"} if name == "serial monitor" else set())


@pytest.mark.parametrize("name", ["shimmer", "witmotion", "picoquake", "mtw", "dot", "phyphox", "metawear"])
def test_the_device_is_known_by_its_header(name: str) -> None:
    assert read_layout(name).device == name


@pytest.mark.parametrize(
    "name", ["phyphox", "sensorlogger", "metawear", "shimmer", "excel days", "witmotion"]
)
def test_the_start_is_that_of_the_files_own_clock(name: str) -> None:
    start = read_layout(name).start

    assert start is not None
    assert start.replace(tzinfo=UTC).timestamp() == pytest.approx(START_S, abs=0.001)
    assert (start.tzinfo is None) == (name in ("excel days", "witmotion"))


def test_a_row_of_units_that_gives_the_time_another_quantity_is_no_crash() -> None:
    damaged = shimmer().replace("\nms\t", "\nm/(s^2)\t")

    (segment,) = read_text(damaged, "arm.csv").segments

    assert segment.rate_hz == pytest.approx(RATE_HZ)


def test_a_coarse_day_of_a_spreadsheet_is_spread_over_its_rows() -> None:
    days = 25_569 + (START_S + TIME_S) / 86_400
    table = rows(days, ACC_G, GYR_DPS, form="%.5f")  # as a spreadsheet shows it: 0.86 s a step

    recording = read_text("time," + ",".join(axes("Acc{} (g)") + axes("Gyr{} (dps)")) + "\n" + table)

    assert recording.rate_hz == pytest.approx(RATE_HZ, rel=0.01)


def test_acceleration_without_gravity_is_refused_with_that_cause() -> None:
    with pytest.raises(NoGravity):
        read_text(sensor_logger(("Accelerometer",)), "arm.zip")


@pytest.mark.parametrize("name", ["phyphox", "sensorlogger", "metawear"])
@pytest.mark.parametrize("head_bytes", [2000, 65_536])
def test_a_zip_is_not_refused_before_its_second_table_has_come(name: str, head_bytes: int) -> None:
    content = TABLES[name]()
    assert isinstance(content, bytes)

    assert preview_head(content[:head_bytes], "arm.zip") == Preview()


def read_pair(acceleration: str, angular_rate: str) -> Recording:
    """Read a zip of two tables of these rows."""
    names = '"Time (s)","X ({0})","Y ({0})","Z ({0})"\n'
    content = pack(
        Accelerometer=names.format("m/s^2") + acceleration, Gyroscope=names.format("rad/s") + angular_rate
    )
    return read_text(content, "arm.zip")


def test_a_hole_of_the_accelerometer_is_a_hole_of_both() -> None:
    kept = (TIME_S < 10.0) | (TIME_S >= 12.0)

    recording = read_pair(rows(TIME_S[kept], ACC_MS2[kept]), rows(TIME_S, GYR_RAD))

    assert [len(segment) for segment in recording.segments] == [1000, 1800]


def test_a_last_line_that_was_torn_off_costs_one_row() -> None:
    recording = read_pair(rows(TIME_S, ACC_MS2), rows(TIME_S, GYR_RAD) + "30.0,0.01,-0.")

    assert counts(recording) == [("W-TRUNC-TAIL", 1)]
    assert len(recording.segments[0]) == len(TIME_S)


def test_tables_read_at_different_moments_are_laid_on_the_gyroscopes_times() -> None:
    recording = read_pair(rows(TIME_S - 0.004, ACC_MS2), rows(TIME_S, GYR_RAD))

    between = 0.6 * ACC_G[:-1] + 0.4 * ACC_G[1:]
    np.testing.assert_allclose(recording.segments[0].acc_g, between, atol=2e-6)


TURNED = np.array([-1.0, -1.0, 1.0])
TWO_SENSORS = (
    "sensor," + ",".join(["left"] * 6 + ["right"] * 6) + "\ntime_s,"
    + ",".join(2 * ["acc_x", "acc_y", "acc_z", "gyr_x", "gyr_y", "gyr_z"]) + "\n"
    + rows(TIME_S, ACC_G, GYR_DPS, ACC_G * TURNED, GYR_DPS * TURNED)
)  # fmt: skip


def read_sensor(table: str, sensor: str) -> Recording:
    profile = ColumnProfile(sensor=sensor) if sensor else None
    return read_recording(io.BytesIO(table.encode()), file_name="two.csv", profile=profile)


@pytest.mark.parametrize(("sensor", "wanted"), [("", {}), ("chest", {"wanted": "chest"})])
def test_a_table_of_several_sensors_asks_which_one(sensor: str, wanted: dict[str, str]) -> None:
    with pytest.raises(SeveralSensors) as refusal:
        read_sensor(TWO_SENSORS, sensor)

    assert refusal.value.facts == {"n": 2, "list": "left, right", **wanted}


def test_a_column_of_marks_leaves_the_rows_of_remarks_and_units_readable() -> None:
    """Shimmer writes `Pulse` and `Boolean` in the last columns."""
    names = [f"{part} {axis}" for part in ("Gyroscope", "Accelerometer") for axis in "XYZ"]
    heads = [
        ["Arm"] * 7 + ["Annotation"],
        ["Timestamp", *names, "Pulse"],
        ["CAL"] * 7 + ["Pulse"],
        ["mSecs"] + ["rad/sec"] * 3 + ["m/(sec^2)"] * 3 + ["Boolean"],
    ]
    table = "".join("\t".join(line) + "\n" for line in heads)

    recording = read_text(table + rows(TIME_S * 1e3, GYR_RAD, ACC_MS2, 0.0 * TIME_S, mark="\t"))

    assert codes(recording) == []
    np.testing.assert_allclose(recording.segments[0].gyr_dps, GYR_DPS, atol=1e-4)


def test_the_sensor_that_is_named_is_read() -> None:
    recording = read_sensor(TWO_SENSORS, "right")

    np.testing.assert_allclose(recording.segments[0].acc_g, ACC_G * TURNED, atol=2e-6)


def test_the_sensor_may_stand_in_the_names() -> None:
    axes = ("ax", "ay", "az", "gx", "gy", "gz")
    names = [f"{sensor}_{name}" for sensor in ("wrist", "upper_arm") for name in axes]
    values = rows(TIME_S, ACC_G * TURNED, GYR_DPS * TURNED, ACC_G, GYR_DPS)

    recording = read_sensor(",".join(["time_s", *names]) + "\n" + values, "upper arm")

    np.testing.assert_allclose(recording.segments[0].gyr_dps, GYR_DPS, atol=1e-4)


def test_a_count_of_rows_is_no_time() -> None:
    count = [str(k) for k in range(len(TIME_S))]
    table = (
        "Timestamp," + ",".join(axes("Acc{} (g)") + axes("Gyr{} (dps)")) + "\n" + rows(count, ACC_G, GYR_DPS)
    )

    with pytest.raises(UnknownRate):
        read_text(table)


def test_an_unreadable_date_is_left_aside_where_another_column_tells_the_time() -> None:
    words = ["Mon Mar  2 07:58:00 2026"] * len(TIME_S)
    names = ["Timestamp", "Timestamp (ms)", *axes("Acc{} (g)"), *axes("Gyr{} (dps)")]
    table = ",".join(names) + "\n" + rows(words, TIME_S * 1e3, ACC_G, GYR_DPS)

    assert read_text(table).rate_hz == pytest.approx(RATE_HZ)


def test_what_the_header_states_goes_before_the_devices_entry() -> None:
    table = mt_manager().replace("Gyr_X\tGyr_Y\tGyr_Z", "Gyr_X (deg/s)\tGyr_Y (deg/s)\tGyr_Z (deg/s)")

    recording = read_text(table)

    assert recording.understood["angular_rate_unit"] == "deg/s"


def test_every_entry_says_how_it_is_recognised_and_where_it_was_seen() -> None:
    for device in KNOWN_DEVICES:
        assert device.source
        assert device.header or device.above or device.form in ("binary", "capture")


def test_an_unknown_header_is_nobodys() -> None:
    assert find_known_device("time_s,ax,ay,az,gx,gy,gz") is None


def test_a_device_has_one_name_however_its_files_are_written() -> None:
    assert find_device_name("gt9x") == "ActiGraph GT9X Link"
    assert find_device_name("other") is None


STEP_G = 0.3 * GYR_DPS / np.abs(GYR_DPS).max()
"""An acceleration of the arm's own."""
UP = MOTION.up


def core_motion(names: tuple[str, ...], per_g: float = 1.0, user_g: np.ndarray = STEP_G) -> str:
    """A table of both vectors as Core Motion has them, of the opposite sign to an accelerometer's."""
    heads = [axes("rotationRate{}"), *map(axes, names)]
    parts = [-UP * per_g, -user_g * per_g][-len(names) :]
    values = rows(START_S * 1e9 + TIME_S * 1e9, TIME_S, GYR_RAD, *parts, form="%.7f")
    return "time,seconds_elapsed," + ",".join(name for head in heads for name in head) + "\n" + values


@pytest.mark.parametrize(
    ("names", "per_g", "user_g"),
    [
        (("gravity{}", "acceleration{}"), 1.0, STEP_G),
        (("gravity.{}", "userAcceleration.{}"), 1.0, STEP_G),
        (("grav_{}", "userAcc_{}"), 1.0, STEP_G),
        (("gravity{}", "acceleration{}"), -STANDARD_GRAVITY, STEP_G),
        (("gravity{}", "acceleration{}"), -STANDARD_GRAVITY, UP + STEP_G),
    ],
    ids=["Core Motion", "dots", "short names", "m/s2: the other sign", "gravity was never taken out"],
)
def test_gravity_beside_an_acceleration_without_it_is_put_back(
    names: tuple[str, str], per_g: float, user_g: np.ndarray
) -> None:
    (segment,) = read_text(core_motion(names, per_g, user_g), "watch.csv").segments

    np.testing.assert_allclose(segment.acc_g, UP + STEP_G, atol=2e-6)


@pytest.mark.parametrize("stated", ["header", "profile"])
def test_an_acceleration_may_have_another_unit_than_gravity(stated: str) -> None:
    unit = " (m/s^2)" if stated == "header" else ""
    heads = ["time_s", *axes("gyr{}_dps"), *axes("gravity{}"), *axes("userAcc{}" + unit)]
    text = ",".join(heads) + "\n" + rows(TIME_S, GYR_DPS, UP, STEP_G * STANDARD_GRAVITY)
    named = ColumnProfile((8, 9, 10), (2, 3, 4), "m/s2", "dps", time=1) if stated == "profile" else None

    (segment,) = read_recording(io.BytesIO(text.encode()), profile=named).segments

    np.testing.assert_allclose(segment.acc_g, UP + STEP_G, atol=2e-6)


def test_rows_without_gravity_are_left_out() -> None:
    lines = core_motion(("gravity{}", "acceleration{}")).splitlines()
    fields = [line.split(",") for line in lines[1001:1201]]
    lines[1001:1201] = [",".join([*row[:5], "", "", "", *row[8:]]) for row in fields]

    recording = read_text("\n".join(lines) + "\n", "watch.csv")

    assert [len(segment) for segment in recording.segments] == [1000, 1800]


@pytest.mark.parametrize("name", ["acceleration{}", "userAcceleration{}"])
def test_an_acceleration_without_gravity_or_its_columns_is_refused_as_such(name: str) -> None:
    with pytest.raises(NoGravity):
        read_text(core_motion((name,)), "watch.csv")


def test_columns_called_gravity_that_hold_none_do_not_help() -> None:
    header, values = core_motion(("gravity{}", "userAcceleration{}")).split("\n", 1)
    zeros = re.sub(r"^((?:[^,]*,){5})[^,]*,[^,]*,[^,]*,", r"\g<1>0,0,0,", values, flags=re.MULTILINE)

    with pytest.raises(NoGravity):
        read_text(f"{header}\n{zeros}", "watch.csv")


@pytest.mark.parametrize("unit", ["", " (g)"])
def test_an_acceleration_that_reads_nothing_at_rest_has_no_gravity(unit: str) -> None:
    heads = [*axes("Acc{}" + unit), *axes("Gyr{} (dps)")]

    with pytest.raises(NoGravity):
        read_text("time_s," + ",".join(heads) + "\n" + rows(TIME_S, STEP_G, GYR_DPS))


def test_parquet_puts_gravity_back_too() -> None:
    names = [*axes("acceleration{}"), *axes("gravity{}"), *axes("rotationRate{} (rad/s)")]
    values = np.concatenate([-STEP_G, -UP, GYR_RAD], axis=1)
    columns = {"time_s": TIME_S, **dict(zip(names, values.T, strict=True))}
    file = io.BytesIO()
    pq.write_table(pa.table(columns), file)

    (segment,) = read_recording(file).segments

    np.testing.assert_allclose(segment.acc_g, UP + STEP_G, atol=2e-6)


# The identity of a table's header: the same names in the same order, whatever the rows hold.

HEADER = "t;a;b;c;d;e;f"


def write_table(header: str, first: int = 0, delimiter: str = ";") -> bytes:
    rows = [f"{10 * k};0.0{k % 9};0.0;1.0;0.1;0.2;0.3" for k in range(first, first + 300)]
    return "\n".join([*([header] if header else []), *rows]).replace(";", delimiter).encode()


def identify(content: bytes) -> str:
    return identify_header(io.BytesIO(content))


@pytest.mark.parametrize(
    "content",
    [
        write_table(HEADER, 500),
        b"# serial: A1\n" + write_table(HEADER),
        gzip.compress(write_table(HEADER)),
    ],
    ids=["other rows", "lines before the header", "packed"],
)
def test_only_the_header_counts(content: bytes) -> None:
    assert identify(content) == identify(write_table(HEADER))


@pytest.mark.parametrize(
    ("header", "delimiter"), [("t;b;a;c;d;e;f", ";"), ("t;a;b;c;d;e;g", ";"), (HEADER, ",")]
)
def test_another_name_order_or_delimiter_is_another_header(header: str, delimiter: str) -> None:
    assert identify(write_table(header, delimiter=delimiter)) != identify(write_table(HEADER))


def test_a_table_without_names_is_known_by_a_dash() -> None:
    assert identify(write_table("")).startswith("-")
    assert not identify(write_table(HEADER)).startswith("-")


@pytest.mark.parametrize("content", [b"", b"not a table", b"\x89PNG\r\n"])
def test_what_is_no_table_has_none(content: bytes) -> None:
    assert identify(content) == ""
