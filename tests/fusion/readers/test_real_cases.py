"""Layouts that people meet, made from one simulated recording of a right arm."""

import zipfile
from collections.abc import Callable
from datetime import datetime, timedelta
from functools import cache
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest

from acromion.fusion.errors import SeveralSensors, UnknownColumns, UnusableTime
from acromion.fusion.pipeline import analyse
from acromion.fusion.readers import ColumnProfile, parse_profile, read_recording
from acromion.fusion.readers.tables.columns import DateOrder
from acromion.fusion.recording import Recording

pytestmark = pytest.mark.real_recordings

FIRST_ROW_G = (-0.082, 0.984, -0.023)
FIRST_ROW_DPS = (-0.427, 0.977, -0.854)
"""Of the recording that all these files were made from."""


@pytest.fixture
def read_case(shared_data: Callable[[str], Path]) -> Callable[..., Recording]:
    return lambda name, **asked: read_once(shared_data(f"cases/{name}"), **asked)


@cache
def read_once(path: Path, profile: ColumnProfile | None = None) -> Recording:
    return read_recording(path, profile=profile)


def check_first_row(recording: Recording, gravity: float = 1.0) -> None:
    first = recording.segments[0]
    np.testing.assert_allclose(first.acc_g[0], gravity * np.array(FIRST_ROW_G), atol=0.003)
    np.testing.assert_allclose(first.gyr_dps[0], FIRST_ROW_DPS, atol=0.35)


def test_gravity_is_added_to_the_acceleration_of_a_watch(read_case: Callable[..., Recording]) -> None:
    recording = read_case("core_motion_watch.csv")

    check_first_row(recording)
    assert recording.duration_us == 360_000_000


MONITOR = ColumnProfile((2, 3, 4), (5, 6, 7), "g", "dps", time=1)
NAMED = ColumnProfile(("p", "q", "r"), ("u", "v", "w"), "g", "dps", time="k", time_unit="s")
WHOLE_S = (124.2, 28.4, 14.4)


@pytest.mark.parametrize(
    ("name", "profile", "true_s", "within_s"),
    [
        ("core_motion_watch.csv", None, WHOLE_S, 0.1),
        ("phone_and_watch.zip", ColumnProfile(sensor="WristMotion"), WHOLE_S, 0.1),
        ("sim_2dec.csv", None, WHOLE_S, 0.4),
        ("sim_2dec_nounit.csv", None, WHOLE_S, 0.4),
        ("words_profile.csv", NAMED, WHOLE_S, 0.1),
        ("openlog_03_02.TXT", ColumnProfile(date_order="dmy"), WHOLE_S, 0.1),
        ("openlog_day25_dropouts.TXT", None, (115.9, 26.1, 14.4), 0.4),
        ("monitor_csv.txt", MONITOR, WHOLE_S, 0.1),
        ("monitor_csv_millis.txt", None, WHOLE_S, 0.1),
        ("polar_sense.zip", None, WHOLE_S, 0.2),
        ("shimmer_local_flux.csv", None, (0.0, 0.0, 0.0), 0.1),
        ("metawear.zip", None, WHOLE_S, 0.1),
        ("metawear_triplets.zip", None, WHOLE_S, 0.1),
        ("lsm_one_sensor_a_line.txt", None, (66.5, 18.3, 12.4), 0.5),
        ("apdm_format7.csv", ColumnProfile(sensor="Right Upper Arm"), (36.3, 17.7, 12.1), 0.4),
        ("mac_zip.zip", None, WHOLE_S, 0.1),
        ("dot_start_time.csv", None, (75.5, 20.5, 14.4), 0.1),
    ],
)
def test_the_time_above_30_60_and_90_degrees_is_that_of_the_arm(
    read_case: Callable[..., Recording],
    name: str,
    profile: ColumnProfile | None,
    true_s: tuple[float, float, float],
    within_s: float,
) -> None:
    """Known of the whole six minutes; of a part, they are the whole recording's without the rest.

    Two decimals, and fewer samples a second, move angles near 30 degrees.
    """
    exposure = analyse(read_case(name, profile=profile)).exposure

    percents = {one.threshold_deg: one.percent for one in exposure.time_above}
    above_s = tuple(percents[deg] / 100.0 * exposure.analysed_s for deg in (30, 60, 90))
    assert above_s == pytest.approx(true_s, abs=within_s)


@pytest.mark.parametrize("name", ["words_profile.csv", "monitor_csv.txt"])
def test_without_names_that_are_known_a_person_is_asked(
    read_case: Callable[..., Recording], name: str
) -> None:
    with pytest.raises(UnknownColumns):
        read_case(name)


@pytest.mark.parametrize("name", ["sim_2dec.csv", "sim_2dec_nounit.csv"])
def test_two_decimals_without_a_unit_lose_nothing(read_case: Callable[..., Recording], name: str) -> None:
    recording = read_case(name)

    assert recording.excluded == ()
    assert recording.duration_us == 360_000_000


def test_a_phone_and_a_watch_are_both_offered(read_case: Callable[..., Recording]) -> None:
    with pytest.raises(SeveralSensors) as refusal:
        read_case("phone_and_watch.zip")

    assert refusal.value.facts["list"] == "WristMotion, Accelerometer"
    check_first_row(read_case("phone_and_watch.zip", profile=ColumnProfile(sensor="WristMotion")))


@pytest.mark.parametrize(
    ("name", "rate_hz", "duration_s"),
    [
        ("mac_zip.zip", 100.0, 360.0),
        ("metawear.zip", 100.0, 360.0),
        ("metawear_triplets.zip", 100.0, 360.0),
        ("polar_sense.zip", 52.0, 360.0),
    ],
)
def test_archives_are_read(
    read_case: Callable[..., Recording], name: str, rate_hz: float, duration_s: float
) -> None:
    recording = read_case(name)

    check_first_row(recording)
    assert recording.rate_hz == pytest.approx(rate_hz, abs=0.001)
    assert recording.duration_us / 1e6 == pytest.approx(duration_s, abs=0.03)
    assert not {"W-ROWS-DROPPED", "W-GAP"} & {flag.code for flag in recording.flags}


def test_a_column_of_words_does_not_stop_a_profile(
    read_case: Callable[..., Recording], shared_data: Callable[[str], Path]
) -> None:
    profile = parse_profile(shared_data("cases/words_profile.json").read_text())

    check_first_row(read_case("words_profile.csv", profile=profile))


def test_a_date_and_a_time_in_two_columns_show_the_gaps(read_case: Callable[..., Recording]) -> None:
    recording = read_case("openlog_day25_dropouts.TXT")

    (gap,) = [flag for flag in recording.flags if flag.code == "W-GAP"]
    assert (recording.duration_us, gap.count) == (360_000_000, 6)
    assert gap.seconds == pytest.approx(24.0)
    assert f"{recording.start:%Y-%m-%d %H:%M}" == "2026-03-25 07:00"


@pytest.mark.parametrize(("order", "day"), [("dmy", "2026-02-03"), ("mdy", "2026-03-02")])
def test_an_open_order_of_day_and_month_is_asked_for(
    read_case: Callable[..., Recording], order: DateOrder, day: str
) -> None:
    with pytest.raises(UnusableTime) as refusal:
        read_case("openlog_03_02.TXT")

    recording = read_case("openlog_03_02.TXT", profile=ColumnProfile(date_order=order))

    assert refusal.value.facts == {"why": "date-order"}
    assert f"{recording.start:%Y-%m-%d}" == day
    check_first_row(recording)


def test_the_time_of_a_serial_monitor_is_stripped(read_case: Callable[..., Recording]) -> None:
    for recording in (read_case("monitor_csv_millis.txt"), read_case("monitor_csv.txt", profile=MONITOR)):
        check_first_row(recording)
        assert recording.duration_us == 360_000_000


def test_a_row_of_units_counts_cell_by_cell(read_case: Callable[..., Recording]) -> None:
    recording = read_case("shimmer_local_flux.csv")

    check_first_row(recording)
    assert (recording.stated.acc_unit, recording.stated.gyr_unit) == ("m/s2", "deg/s")


def test_lines_of_one_sensor_each_make_rows(read_case: Callable[..., Recording]) -> None:
    """50 Hz; each fourth line ends a sample: 38,504 lines and 9626 rows."""
    recording = read_case("lsm_one_sensor_a_line.txt")

    check_first_row(recording)
    assert sum(map(len, recording.segments)) == 9626
    assert recording.rate_hz == pytest.approx(50.0, abs=0.001)


def test_names_over_several_columns_name_the_sensors(read_case: Callable[..., Recording]) -> None:
    with pytest.raises(SeveralSensors) as refusal:
        read_case("apdm_format7.csv")

    assert refusal.value.facts == {"n": 2, "list": "Chest, Right Upper Arm"}
    check_first_row(read_case("apdm_format7.csv", profile=ColumnProfile(sensor="Right Upper Arm")))


def test_a_start_time_above_the_table_is_a_clock(read_case: Callable[..., Recording]) -> None:
    start = read_case("dot_start_time.csv").start

    assert start is not None
    assert start.isoformat() == "2026-03-02T07:00:00.086000+01:00"


@pytest.mark.parametrize("names", ["date,ms", "time,ms", "seconds,usec", "hour,minute,second,ms"])
def test_the_part_of_a_second_is_no_time_of_its_own(shared_data: Callable[[str], Path], names: str) -> None:
    """Its column starts over each second: no gap would show, and each second would be a segment."""
    forms = {"date": "%Y-%m-%d %H:%M:%S", "time": "%H:%M:%S", "seconds": "%s", "hour": "%H,%M,%S"}
    table = write_parts(shared_data, names, forms[names.split(",", maxsplit=1)[0]])

    recording = read_recording(table)

    (gap,) = [flag for flag in recording.flags if flag.code == "W-GAP"]
    assert gap.seconds == pytest.approx(4.0, abs=0.02)
    assert "W-CLOCK-BACK" not in {flag.code for flag in recording.flags}
    assert recording.duration_us / 1e6 == pytest.approx(360.0, abs=0.02)


def write_parts(shared_data: Callable[[str], Path], names: str, form: str) -> BytesIO:
    """Write whole seconds and the part of the second in columns of their own, with a gap of 4 s."""
    lines = shared_data("cases/monitor_csv_millis.txt").read_text().splitlines()
    begun, rows = datetime(2026, 3, 2, 7), []  # noqa: DTZ001 (the file has no zone)
    for k, line in enumerate(lines[1:]):
        moment = begun + timedelta(milliseconds=10 * k)
        stamp = str(1772434800 + k // 100) if form == "%s" else moment.strftime(form)
        part = moment.microsecond // (1 if names.endswith("usec") else 1000)
        rows.append(f"{stamp},{part},{line.split(',', 1)[1]}")
    header = f"{names},{lines[0].split(',', 1)[1]}"
    return BytesIO("\n".join([header, *rows[:5000], *rows[5400:]]).encode())


@pytest.mark.parametrize(("first", "stop", "missing_s"), [(5000, 8000, 30.0), (30_000, None, 0.0)])
def test_no_gravity_is_made_up_in_the_holes_of_its_table(
    shared_data: Callable[[str], Path], first: int, stop: int | None, missing_s: float
) -> None:
    """The acceleration there has no gravity; interpolated, it would give angles that nobody measured."""
    packed = BytesIO()
    with (
        zipfile.ZipFile(shared_data("cases/phone_and_watch.zip")) as source,
        zipfile.ZipFile(packed, "w") as archive,
    ):
        for name in ("Accelerometer.csv", "Gravity.csv", "Gyroscope.csv"):
            lines = source.read(name).decode().splitlines()
            if name == "Gravity.csv":
                lines[1 + first : stop if stop is None else 1 + stop] = []
            archive.writestr(name, "\n".join(lines))

    recording = read_recording(packed)

    gaps = [flag.seconds for flag in recording.flags if flag.code == "W-GAP"]
    assert sum(gaps) == pytest.approx(missing_s, abs=0.02)
    assert sum(map(len, recording.segments)) == pytest.approx(first if stop is None else 33_000, abs=6)
