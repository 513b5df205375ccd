"""Layouts of single tables as people post them: the rows that count, and the cures of refusals."""

from collections.abc import Callable
from datetime import UTC, datetime, timedelta

import pytest

from acromion.fusion.errors import SeparateLines, UnknownColumns, UnknownRate, UnusableTime
from acromion.fusion.readers import ColumnProfile, propose_profile
from acromion.fusion.readers.tables.layout import ARRIVED, find_layout
from acromion.fusion.recording import DEG_PER_RAD, STANDARD_GRAVITY, acc_scale_g, gyr_scale_dps
from tests.fusion.readers.tables.table_builder import line, read_text
from tests.fusion.readers.tables.test_real_layouts import (
    CHANNELS,
    ROWS,
    check_whole,
    clock,
    make_rows,
    read_with,
)

UNNAMED = ColumnProfile(("p", "q", "r"), ("u", "v", "w"), "g", "dps", time="k", time_unit="ms")
NUMBERED = ColumnProfile((2, 3, 4), (5, 6, 7), "g", "dps", time=1, time_unit="ms")


# A column of words is never a reason to leave a row out.


def make_noted(after: str, noted: str, header: str = "k,p,q,r,u,v,w,remark\n") -> str:
    """Write a remark in the last quarter of the rows, beyond the head that shows the columns."""
    rows = (f"{10 * k},{line(k)}{noted if 900 <= k < 1190 else after}\n" for k in range(ROWS))
    return header + "".join(rows)


@pytest.mark.parametrize("header", ["k,p,q,r,u,v,w,remark\n", "k,p,q,r,u,v,w\n", ""])
@pytest.mark.parametrize("noted", [",walk", ',"walk, fast"', ",7"])
def test_a_remark_in_some_rows_loses_no_row(header: str, noted: str) -> None:
    profile = UNNAMED if header else NUMBERED

    check_whole(read_with(make_noted(",", noted, header), profile))


def test_a_remark_is_not_read_under_a_known_header() -> None:
    recording = read_text(make_noted(",", ",walk", f"time_ms,{CHANNELS},remark\n"))

    check_whole(recording)
    assert recording.understood["ignored"] == "remark"


def test_the_form_shows_a_column_that_is_empty_in_the_first_rows() -> None:
    proposal = propose_profile(make_noted(",", ",walk").encode())

    assert proposal.columns == ("k", "p", "q", "r", "u", "v", "w", "remark")


# Rows with fewer fields than the header has names.

NARROW = f"n,time_ms,{CHANNELS}\n" + make_rows("{ms},{row}")


def test_rows_with_fewer_fields_than_names_are_a_matter_for_a_person() -> None:
    with pytest.raises(UnknownColumns) as refusal:
        read_text(NARROW)

    assert refusal.value.facts == {"list": f"n,time_ms,{CHANNELS}", "why": "narrow rows", "line": 2}
    assert propose_profile(NARROW.encode()).columns == ("",) * 7
    check_whole(read_with(NARROW, NUMBERED))


def test_last_fields_that_some_rows_lack_are_not_needed() -> None:
    rows = (f"{10 * k},{line(k)}{',25.0' if k % 10 == 0 else ''}\n" for k in range(ROWS))

    check_whole(read_text(f"time_ms,{CHANNELS},temperature\n" + "".join(rows)))


def test_a_row_that_was_cut_before_its_last_reading_is_left_out() -> None:
    lines = (f"time_ms,{CHANNELS},temperature\n" + make_rows("{ms},{row},25.0")).splitlines()
    lines[600] = lines[600].rsplit(",", 2)[0]

    flags = {flag.code: flag.count for flag in read_text("\n".join(lines) + "\n").flags}

    assert flags["W-ROWS-DROPPED"] == 1


# Lines that an example sketch prints, one sensor a line.

ADAFRUIT = ("Acceleration X: {}, Y: {}, Z: {} m/s^2", "Rotation X: {}, Y: {}, Z: {} rad/s")
LSM6DS = ("\t\tAccel X: {} \tY: {} \tZ: {} m/s^2 ", "\t\tGyro X: {} \tY: {} \tZ: {} radians/s ")


def make_sketch(forms: tuple[str, str], before: str) -> str:
    """Write a sample every 10 ms: acceleration, angular rate, temperature, a blank line."""
    text = "Adafruit MPU6050 test!\n"
    for k in range(ROWS):
        ax, ay, az, *rates = line(k).split(",")
        lines = [forms[0].format(ax, ay, az), forms[1].format(*rates), "Temperature: 29.53 degC", ""]
        text += "".join(before.format(clock=clock(k), second=clock(k)[:8]) + one + "\n" for one in lines)
    return text


@pytest.mark.parametrize("forms", [ADAFRUIT, LSM6DS], ids=["MPU6050", "LSM6DS"])
@pytest.mark.parametrize("before", ["{clock} -> ", "2026-03-02 {clock} "], ids=["Arduino IDE", "CoolTerm"])
def test_sketches_with_one_sensor_a_line_are_grouped(forms: tuple[str, str], before: str) -> None:
    """The unit stands after the last axis of each line."""
    layout = find_layout(make_sketch(forms, before))

    assert layout is not None
    assert [column.channel for column in layout.columns] == ["time", *["acc"] * 3, *["gyr"] * 3]
    assert [acc_scale_g(column.unit) for column in layout.columns[1:4]] == [1.0 / STANDARD_GRAVITY] * 3
    assert [gyr_scale_dps(column.unit) for column in layout.columns[4:]] == [DEG_PER_RAD] * 3
    assert layout.sample_rows[7][4:] == ("0.50", "-0.250", "7.5")


def test_a_sketch_without_times_needs_its_rate() -> None:
    text = make_sketch(ADAFRUIT, "").replace(" m/s^2", " g").replace(" rad/s", " dps")

    with pytest.raises(UnknownRate):
        read_text(text)
    check_whole(read_text(text, rate_hz=100.0))


def test_values_between_bars_are_read() -> None:
    names = ("AcX", "AcY", "AcZ", "GyX", "GyY", "GyZ")
    rows = (
        " | ".join(f"{name} = {value}" for name, value in zip(names, line(k).split(","), strict=True))
        for k in range(ROWS)
    )
    layout = find_layout("\n".join(rows) + "\n")

    assert layout is not None
    assert [column.channel for column in layout.columns] == [*["acc"] * 3, *["gyr"] * 3]


@pytest.mark.parametrize(
    "sample",
    [
        "Accelerometer:\n X = 0.01\n Y = 0.02\n Z = 0.99\n\nGyroscope:\n X = 1.5\n Y = -0.2\n Z = 0.3\n\n",
        "X: 0.10  Y: 0.20  Z: 9.80  m/s^2\nX: 0.01  Y: 0.02  Z: 0.03  rad/s\n",
        ">aX:0.01\n>aY:0.02\n>aZ:0.99\n>gX:1.5\n>gY:-0.2\n>gZ:0.3\n",
    ],
)
def test_lines_that_nobody_can_group_are_refused_with_the_form_to_use(sample: str) -> None:
    with pytest.raises(SeparateLines) as refusal:
        read_text(sample * 200)

    assert "X" in str(refusal.value.facts["list"])


# The time that CoolTerm writes before each line has no mark after it.


@pytest.mark.parametrize(
    "before", ["2026-03-02 {clock} ", "2026-03-02 {clock}: ", "2026-03-02 {clock}\t", "{clock} "]
)
def test_a_time_before_each_line_needs_no_mark(before: str) -> None:
    recording = read_text(before.format(clock=clock(0)) + f"{CHANNELS}\n" + make_rows(before + "{row}"))

    check_whole(recording)
    assert (recording.start is None) == before.startswith("{")


@pytest.mark.parametrize(
    "stamp",
    ["2026-03-02 07:00:00.010 PM,", "2026-03-02 07:00:00.010 EST,", "2026-03-02 07:00:00.010 +01:00,"],
)
def test_half_days_and_zones_belong_to_the_time(stamp: str) -> None:
    assert ARRIVED.match(stamp + "0.1,0.2") is None


# The time of a serial monitor counts as column 1.

STAMPED = make_rows("{clock} -> {row}")


def test_the_time_of_a_monitor_is_column_1_in_form_and_message() -> None:
    with pytest.raises(UnknownColumns) as unnamed:
        read_text(STAMPED)
    with pytest.raises(UnknownColumns) as miscounted:
        read_with(STAMPED, ColumnProfile((1, 2, 3), (4, 5, 6), "g", "dps"))
    proposal = propose_profile(STAMPED.encode())

    assert unnamed.value.facts["why"] == "no header, stamped"
    assert miscounted.value.facts == {"why": "time counted"}
    assert (proposal.columns, proposal.time) == (("arrived", *[""] * 6), "arrived")
    for time in (1, "arrived", None):
        check_whole(read_with(STAMPED, ColumnProfile((2, 3, 4), (5, 6, 7), "g", "dps", time=time)))


# A time in several columns, and several times in one table.


def moment(k: int, hours: int = 0) -> datetime:
    return datetime(2026, 3, 25, 7) + timedelta(hours=hours, milliseconds=10 * k)  # noqa: DTZ001 (no zone)


def make_timed(names: str, write: Callable[[int], str]) -> str:
    return f"{names},{CHANNELS}\n" + "".join(f"{write(k)},{line(k)}\n" for k in range(ROWS))


@pytest.mark.parametrize(
    ("names", "form"),
    [
        ("hour,minute,second", "{0.hour},{0.minute},{0.second}.{1:03d}"),
        ("HH,MM,SS,ms", "{0.hour},{0.minute},{0.second},{1}"),
        ("year,month,day,hour,minute,second,millisecond", "{0:%Y},{0:%m},{0:%d},7,{0:%M},{0:%S},{1}"),
        ("heure,minute,seconde", "{0:%H},{0:%M},{0.second}.{1:03d}"),
    ],
)
def test_hour_minute_and_second_in_columns_are_one_time(names: str, form: str) -> None:
    text = make_timed(names, lambda k: form.format(moment(k), moment(k).microsecond // 1000))

    recording = read_text(text)

    check_whole(recording)
    assert recording.understood["ignored"] == ""
    assert recording.start == (moment(0) if names.startswith("year") else None)


def test_hour_minute_and_second_pass_midnight() -> None:
    late = [moment(k) + timedelta(hours=16, minutes=59, seconds=54) for k in range(ROWS)]

    check_whole(
        read_text(
            make_timed(
                "hour,minute,second", lambda k: f"{late[k]:%H,%M,%S}.{late[k].microsecond // 1000:03d}"
            )
        )
    )


@pytest.mark.parametrize("name", ["loggingTime(ms)", "runtime_ms", "sensorTimestamp [ms]", "Zeit (ms)"])
def test_a_name_that_ends_in_time_is_a_time_if_no_other_is(name: str) -> None:
    check_whole(read_text(make_timed(name, lambda k: str(10 * k))))


@pytest.mark.parametrize("name", ["SecondsSinceStart", "stamp"])
def test_rows_that_carry_a_time_are_never_asked_for_a_rate(name: str) -> None:
    with pytest.raises(UnusableTime) as refusal:
        read_text(make_timed(name, lambda k: f"{0.01 * k:.2f}"))

    assert refusal.value.facts == {"column": name}


def test_a_count_of_rows_is_no_time() -> None:
    with pytest.raises(UnknownRate):
        read_text(make_timed("frame", str))


@pytest.mark.parametrize("names", ["datetime,millis", "rtc,millis", "millis,datetime"])
def test_a_clock_beside_a_count_of_milliseconds_gives_the_start(names: str) -> None:
    """The count has the finer steps: the clock shows whole seconds."""
    fields = {"millis": lambda k: str(10 * k + 55), "clock": lambda k: f"{moment(k):%Y-%m-%d %H:%M:%S}"}
    order = ["millis" if name == "millis" else "clock" for name in names.split(",")]

    recording = read_text(make_timed(names, lambda k: ",".join(fields[name](k) for name in order)))

    check_whole(recording)
    assert (recording.start, recording.understood["time"]) == (moment(0), "number")


def test_a_date_and_a_time_beside_a_count_give_the_start() -> None:
    write = "{0:%d/%m/%Y},{0:%H:%M:%S},{1}"

    recording = read_text(make_timed("date,time,millis", lambda k: write.format(moment(k), 10 * k)))

    check_whole(recording)
    assert recording.start == moment(0)
    assert recording.understood["ignored"] == ""


FORMS = ("%Y-%m-%d %H:%M:%S", "%d/%m/%Y %H:%M:%S")
ENDS = (("", ""), ("Z", ""), ("Z", "-05:00"))


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("ends", ENDS, ids=["bare", "Z", "offset"])
@pytest.mark.parametrize("is_utc_first", [True, False])
def test_of_a_time_in_utc_and_a_local_one_the_local_one_is_used(
    form: str, ends: tuple[str, str], is_utc_first: bool
) -> None:
    def write(k: int) -> str:
        parts = [moment(k, hours).strftime(form) + f".{k % 100:02d}" for hours in (5, 0)]
        fields = [part + end for part, end in zip(parts, ends, strict=True)]
        return ",".join(fields if is_utc_first else fields[::-1])

    text = make_timed("time_utc,time_local" if is_utc_first else "time_local,time_utc", write)
    recording = read_text(text)
    asked = ColumnProfile((3, 4, 5), (6, 7, 8), "g", "dps", time="time_utc")

    check_whole(recording)
    assert recording.start is not None
    assert recording.start.replace(tzinfo=None) == moment(0)
    assert recording.time_zone == ("UTC-05:00" if ends[1] else None)
    assert recording.understood["ignored"] == "time_utc"
    assert not {"W-UTC", "W-OFFSET", "W-DST"} & {flag.code for flag in recording.flags}
    in_utc = read_with(text, asked)
    assert (in_utc.start, in_utc.time_zone) == (moment(0, 5).replace(tzinfo=UTC), "UTC+00:00")
    assert in_utc.understood["ignored"] == "time_local"


def test_a_column_named_utc_is_in_utc() -> None:
    recording = read_text(make_timed("utc", lambda k: f"{moment(k):%Y-%m-%d %H:%M:%S}.{k % 100:02d}"))

    assert recording.start == moment(0).replace(tzinfo=UTC)
    assert "W-UTC" in {flag.code for flag in recording.flags}


def test_the_offset_of_another_time_in_a_row_is_no_change_of_the_clock() -> None:
    write = "{0:%d/%m/%Y %H:%M:%S}.{2:02d}-05:00,{1:%d/%m/%Y %H:%M:%S}Z"

    recording = read_text(
        make_timed("received,sent", lambda k: write.format(moment(k), moment(k, 5), k % 100))
    )

    assert "W-OFFSET" not in {flag.code for flag in recording.flags}
    check_whole(recording)


# Other lines that programs print.


def test_an_esp32_writes_its_milliseconds_before_each_line() -> None:
    names = ("ax", "ay", "az", "gx", "gy", "gz")
    rows = (
        f"I ({10 * k + 312}) imu: " + " ".join(map("=".join, zip(names, line(k).split(","), strict=True)))
        for k in range(ROWS)
    )

    layout = find_layout("\n".join(rows) + "\n")

    assert layout is not None
    assert layout.columns[0].channel == "time"
    assert layout.sample_rows[1][:2] == ("0.322", "0.001")


def test_an_object_of_json_in_each_line_is_a_row() -> None:
    names = ("ax_g", "ay_g", "az_g", "gx_dps", "gy_dps", "gz_dps")
    rows = (
        ", ".join(f'"{name}": {value}' for name, value in zip(names, line(k).split(","), strict=True))
        for k in range(ROWS)
    )

    text = "".join(f'{{"time_ms": {10 * k}, {row}}}\n' for k, row in enumerate(rows))

    check_whole(read_text(text, "imu.json"))


def test_a_row_of_units_may_be_in_brackets() -> None:
    header = "Time,AccX,AccY,AccZ,GyroX,GyroY,GyroZ\n[ms],[g],[g],[g],[dps],[dps],[dps]\n"

    recording = read_text(header + make_rows("{ms},{row}"))

    check_whole(recording)
    assert (recording.stated.acc_unit, recording.stated.gyr_unit) == ("g", "dps")
    assert recording.flags == ()
