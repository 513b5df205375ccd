"""Layouts of loggers, apps and serial monitors, small enough to be checked by hand."""

import io
import zipfile
from collections.abc import Iterable

import pytest

from acromion.fusion.errors import (
    AmbiguousDecimal,
    FusionError,
    NoGyroscope,
    SeparateLines,
    SeveralSensors,
    UnknownColumns,
    UnknownUnit,
    UnsupportedFormat,
    UnusableTime,
)
from acromion.fusion.readers import ColumnProfile, parse_profile, propose_profile, read_recording
from acromion.fusion.readers.tables.columns import DateOrder
from acromion.fusion.readers.tables.layout import find_layout
from acromion.fusion.recording import Recording
from tests.fusion.readers.tables.table_builder import line, read_text

ROWS = 1200
CHANNELS = "ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps"


def clock(k: int, mark: str = ".") -> str:
    """Write the time of day of a row at 100 Hz."""
    return f"07:{k // 6000:02d}:{k % 6000 // 100:02d}{mark}{k % 100:02d}0"


def make_rows(form: str, rows: Iterable[int] = range(ROWS)) -> str:
    return "".join(
        form.format(clock=clock(k), colon=clock(k, ":"), ms=10 * k, row=line(k)) + "\n" for k in rows
    )


def check_whole(recording: Recording) -> None:
    """Check that each row was read, at 100 Hz, with its own readings."""
    (segment,) = recording.segments
    assert (len(segment), recording.duration_us) == (ROWS, 12_000_000)
    assert segment.gyr_dps[7].tolist() == [0.5, -0.25, 7.5]
    assert segment.acc_g[3].tolist() == pytest.approx([0.0, 0.001, 1.001])


# The time that a serial monitor put before each line.


@pytest.mark.parametrize(
    "before",
    [
        "{clock} -> ",
        "{colon} -> ",
        "{clock} > ",
        "[{clock}] ",
        "[2026-03-02 {clock}] ",
        "2026-03-02 {clock} -> ",
        "[Mon Mar 02 {clock} 2026] ",
        "[Mon Mar  2 {clock} 2026] ",
    ],
    ids=[
        "Arduino IDE",
        "VS Code",
        "PlatformIO",
        "CoolTerm",
        "minicom",
        "with a date",
        "Tera Term",
        "its space",
    ],
)
def test_the_time_of_a_serial_monitor_is_used_if_there_is_no_other(before: str) -> None:
    header = before.format(clock=clock(0), colon=clock(0, ":"))

    recording = read_text(f"{header}{CHANNELS}\n" + make_rows(before + "{row}"))

    check_whole(recording)
    assert recording.understood["time"] == ("calendar" if "2026" in before else "time of day")


def test_the_time_since_the_start_of_a_monitor_is_read_in_seconds() -> None:
    """Tera Term writes days before the hours."""
    text = f"[0 07:00:00.000] {CHANNELS}\n" + make_rows("[0 {clock}] {row}")

    recording, proposal = read_text(text), propose_profile(text.encode())

    check_whole(recording)
    assert (recording.start, recording.understood["time"]) == (None, "number")
    assert proposal.rows[0][0] == "25200.000"


def test_the_form_shows_a_time_of_day_without_a_date() -> None:
    proposal = propose_profile((f"07:00:00.000 -> {CHANNELS}\n" + make_rows("{clock} -> {row}")).encode())

    assert proposal.rows[1][0] == "07:00:00.010"


def test_the_time_of_the_board_goes_before_that_of_the_monitor() -> None:
    recording = read_text(f"07:00:00.000 -> millis,{CHANNELS}\n" + make_rows("{clock} -> {ms},{row}"))

    check_whole(recording)
    assert recording.understood["time"] == "number"


def test_a_monitor_s_time_without_milliseconds_is_stripped() -> None:
    recording = read_text(
        f"07:00:00 -> millis,{CHANNELS}\n"
        + "".join(f"{clock(k)[:8]} -> {10 * k},{line(k)}\n" for k in range(ROWS))
    )

    check_whole(recording)
    assert recording.understood["time"] == "number"


def test_six_names_that_a_person_writes_above_a_monitor_s_rows_are_enough() -> None:
    check_whole(read_text(f"{CHANNELS}\n" + make_rows("{clock} -> {row}")))


def test_the_line_that_putty_writes_above_a_log_does_no_harm() -> None:
    above = "=~=~=~=~=~=~=~=~=~=~=~= PuTTY log 2026.03.02 07:00:00 =~=~=~=~=~=~=~=~=~=~=~=\n"

    check_whole(read_text(above + f"millis,{CHANNELS}\n" + make_rows("{ms},{row}")))


# One sensor a line.


def split_line(k: int, form: str) -> str:
    values = line(k).split(",")
    parts = {"A": ", ".join(values[:3]), "G": ", ".join(values[3:])}
    return form.format(ms=10 * k, clock=clock(k), **parts)


def test_three_numbers_after_a_letter_are_a_sensor() -> None:
    """SparkFun's sketch: units after the numbers, nothing else on the line."""
    text = "".join(split_line(k, "G: {G} deg/s\nA: {A} g\nM: 0.1, 0.2, 0.3 gauss\n\n") for k in range(ROWS))

    recording = read_text(text, rate_hz=100.0)

    check_whole(recording)
    assert (recording.stated.acc_unit, recording.stated.gyr_unit) == ("g", "deg/s")


def test_a_sample_with_a_lost_line_is_left_out() -> None:
    form = "{clock} -> A: {A} g\n{clock} -> G: {G} deg/s\n"
    lines = "".join(split_line(k, form) for k in range(ROWS)).splitlines()
    del lines[401]  # the angular rate of the 201st sample

    recording = read_text("\n".join(lines) + "\n")

    assert sum(len(s) - sum(b - a for a, b in s.bridged) for s in recording.segments) == ROWS - 1


@pytest.mark.parametrize("lost", [0, 1, 2])
def test_without_a_time_samples_with_a_lost_line_count_as_missing(lost: int) -> None:
    sample = [
        split_line(k, "A: {A} g\nG: {G} deg/s\nM: 0.1, 0.2, 0.3 gauss\n").splitlines() for k in range(ROWS)
    ]
    for lines in sample[600:650]:
        del lines[lost]

    recording = read_text("".join(f"{one}\n" for lines in sample for one in lines), rate_hz=100.0)

    assert recording.duration_us == 12_000_000
    assert [len(segment) for segment in recording.segments] == [600, 550]


# Dates and times in two columns.


@pytest.mark.parametrize("header", ["rtcDate,rtcTime", "Date,Time", "day,clock"])
def test_a_date_and_a_time_are_one_time_whatever_they_are_called(header: str) -> None:
    recording = read_text(f"{header},{CHANNELS}\n" + make_rows("03/25/2026,{clock},{row}"))

    check_whole(recording)
    assert f"{recording.start:%Y-%m-%d %H:%M}" == "2026-03-25 07:00"


@pytest.mark.parametrize(
    ("header", "form"),
    [
        ("clock,day", "{clock},25/03/2026,{{row}}"),
        ("clock,day", "{clock},2026-03-25,{{row}}"),
        ("clock,temp,day", "{clock},-21.5,25/03/2026,{{row}}"),
        ("day,temp,place,clock", "25/03/2026,21.5,left arm,{clock},{{row}}"),
        ("day,clock", "25-Mar-2026,{clock},{{row}}"),
        ("time", "25-Mar-2026 {clock},{{row}}"),
        ("time", "25 March 2026 {clock},{{row}}"),
        ("time", "{clock} 25/03/2026,{{row}}"),
        ("date,time", "20260325,{bare},{{row}}"),
        ("d,utc", "20260325,{bare},{{row}}"),
        ("d,utc", "20260325,{short},{{row}}"),
        ("time", "20260325_{bare},{{row}}"),
        ("time", "20260325{bare},{{row}}"),
    ],
)
def test_a_date_and_a_time_are_found_wherever_they_are(header: str, form: str) -> None:
    """Twelve seconds that begin five before the minute: as bare numbers, 70059.99 goes on with 70100.00."""
    first = 5500

    lines = []
    for k in range(ROWS):
        bare = clock(first + k).replace(":", "")
        begin = form.format(clock=clock(first + k), bare=bare, short=bare.lstrip("0"))
        lines.append(begin.format(row=line(k)))
    recording = read_text(f"{header},{CHANNELS}\n" + "\n".join(lines) + "\n")

    check_whole(recording)
    assert f"{recording.start:%Y-%m-%d %H:%M:%S}" == "2026-03-25 07:00:55"


@pytest.mark.parametrize("version", ["4.0.2", "1.2.26"])
def test_a_version_is_no_date(version: str) -> None:
    recording = read_text(f"firmware,id,time,{CHANNELS}\n" + make_rows(version + ",7,{clock},{row}"))

    check_whole(recording)
    assert (recording.start, recording.understood["time"]) == (None, "time of day")


@pytest.mark.parametrize("order", [None, "dmy"])
def test_dates_that_no_order_fits_are_refused_as_what_they_are(order: DateOrder | None) -> None:
    dates = ["13/02/2026", "02/13/2026"]
    rows = "".join(f"{dates[k % 2]} {clock(k)},{line(k)}\n" for k in range(ROWS))

    with pytest.raises(UnusableTime) as refusal:
        read_with(f"time,{CHANNELS}\n{rows}", ColumnProfile(date_order=order))

    assert refusal.value.facts == {"why": "dates"}


def test_one_damaged_date_says_nothing_of_the_others() -> None:
    rows = make_rows("25/03/2026 {clock},{row}").replace("25/03/2026 07:00:00.050", "25/33/2026 07:00:00.050")

    recording = read_text(f"time,{CHANNELS}\n{rows}")

    assert f"{recording.start:%Y-%m-%d}" == "2026-03-25"


@pytest.mark.parametrize("time", ["rtcDate", "rtcTime", 1, 2])
def test_a_profile_may_name_either_of_the_two(time: str | int) -> None:
    names = [f"{sensor}{axis}" for sensor in "pq" for axis in "123"]
    profile = ColumnProfile(tuple(names[:3]), tuple(names[3:]), "g", "dps", time=time)
    text = "rtcDate,rtcTime," + ",".join(names) + "\n" + make_rows("03/25/2026,{clock},{row}")

    check_whole(read_with(text, profile))


def read_with(text: str, profile: ColumnProfile) -> Recording:
    return read_recording(io.BytesIO(text.encode()), file_name="x.csv", profile=profile)


@pytest.mark.parametrize(("order", "day"), [("dmy", "2026-02-03"), ("mdy", "2026-03-02")])
def test_a_profile_may_state_the_order_of_dates_alone(order: str, day: str) -> None:
    text = f"rtcDate,rtcTime,{CHANNELS}\n" + make_rows("03/02/2026,{clock},{row}")

    with pytest.raises(UnusableTime):
        read_text(text)
    recording = read_with(text, parse_profile(f'{{"date_order": "{order}"}}'))

    check_whole(recording)
    assert f"{recording.start:%Y-%m-%d}" == day


def test_the_form_opens_while_the_order_of_dates_is_open() -> None:
    text = f"rtcDate,rtcTime,{CHANNELS}\n" + make_rows("03/02/2026,{clock},{row}")

    proposal = propose_profile(text.encode())

    assert proposal.acceleration == ("ax_g", "ay_g", "az_g")
    assert proposal.rows[0][:2] == ("03/02/2026", "07:00:00.000")


# Words beside the numbers, and rows of units.

WORDS = "label,k,p,q,r,u,v,w\n" + make_rows("left,{ms},{row}")


def test_words_and_unknown_names_are_a_matter_for_a_person() -> None:
    with pytest.raises(UnknownColumns) as refusal:
        read_text(WORDS)

    assert refusal.value.facts["list"] == "label,k,p,q,r,u,v,w"
    assert propose_profile(WORDS.encode()).rows[0] == ("left", "0", *line(0).split(","))


def test_with_a_profile_only_its_columns_must_be_numbers() -> None:
    profile = ColumnProfile(("p", "q", "r"), ("u", "v", "w"), "g", "dps", time="k", time_unit="ms")

    check_whole(read_with(WORDS, profile))


HOURS = "clock,k,p,q,r,u,v,w\n" + make_rows("07:00,{ms},{row}")


def test_a_profile_that_names_another_time_reads_past_one_without_seconds() -> None:
    profile = ColumnProfile(("p", "q", "r"), ("u", "v", "w"), "g", "dps", time="k", time_unit="ms")

    check_whole(read_with(HOURS, profile))
    assert propose_profile(HOURS.encode()).rows[0][:2] == ("07:00", "0")


def test_a_profile_that_names_the_time_without_seconds_is_told_that_they_are_missing() -> None:
    profile = ColumnProfile(("p", "q", "r"), ("u", "v", "w"), "g", "dps", time="clock")

    with pytest.raises(UnusableTime) as refusal:
        read_with(HOURS, profile)

    assert refusal.value.facts == {"why": "seconds"}


@pytest.mark.parametrize("later", ["", "7"])
def test_a_label_that_is_no_word_further_on_hides_no_rows(later: str) -> None:
    """The first row of numbers only is not the first row."""
    rows = "".join(f"{'left' if k < 300 else later},{10 * k},{line(k)}\n" for k in range(ROWS))

    check_whole(read_text(f"label,time_ms,{CHANNELS}\n" + rows))


@pytest.mark.parametrize("label", ['"lift, carry"', '"say ""go"", then lift"', '"lift; carry"'])
@pytest.mark.parametrize("form", ["{label},{ms},{row}", "{ms},{label},{row}", "{ms},{row},{label}"])
def test_a_label_between_quotes_may_contain_the_separator(form: str, label: str) -> None:
    """A program quotes only the labels that need it; the first such label stands in row 600."""
    names = form.format(label="label", ms="time_ms", row=CHANNELS)
    for first in (0, 600):
        before = make_rows(form.replace("{label}", "lift"), range(first))
        after = make_rows(form.replace("{label}", label), range(first, ROWS))

        check_whole(read_text(f"{names}\n{before}{after}"))


def test_a_quote_that_is_never_closed_swallows_no_other_field() -> None:
    rows = make_rows('"5,{ms},{row}')

    check_whole(read_text(f"label,time_ms,{CHANNELS}\n" + rows))


def test_decimal_commas_between_quotes_and_commas_are_refused() -> None:
    rows = [",".join(f'"{field.replace(".", ",")}"' for field in line(k).split(",")) for k in range(100)]

    with pytest.raises(AmbiguousDecimal):
        read_text(f"{CHANNELS}\n" + "\n".join(rows) + "\n", rate_hz=100.0)


@pytest.mark.parametrize("word", ["no_units", "local_flux", "anything"])
def test_a_word_in_a_row_of_units_voids_no_other_cell(word: str) -> None:
    names = "t,ax,ay,az,gx,gy,gz,mx\n"
    units = f"ms,m/(s^2),m/(s^2),m/(s^2),deg/s,deg/s,deg/s,{word}\n"

    layout = find_layout(names + units + make_rows("{ms},{row},0.5"))

    assert layout is not None
    assert [column.unit for column in layout.columns[:7]] == ["ms", *["m/s2"] * 3, *["deg/s"] * 3]


# Names over several columns.

MERGED = (
    "Format=7,5718,,,Chest,,,5778,,,Right Upper Arm,,\n"
    "Time,Accelerometer,,,Gyroscope,,,Accelerometer,,,Gyroscope,,\n"
    ",X,Y,Z,X,Y,Z,X,Y,Z,X,Y,Z\n"
)


def make_merged() -> str:
    rows = (f"{1_772_434_800_000_000 + 10_000 * k},9,9,9,9,9,{k % 7},{line(k)}\n" for k in range(ROWS))
    return MERGED + "".join(rows)


def test_names_over_several_columns_belong_to_each_of_them() -> None:
    with pytest.raises(SeveralSensors) as refusal:
        read_text(make_merged())

    proposal = propose_profile(make_merged().encode())
    layout = find_layout(make_merged())
    assert refusal.value.facts["list"] == "Chest, Right Upper Arm"
    assert proposal.sensors == ("Chest", "Right Upper Arm")
    assert proposal.above[0][4] == "Chest"
    assert layout is not None
    assert [column.sensor for column in layout.columns] == ["", *["Chest"] * 6, *["Right Upper Arm"] * 6]


# What a refusal says of the columns, and what counts as an absent value.


def test_columns_that_are_there_twice_are_not_called_missing() -> None:
    header = "time_ms,ax_g,ax_g,az_g,gx_dps,gy_dps,gz_dps\n"

    with pytest.raises(UnknownColumns) as refusal:
        read_text(header + make_rows("{ms},{row}"))

    assert (refusal.value.facts["missing"], refusal.value.facts["doubled"]) == ("ay", "ax")


WIDE = f"time_ms,{CHANNELS}\n" + make_rows("{ms},{row},7")


def test_rows_with_a_field_more_than_the_header_has_names_are_a_matter_for_a_person() -> None:
    with pytest.raises(UnknownColumns) as refusal:
        read_text(WIDE)

    assert refusal.value.facts == {"list": f"time_ms,{CHANNELS}", "why": "wide rows", "line": 2}
    assert propose_profile(WIDE.encode()).columns == ("",) * 8
    check_whole(read_with(WIDE, ColumnProfile((2, 3, 4), (5, 6, 7), "g", "dps", time=1, time_unit="ms")))


def test_the_names_above_wider_rows_say_nothing_in_a_profile() -> None:
    with pytest.raises(UnknownColumns) as refusal:
        read_with(WIDE, ColumnProfile(("ax_g", "ay_g", "az_g"), ("gx_dps", "gy_dps", "gz_dps")))

    assert refusal.value.facts["why"] == "wide rows"


@pytest.mark.parametrize(
    ("names", "facts"),
    [
        ("ax_g,ay_mg,az_g,gx_dps,gy_dps,gz_dps", {"mixed": "accelerometer", "units": "g, mg, g"}),
        ("ax_g,ay_g,az_g,gx_dps,gy_dps,gz_rad/s", {"mixed": "gyroscope", "units": "dps, dps, rad/s"}),
    ],
)
def test_axes_of_different_units_are_refused_with_them(names: str, facts: dict[str, str]) -> None:
    with pytest.raises(UnknownUnit) as refusal:
        read_text(f"time_ms,{names}\n" + make_rows("{ms},{row}"))

    assert refusal.value.facts == facts


@pytest.mark.parametrize(
    ("word", "code"),
    [("nan", "W-NAN"), ("NA", "W-NAN"), ("null", "W-NAN"), ("-inf", "W-NAN"), ("non", "W-ROWS-DROPPED")],
)
def test_only_a_whole_word_is_an_absent_value(word: str, code: str) -> None:
    rows = make_rows("{ms},{row}").splitlines()
    rows[500] = f"5000,{word},0,1,0.5,-0.25,0"

    recording = read_text(f"time_ms,{CHANNELS}\n" + "\n".join(rows) + "\n")

    assert code in {flag.code for flag in recording.flags}


@pytest.mark.parametrize(
    ("stated", "start"),
    [
        ("StartTime: ,2026-03-02_07:00:00_086 CET", "2026-03-02T07:00:00.086000+01:00"),
        ("StartTime: 2026-03-02 07:00:00", "2026-03-02T07:00:00"),
        ("Start Time: 2026/03/02 07:00:00.5 -05:00", "2026-03-02T07:00:00.500000-05:00"),
        ("Start Time: Unknown", None),
        ("StartTime: 2026-13-02_07:00:00", None),
    ],
)
def test_a_start_time_above_the_names_is_a_clock(stated: str, start: str | None) -> None:
    recording = read_text(f"{stated}\ntime_ms,{CHANNELS}\n" + make_rows("{ms},{row}"))

    assert (recording.start.isoformat() if recording.start else None) == start


@pytest.mark.parametrize("text", ["a b c\n" * 20, "07:00:00.000 -> hello\n" * 20, "A: 1, 2, 3 g\n" * 20])
def test_text_that_holds_no_two_sensors_is_refused(text: str) -> None:
    with pytest.raises(FusionError):
        read_text(text)


# What a refusal of a whole file says.


def test_rows_of_one_sensor_each_are_not_called_acceleration_only() -> None:
    rows = "".join(f"{k},accelerometer,0.1,0.2,9.8\n{k},gyroscope,0.1,0.2,0.3\n" for k in range(200))

    with pytest.raises(SeparateLines) as refusal:
        read_text("time_ms,sensor,x,y,z\n" + rows)

    assert refusal.value.facts == {"list": "time_ms,sensor,x,y,z"}


def test_a_zip_with_one_sensor_is_not_asked_for_a_zip() -> None:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr("a.csv", "time (s),X (g),Y (g),Z (g)\n" + "0.1,0,0,1\n" * 50)

    with pytest.raises(NoGyroscope) as refusal:
        read_text(packed.getvalue(), "a.zip")

    assert refusal.value.facts["cure"] == "both in the zip"


@pytest.mark.parametrize(("name", "device"), [("shift.mtb", "Xsens MT"), ("shift.ximu3", "x-io x-IMU3")])
def test_a_format_of_a_device_with_a_gyroscope_is_named(name: str, device: str) -> None:
    with pytest.raises(UnsupportedFormat) as refusal:
        read_text(bytes(range(256)) * 20, name)

    assert refusal.value.facts["device"] == device


# Layouts of public projects.


def test_a_colon_before_the_milliseconds_is_read() -> None:
    check_whole(read_text(f"time,{CHANNELS}\n" + make_rows("2026-03-02 {colon},{row}")))


def test_sensor_log_of_an_iphone_is_read() -> None:
    names = [f"accelerometerAcceleration{axis}(G)" for axis in "XYZ"]
    names += [f"gyroRotation{axis}(rad/s)" for axis in "XYZ"]
    layout = find_layout("loggingTime(txt)," + ",".join(names) + "\n" + make_rows("2026-03-02 {clock},{row}"))

    assert layout is not None
    assert [column.channel for column in layout.columns[1:]] == [*["acc"] * 3, *["gyr"] * 3]
    assert [column.unit for column in layout.columns[1:]] == [*["g"] * 3, *["rad/s"] * 3]


@pytest.mark.parametrize(
    "names", ["alpha,gyroscope_beta,gyroscope_gamma", "Yaw,GYROSCOPE Pitch,GYROSCOPE Roll"]
)
def test_a_gyroscope_with_other_axes_is_not_called_absent(names: str) -> None:
    header = f"time_ms,accelerometer_x,accelerometer_y,accelerometer_z,gyroscope_{names}\n"

    with pytest.raises(UnknownColumns) as refusal:
        read_text(header + make_rows("{ms},{row}"))

    assert refusal.value.facts["missing"] == "gx, gy, gz"


def test_a_log_of_several_kinds_of_lines_is_not_called_empty() -> None:
    header = "$COL,IMU,time,wx,wy,wz,ax,ay,az\n$UNIT,IMU,s,deg/s,deg/s,deg/s,g,g,g\n$DATA\n"

    with pytest.raises(UnknownColumns) as refusal:
        read_text(header + make_rows("$IMU,{ms},{row}\n$BARO,{ms},101325.0"))

    assert refusal.value.facts["why"] == "kinds of lines"


def test_a_table_that_begins_like_a_picture_is_read() -> None:
    check_whole(read_text(f"BMI,time_ms,{CHANNELS}\n" + make_rows("24,{ms},{row}")))
