"""Archives: which of their files is the recording, and which files are left aside."""

import io
import struct
import zipfile
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from acromion.fusion.errors import (
    CorruptArchive,
    FusionError,
    NoGyroscope,
    NoPair,
    NoSamples,
    SeveralSensors,
    UnreadableRows,
    UnsafeArchive,
    UnusableProfile,
    UnusableTime,
)
from acromion.fusion.readers import ColumnProfile, read_recording
from acromion.fusion.readers.tables.profile import propose_file_profile
from acromion.fusion.recording import Recording
from tests.fusion.readers.device_layouts import ACC_G, GYR_DPS, GYR_RAD, START_S, TIME_S, axes, metawear, rows
from tests.fusion.readers.seen import codes
from tests.fusion.readers.tables.table_builder import CANON

UP_G = np.tile([0.0, 0.0, 1.0], (len(TIME_S), 1))


def pack(members: dict[str, str | bytes]) -> io.BytesIO:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return packed


def watch() -> str:
    heads = [*axes("rotationRate{}"), *axes("gravity{}"), *axes("acceleration{}")]
    values = rows(START_S * 1e9 + TIME_S * 1e9, TIME_S, GYR_RAD, -UP_G, UP_G - ACC_G, form="%.7f")
    return "time,seconds_elapsed," + ",".join(heads) + "\n" + values


def sensor_table(values: np.ndarray, unit: str = "", time: str = "time_s") -> str:
    heads = [f"{axis}{unit}" for axis in ("X", "Y", "Z")]
    return f"{time}," + ",".join(heads) + "\n" + rows(TIME_S, values)


def read_archive(members: dict[str, str | bytes], sensor: str = "") -> Recording:
    profile = ColumnProfile(sensor=sensor) if sensor else None
    return read_recording(pack(members), file_name="arm.zip", profile=profile)


PHONE_AND_WATCH: dict[str, str | bytes] = {
    "WristMotion.csv": watch(),
    "TotalAcceleration.csv": sensor_table(ACC_G[::-1] * 9.80665, " (m/s^2)"),
    "Gyroscope.csv": sensor_table(-GYR_RAD[::-1], " (rad/s)"),
    "Metadata.csv": "version,device name\n3,phone\n",
}


def test_two_devices_of_an_archive_are_named_and_offered() -> None:
    with pytest.raises(SeveralSensors) as refusal:
        read_archive(PHONE_AND_WATCH)

    assert refusal.value.facts == {"n": 2, "list": "WristMotion, TotalAcceleration"}
    assert propose_file_profile(pack(PHONE_AND_WATCH)).sensors == ("WristMotion", "TotalAcceleration")


def test_the_device_that_a_person_names_is_read() -> None:
    (watch_run,) = read_archive(PHONE_AND_WATCH, "WristMotion").segments
    (phone_run,) = read_archive(PHONE_AND_WATCH, "TotalAcceleration").segments

    np.testing.assert_allclose(watch_run.acc_g, ACC_G, atol=2e-6)
    np.testing.assert_allclose(phone_run.acc_g, ACC_G[::-1], atol=2e-6)


def test_a_device_that_the_archive_does_not_hold_is_refused_by_its_name() -> None:
    with pytest.raises(SeveralSensors) as refusal:
        read_archive(PHONE_AND_WATCH, "Headphone")

    assert refusal.value.facts["wanted"] == "Headphone"


@pytest.mark.parametrize(
    ("acceleration", "angular_rate"),
    [
        ("Polar_Sense_AB12_20260302_070000_ACC.txt", "Polar_Sense_AB12_20260302_070001_GYRO.txt"),
        ("MetaWear_2026_C2B2_Accelerometer_100.000Hz.csv", "MetaWear_2026_C2B2_Gyroscope_100.000Hz.csv"),
        ("data/first.csv", "data/second.csv"),
    ],
)
def test_two_tables_are_a_pair_by_their_names_or_columns(acceleration: str, angular_rate: str) -> None:
    members: dict[str, str | bytes] = {
        acceleration: sensor_table(ACC_G, " (g)"),
        angular_rate: sensor_table(GYR_DPS, " (deg/s)"),
        "Polar_Sense_AB12_20260302_070000_MAGN.txt": sensor_table(ACC_G, " (G)"),
    }

    recording = read_archive(members)

    np.testing.assert_allclose(recording.segments[0].acc_g, ACC_G, atol=2e-6)
    assert recording.understood["left_aside"] == "1"


@pytest.mark.parametrize(
    ("acceleration", "angular_rate"),
    [
        (("ax", "ay", "az"), ("gx", "gy", "gz")),
        (("accX (g)", "accY (g)", "accZ (g)"), ("gyroX (deg/s)", "gyroY (deg/s)", "gyroZ (deg/s)")),
        (("accelerometerX", "accelerometerY", "accelerometerZ"), ("gyroX", "gyroY", "gyroZ")),
    ],
)
def test_two_tables_are_a_pair_by_columns_that_name_the_sensor(
    acceleration: tuple[str, ...], angular_rate: tuple[str, ...]
) -> None:
    tables: dict[str, str | bytes] = {
        "one.csv": f"time_s,{','.join(acceleration)}\n{rows(TIME_S, ACC_G)}",
        "two.csv": f"time_s,{','.join(angular_rate)}\n{rows(TIME_S, GYR_DPS)}",
    }

    (run,) = read_archive(tables).segments

    np.testing.assert_allclose(run.acc_g, ACC_G, atol=2e-6)
    np.testing.assert_allclose(run.gyr_dps, GYR_DPS, atol=1e-3)


def test_two_pairs_are_two_devices() -> None:
    members: dict[str, str | bytes] = {
        f"{side}_{name}.csv": sensor_table(values, unit)
        for side in ("left", "right")
        for name, values, unit in (("Accelerometer", ACC_G, " (g)"), ("Gyroscope", GYR_DPS, " (deg/s)"))
    }

    with pytest.raises(SeveralSensors) as refusal:
        read_archive(members)

    assert refusal.value.facts["list"] == "left, right"
    np.testing.assert_allclose(read_archive(members, "left").segments[0].acc_g, ACC_G, atol=2e-6)


def test_tables_of_one_name_are_offered_with_their_folders() -> None:
    members: dict[str, str | bytes] = {
        f"{side}/imu.csv": f"time_s,{','.join(axes('acc_{}_g'))},{','.join(axes('gyr_{}_dps'))}\n"
        + rows(TIME_S, values, GYR_DPS)
        for side, values in (("left", ACC_G), ("right", -ACC_G))
    }

    with pytest.raises(SeveralSensors) as refusal:
        read_archive(members)

    assert refusal.value.facts["list"] == "left/imu, right/imu"
    np.testing.assert_allclose(read_archive(members, "left/imu").segments[0].acc_g, ACC_G, atol=2e-6)
    np.testing.assert_allclose(read_archive(members, "right/imu").segments[0].acc_g, -ACC_G, atol=2e-6)


ACC, OTHER_ACC = sensor_table(ACC_G, " (g)"), sensor_table(ACC_G[::-1], " (g)")
GYR = sensor_table(GYR_DPS, " (deg/s)")


@pytest.mark.parametrize(
    ("phone", "watch"),
    [
        (("Phones_accelerometer.csv", "Phones_gyroscope.csv"), ("Watch_accelerometer.csv",)),
        (("ear_acc_left.csv", "ear_gyro_left.csv"), ("wrist_acc.csv",)),
        (("Accelerometer.csv", "Gyroscope.csv"), ("WatchAccelerometer.csv",)),
        (("ACC.csv", "GYR.csv"), ("ACC2.csv",)),
    ],
)
def test_an_accelerometer_of_another_device_beside_a_pair_is_named(
    phone: tuple[str, str], watch: tuple[str]
) -> None:
    recording = read_archive({phone[0]: ACC, watch[0]: OTHER_ACC, phone[1]: GYR})

    np.testing.assert_allclose(recording.segments[0].acc_g, ACC_G, atol=2e-6)
    assert recording.understood["left_aside"] == f"1: {watch[0]}"


def test_a_person_chooses_the_acceleration_that_goes_with_the_only_angular_rate() -> None:
    members: dict[str, str | bytes] = {"first.csv": OTHER_ACC, "second.csv": GYR, "third.csv": ACC}

    with pytest.raises(SeveralSensors) as refusal:
        read_archive(members)

    assert refusal.value.facts["list"] == "first, third"
    np.testing.assert_allclose(read_archive(members, "third").segments[0].acc_g, ACC_G, atol=2e-6)


@pytest.mark.parametrize(
    ("form", "devices", "listed"),
    [
        (
            "raw/{0}/{1}/data_1600_{1}_{0}.txt",
            ("phone", "watch"),
            "raw phone data_1600_phone, raw watch data_1600_watch",
        ),
        ("{1}_walking_{0}.csv", ("upperarm", "chest"), "walking_upperarm, walking_chest"),
        ("Polar_Sense_{0}_20260302_07000{2}_{1}.txt", ("AB12", "CD34"), "Polar_Sense_AB12, Polar_Sense_CD34"),
        ("{1}{0}.csv", ("1", "2"), "acc1, acc2"),
    ],
)
def test_devices_are_told_apart_by_what_is_left_of_the_names(
    form: str, devices: tuple[str, str], listed: str
) -> None:
    members: dict[str, str | bytes] = {
        form.format(device, word, second): table
        for device in devices
        for second, (word, table) in enumerate((("acc", ACC), ("gyro", GYR)))
    }

    with pytest.raises(SeveralSensors) as refusal:
        read_archive(members)

    assert refusal.value.facts["list"] == listed


@pytest.mark.parametrize(
    ("names", "error", "facts"),
    [
        (("wrist_acc.csv", "chest_acc.csv"), NoGyroscope, {"cure": "both in the zip"}),
        (
            ("Gyroscope.csv", "Magnetometer.csv"),
            NoPair,
            {"why": "one sensor", "cure": "one sensor", "list": "Gyroscope.csv"},
        ),
    ],
)
def test_tables_that_are_no_pair_are_refused_by_what_is_missing(
    names: tuple[str, str], error: type[FusionError], facts: dict[str, str]
) -> None:
    with pytest.raises(error) as refusal:
        read_archive({names[0]: ACC, names[1]: GYR})

    assert refusal.value.facts == facts


@pytest.mark.parametrize(
    ("acceleration", "angular_rate"),
    [
        ("left_ACC.csv", "right_GYRO.csv"),
        ("phone/Accelerometer.csv", "watch/Gyroscope.csv"),
        ("MetaWear_C2B2_Accelerometer_100Hz.csv", "MetaWear_D4A1_Gyroscope_100Hz.csv"),
        ("Movesense_174630000192_acc.csv", "Movesense_174630000193_gyro.csv"),
        ("Polar_H10_acc.csv", "Polar_Sense_gyro.csv"),
        ("AB12.csv", "CD34.csv"),
    ],
)
def test_tables_named_after_two_devices_are_no_pair(acceleration: str, angular_rate: str) -> None:
    with pytest.raises(NoPair) as refusal:
        read_archive({acceleration: ACC, angular_rate: GYR})

    assert refusal.value.facts == {
        "why": "tables apart",
        "cure": "tables apart",
        "list": f"{acceleration}, {angular_rate}",
    }


@pytest.mark.parametrize(
    "form", ["{0}_2026-03-02_07-00-0{1}.csv", "20260302T07000{1}_{0}.csv", "177243828{1}255_{0}.csv"]
)
def test_two_tables_may_be_named_after_the_second_at_which_each_began(form: str) -> None:
    recording = read_archive({form.format("acc", 0): ACC, form.format("gyro", 1): GYR})

    np.testing.assert_allclose(recording.segments[0].acc_g, ACC_G, atol=2e-6)


def test_a_person_chooses_the_angular_rate_that_goes_with_the_only_acceleration() -> None:
    other = sensor_table(-GYR_DPS, " (deg/s)")
    members: dict[str, str | bytes] = {"acc.csv": ACC, "gyr_one.csv": other, "gyr_two.csv": GYR}

    with pytest.raises(SeveralSensors) as refusal:
        read_archive(members)

    assert refusal.value.facts["list"] == "gyr_one, gyr_two"
    np.testing.assert_allclose(read_archive(members, "gyr_two").segments[0].gyr_dps, GYR_DPS, atol=1e-3)


def test_several_recordings_of_one_device_are_refused_as_such() -> None:
    members: dict[str, str | bytes] = {
        f"arm_20260302_{hour}0000_{name}.csv": table
        for hour in ("07", "08")
        for name, table in (("acc", ACC), ("gyro", GYR))
    }

    with pytest.raises(NoPair) as refusal:
        read_archive(members)

    assert refusal.value.facts["why"] == "tables twice"


WHOLE = f"time_s,{','.join(axes('acc_{}_g'))},{','.join(axes('gyr_{}_dps'))}\n{rows(TIME_S, ACC_G, GYR_DPS)}"


def test_a_name_that_the_only_recording_does_not_have_is_refused() -> None:
    pair: dict[str, str | bytes] = {"arm_acc.csv": ACC, "arm_gyro.csv": GYR}
    with pytest.raises(SeveralSensors) as refusal:
        read_archive(pair, "leg")
    with pytest.raises(UnusableProfile) as unnamed:
        read_archive({"shift.csv": WHOLE}, "leg")

    assert refusal.value.facts == {"n": 1, "list": "arm", "wanted": "leg"}
    assert unnamed.value.facts["why"] == "one sensor, unnamed"
    np.testing.assert_allclose(read_archive(pair, "arm").segments[0].acc_g, ACC_G, atol=2e-6)


def test_linear_acceleration_and_gravity_are_added() -> None:
    members: dict[str, str | bytes] = {
        "Linear Acceleration.csv": sensor_table((ACC_G - UP_G) * 9.80665, " (m/s^2)"),
        "Gravity.csv": sensor_table(UP_G * 9.80665, " (m/s^2)"),
        "Gyroscope.csv": sensor_table(GYR_RAD, " (rad/s)"),
    }

    np.testing.assert_allclose(read_archive(members).segments[0].acc_g, ACC_G, atol=2e-6)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_gravity_beside_an_acceleration_that_includes_it_is_not_added(sign: float) -> None:
    members: dict[str, str | bytes] = {
        "WatchAccelerometer.csv": ACC,
        "WatchGravity.csv": sensor_table(sign * UP_G, " (g)"),
        "WatchGyroscope.csv": GYR,
    }

    np.testing.assert_allclose(read_archive(members).segments[0].acc_g, ACC_G, atol=2e-6)


def test_files_that_a_computer_puts_beside_a_recording_are_left_aside_and_counted() -> None:
    sidecars = ["p01/.DS_Store", "__MACOSX/p01/._shift.csv", "desktop.ini", "p01/~$shift.csv", "._x.csv"]

    recording = read_archive({"p01/shift.csv": CANON, **dict.fromkeys(sidecars, b"\0Mac")})

    assert recording.duration_us == 20_000_000
    assert recording.understood["left_aside"] == "5"


def test_two_files_that_are_no_recordings_are_still_several() -> None:
    with pytest.raises(UnsafeArchive) as refusal:
        read_archive({"a.csv": "1,2\n3,4\n", "b.csv": "1,2\n3,4\n"})

    assert refusal.value.facts["reason"] == "several"


def test_rows_that_arrive_three_at_a_time_are_spread_in_two_tables_too() -> None:
    """100 Hz, each burst under the time of its last row: 30 s hold 3000 rows."""
    late = np.repeat(TIME_S[2::3], 3)
    table = "epoch (ms),x-axis ({0}),y-axis ({0}),z-axis ({0})\n"
    stamps = 1000.0 * (START_S + late)
    members: dict[str, str | bytes] = {
        f"arm_{name}_100Hz.csv": table.format(unit) + rows(stamps, values)
        for name, unit, values in (("Accelerometer", "g", ACC_G), ("Gyroscope", "deg/s", GYR_DPS))
    }

    recording = read_archive(members)

    (segment,) = recording.segments
    assert segment.rate_hz == pytest.approx(100.0, abs=0.01)
    np.testing.assert_allclose(segment.gyr_dps, GYR_DPS, atol=1e-3)
    np.testing.assert_allclose(segment.acc_g, ACC_G, atol=0.02)
    assert "W-ROWS-DROPPED" not in codes(recording)


@pytest.mark.parametrize(
    ("acc_rows", "gyr_rows"), [(10, 25), (10, 1), (1, 25)], ids=["both", "accelerometer", "gyroscope"]
)
def test_bursts_of_different_sizes_are_not_shifted_against_each_other(acc_rows: int, gyr_rows: int) -> None:
    """At 100 Hz, each burst has the time of its last row."""
    members: dict[str, str | bytes] = {
        name: f"time_s,X ({unit}),Y ({unit}),Z ({unit})\n"
        + rows(np.repeat(TIME_S[size - 1 :: size], size), values)
        for name, unit, values, size in (
            ("acc.csv", "g", ACC_G, acc_rows),
            ("gyr.csv", "deg/s", GYR_DPS, gyr_rows),
        )
    }

    (run,) = read_archive(members).segments

    np.testing.assert_allclose(run.acc_g, ACC_G, atol=1e-4)
    np.testing.assert_allclose(run.gyr_dps, GYR_DPS, atol=1e-3)


@pytest.mark.parametrize("stamped", [0, 3], ids=["first", "last"])
def test_four_rows_of_a_hundred_with_one_stamp_cost_nothing(stamped: int) -> None:
    shared = TIME_S.copy()
    for first in range(40, len(shared), 100):
        shared[first : first + 4] = shared[first + stamped]
    members: dict[str, str | bytes] = {
        "acc.csv": "time_s,X (g),Y (g),Z (g)\n" + rows(shared, ACC_G),
        "gyr.csv": "time_s,X (deg/s),Y (deg/s),Z (deg/s)\n" + rows(shared, GYR_DPS),
    }

    recording = read_archive(members)

    np.testing.assert_allclose(recording.segments[0].acc_g, ACC_G, atol=1e-4)
    assert codes(recording) == []


def test_an_accelerometer_slower_than_the_gyroscope_is_named() -> None:
    slow = slice(None, None, 4)
    heads = "time_s," + ",".join(axes("{}"))
    members: dict[str, str | bytes] = {
        "Accelerometer.csv": heads.replace("X", "X (g)") + "\n" + rows(TIME_S[slow], ACC_G[slow]),
        "Gyroscope.csv": sensor_table(GYR_DPS, " (deg/s)"),
    }

    (flag,) = [flag for flag in read_archive(members).flags if flag.code == "W-ACC-RATE"]

    assert flag.facts == {"acc_hz": 25.0, "gyr_hz": 100.0}


def test_a_table_with_times_of_a_calendar_only_is_half_of_a_pair() -> None:
    clock = [f"2026-03-02T07:00:{t:06.3f}" for t in TIME_S]
    heads = "time," + ",".join(axes("{}"))
    members: dict[str, str | bytes] = {
        "ACC.csv": heads.replace("X", "X (g)") + "\n" + rows(clock, ACC_G),
        "GYR.csv": heads.replace("X", "X (deg/s)") + "\n" + rows(clock, GYR_DPS),
    }

    recording = read_archive(members)

    assert f"{recording.start:%Y-%m-%d %H:%M}" == "2026-03-02 07:00"
    np.testing.assert_allclose(recording.segments[0].acc_g, ACC_G, atol=2e-6)


CLOCK = [datetime(2026, 3, 25, 23, 59, 52, 250_000, UTC) + timedelta(seconds=t) for t in TIME_S]
"""Midnight comes after seven seconds."""


def write_clock(form: str) -> list[str]:
    return [f"{moment:{form.replace('%L', f'{moment.microsecond // 1000:03d}')}}" for moment in CLOCK]


@pytest.mark.parametrize(
    ("times", "start", "mark"),
    [
        (("%H:%M:%S.%L",), None, ","),
        (("%Y-%m-%d", "%H:%M:%S.%L"), "2026-03-25T23:59:52.250000", ","),
        (("%d.%m.%Y %H:%M:%S,%L",), "2026-03-25T23:59:52.250000", ";"),
        (("%Y-%m-%dT%H:%M:%S.%L+01:00",), "2026-03-25T23:59:52.250000+01:00", ","),
    ],
    ids=["time of day", "two columns", "day first", "offset"],
)
def test_dates_and_times_of_any_form_are_the_time_of_two_tables(
    times: tuple[str, ...], start: str | None, mark: str
) -> None:
    stamps = [write_clock(form) for form in times]
    names = mark.join(["date", "time"][-len(times) :])
    members: dict[str, str | bytes] = {
        f"{name}.csv": f"{names}{mark}{mark.join(axes('{}'))}\n".replace("X", f"X ({unit})")
        + rows(*stamps, values, mark=mark)
        for name, unit, values in (("acc", "g", ACC_G), ("gyr", "deg/s", GYR_DPS))
    }

    recording = read_archive(members)

    np.testing.assert_allclose(recording.segments[0].acc_g, ACC_G, atol=2e-6)
    assert (recording.start.isoformat() if recording.start else None) == start
    assert codes(recording) == ([] if start else ["W-NO-DATE"])


def test_the_order_of_day_and_month_is_asked_of_two_tables_too() -> None:
    stamps = [f"02/03/2026 07:58:{t:06.3f}" for t in TIME_S]
    members: dict[str, str | bytes] = {
        "acc.csv": "time,X (g),Y (g),Z (g)\n" + rows(stamps, ACC_G),
        "gyr.csv": "time,X (deg/s),Y (deg/s),Z (deg/s)\n" + rows(stamps, GYR_DPS),
    }

    with pytest.raises(UnusableTime) as refusal:
        read_archive(members)

    assert refusal.value.facts == {"why": "date-order"}
    told = read_recording(pack(members), profile=ColumnProfile(date_order="mdy"))
    assert f"{told.start:%Y-%m-%d}" == "2026-02-03"


def test_each_table_counts_its_times_from_its_own_offset() -> None:
    utc = [f"2026-03-02T07:58:{t:06.3f}Z" for t in TIME_S]
    local = [f"2026-03-02T08:58:{t:06.3f}+01:00" for t in TIME_S]
    members: dict[str, str | bytes] = {
        "acc.csv": "time,X (g),Y (g),Z (g)\n" + rows(utc, ACC_G),
        "gyr.csv": "time,X (deg/s),Y (deg/s),Z (deg/s)\n" + rows(local, GYR_DPS),
    }

    recording = read_archive(members)

    np.testing.assert_allclose(recording.segments[0].acc_g, ACC_G, atol=2e-6)
    assert recording.time_zone == "UTC+01:00"


def test_a_wall_clock_and_a_time_in_utc_are_not_taken_for_one_clock() -> None:
    wall = [f"2026-03-02T08:58:{t:06.3f}" for t in TIME_S]
    members: dict[str, str | bytes] = {
        "acc.csv": "time,X (g),Y (g),Z (g)\n" + rows(wall, ACC_G),
        "gyr.csv": "time_s,X (deg/s),Y (deg/s),Z (deg/s)\n" + rows(START_S + 3600 + TIME_S, GYR_DPS),
    }

    with pytest.raises(NoPair) as refusal:
        read_archive(members)

    assert refusal.value.facts["why"] == "no common time"


def test_rows_after_a_clock_was_set_back_in_both_tables_follow_those_before() -> None:
    back = np.where(TIME_S < 15.0, TIME_S + 3600.0, TIME_S)
    members: dict[str, str | bytes] = {
        "acc.csv": "time_s,X (g),Y (g),Z (g)\n" + rows(back[::2], ACC_G[::2]),
        "gyr.csv": "time_s,X (deg/s),Y (deg/s),Z (deg/s)\n" + rows(back, GYR_DPS),
    }

    recording = read_archive(members)

    np.testing.assert_allclose(recording.segments[0].acc_g[::2], ACC_G[:-1:2], atol=2e-6)
    assert codes(recording) == ["W-CLOCK-BACK", "W-ACC-RATE"]


def test_a_clock_that_was_set_back_in_one_table_only_is_refused() -> None:
    back = np.where(TIME_S < 15.0, TIME_S + 5.0, TIME_S)
    gyr = "time_s,X (deg/s),Y (deg/s),Z (deg/s)\n" + rows(back, GYR_DPS)

    with pytest.raises(NoPair) as refusal:
        read_archive({"acc.csv": ACC, "gyr.csv": gyr})

    assert refusal.value.facts["why"] == "set back"


@pytest.mark.parametrize("delay", [1, -1])
def test_rows_that_came_late_are_put_in_order(delay: int) -> None:
    order = np.arange(len(TIME_S))
    for row in range(50, len(order) - 1, 700):
        order[[row, row + delay]] = order[[row + delay, row]]
    members: dict[str, str | bytes] = {
        "acc.csv": "time_s,X (g),Y (g),Z (g)\n" + rows(TIME_S[order], ACC_G[order]),
        "gyr.csv": "time_s,X (deg/s),Y (deg/s),Z (deg/s)\n" + rows(TIME_S[order], GYR_DPS[order]),
    }

    recording = read_archive(members)

    np.testing.assert_allclose(recording.segments[0].acc_g, ACC_G, atol=2e-6)
    assert codes(recording) == ["W-ORDER"]


MILLIS = [f"{1000 * t:.0f}" for t in TIME_S]
UNITS = ("(g)", "(deg/s)")
M_HEALTH = "HEADER_TIME_STAMP,X_{0},Y_{0},Z_{0}"


@pytest.mark.parametrize(
    ("names", "before", "after"),
    [
        (["Index,Arrival_Time,Creation_Time,x,y,z,User"] * 2, [["7"] * len(TIME_S), MILLIS, MILLIS], ["a"]),
        (
            [M_HEALTH.format(f"{name}_PER_SECOND") for name in ("ACCELERATION_METERS", "ANGULAR_VELOCITY")],
            [[f"2026-03-02T07:58:{t:06.3f}" for t in TIME_S]],
            [],
        ),
        (["Milliseconds,AcclX,AcclY,AcclZ", "Milliseconds,GyroX,GyroY,GyroZ"], [MILLIS], []),
        ([f'"t (ms)";"X {unit}";"Y {unit}";"Z {unit}"' for unit in UNITS], [MILLIS], []),
    ],
    ids=["HHAR", "mHealth", "GoPro", "decimal comma"],
)
def test_tables_of_public_layouts_are_a_pair(
    names: list[str], before: list[list[str]], after: list[str]
) -> None:
    mark = ";" if ";" in names[0] else ","
    tables = [
        rows(*before, values, *([word] * len(TIME_S) for word in after), mark=mark, form="%.9E")
        for values in (ACC_G, GYR_DPS)
    ]
    texts = [table.replace(".", ",") if mark == ";" else table for table in tables]
    acc, gyr = (f"{head}\n{text}" for head, text in zip(names, texts, strict=True))

    (run,) = read_archive({"ACCL.csv": acc, "AngularVelocity.csv": gyr}).segments

    np.testing.assert_allclose(run.acc_g, ACC_G, atol=2e-6)
    np.testing.assert_allclose(run.gyr_dps, GYR_DPS, atol=1e-3)


def test_two_tables_of_different_hours_have_nothing_in_common() -> None:
    later = "time_s,X (deg/s),Y (deg/s),Z (deg/s)\n" + rows(TIME_S + 3600.0, GYR_DPS)

    with pytest.raises(NoPair) as refusal:
        read_archive({"acc.csv": ACC, "gyr.csv": later})

    assert refusal.value.facts["why"] == "no common time"


@pytest.mark.parametrize("heads", ["X (g),Y (g),Z (g),light", "1,2,3,4"], ids=["no time", "no names"])
def test_a_table_without_names_of_its_time_and_axes_is_no_half_of_a_pair(heads: str) -> None:
    with pytest.raises(NoPair) as refusal:
        read_archive({"acc.csv": f"{heads}\n{rows(ACC_G, TIME_S)}", "gyr.csv": GYR})

    assert refusal.value.facts["why"] == "unnamed"
    assert refusal.value.facts["list"] == f"acc.csv: {heads}"


@pytest.mark.parametrize(
    ("rows_of_acc", "error"), [("", NoSamples), ("a,b,c,d\n" * 90, UnreadableRows)], ids=["none", "words"]
)
def test_a_table_without_rows_and_one_of_words_are_told_apart(
    rows_of_acc: str, error: type[FusionError]
) -> None:
    with pytest.raises(error):
        read_archive({"acc.csv": f"time_s,X (g),Y (g),Z (g)\n{rows_of_acc}", "gyr.csv": GYR})


def test_an_arm_band_is_not_taken_for_a_description() -> None:
    assert read_recording(io.BytesIO(metawear())).device == "metawear"


def test_a_first_time_that_no_clock_shows_is_left_aside() -> None:
    heads = "time,time_s," + ",".join(axes("{}"))
    clock = ["2026-03-02T27:00:00"] * len(TIME_S)
    members: dict[str, str | bytes] = {
        "ACC.csv": heads.replace("X", "X (g)") + "\n" + rows(clock, TIME_S, ACC_G),
        "GYR.csv": heads.replace("X", "X (deg/s)") + "\n" + rows(clock, TIME_S, GYR_DPS),
    }

    assert read_archive(members).start is None


@pytest.mark.parametrize("members", [1, 2])
def test_an_index_that_points_before_the_start_of_a_file_on_disk_is_refused(
    tmp_path: Path, members: int
) -> None:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        for number in range(members):
            archive.writestr(f"{number}.csv", "time (s),X,Y,Z\n1,2,3,4\n")
    content = bytearray(packed.getvalue())
    place = len(content) - 6  # where the end record states the start of the index
    struct.pack_into("<I", content, place, struct.unpack_from("<I", content, place)[0] + 100)
    (tmp_path / "a.zip").write_bytes(content)

    with pytest.raises(CorruptArchive):
        read_recording(tmp_path / "a.zip")
