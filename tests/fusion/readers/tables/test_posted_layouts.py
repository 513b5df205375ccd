"""Layouts of single tables as people post them: which rows count, and what a refusal asks for."""

import pytest

from fusion.errors import SeparateLines, UnknownColumns, UnknownRate
from fusion.readers import ColumnProfile, propose_profile
from fusion.readers.tables.layout import ARRIVED, find_layout
from fusion.recording import DEG_PER_RAD, STANDARD_GRAVITY, acc_scale_g, gyr_scale_dps
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
