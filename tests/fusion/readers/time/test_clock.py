"""Clocks: midnight, daylight saving, steps, never set. Durations come from the samples."""

import gzip
from datetime import datetime, timedelta

import pytest

from acromion.fusion.readers import read_recording
from acromion.fusion.recording import Recording
from tests.badfiles.table_files import calendar_table, resaved
from tests.fusion.readers.gt3x.gt3x_builder import INFO, TORONTO, count_utc, pack, record, schema, second
from tests.fusion.readers.seen import codes
from tests.fusion.readers.tables.table_builder import read_text

ISO = "%Y-%m-%dT%H:%M:%S.%f"


def utc_shift(first_unix_s: int, zone: str = TORONTO) -> Recording:
    """Forty seconds of a file that counts UTC and names its zone."""
    rows = b"".join(second(first_unix_s + k) for k in range(40))
    return read_recording(pack(count_utc(first_unix_s, zone) + rows, INFO))


@pytest.mark.parametrize(
    ("change", "offset_h", "step_s"),
    [(1_793_512_800, -4, -3600), (1_805_007_600, -5, 3600)],
    ids=["2026-11-01 back", "2027-03-14 forward"],
)
def test_a_file_that_counts_utc_follows_its_zone(change: int, offset_h: int, step_s: int) -> None:
    recording = utc_shift(change - 20)

    (flag,) = recording.flags
    assert recording.start is not None
    assert recording.start.utcoffset() == timedelta(hours=offset_h)
    assert recording.duration_us == 40_000_000
    assert (flag.code, flag.first_s, flag.facts) == ("W-DST", 20.0, {"step_s": step_s})


def test_an_unknown_zone_keeps_the_offset_of_the_file() -> None:
    recording = utc_shift(1_793_512_800 - 20, zone="(UTC-05:00) Nowhere")

    assert recording.start is not None
    assert recording.start.utcoffset() == timedelta(hours=-5)
    assert codes(recording) == []


def test_the_clock_of_an_actilife_file_has_no_jump() -> None:
    log = record(24, 1_793_498_380, schema())
    log += b"".join(second(1_793_498_380 + k) for k in range(40))  # 2026-11-01 01:59:40 on the wall

    recording = read_recording(pack(log))

    assert recording.duration_us == 40_000_000
    assert codes(recording) == []


def test_a_clock_that_was_never_set_gives_no_start() -> None:
    recording = read_text(calendar_table(ISO, datetime(2000, 1, 1, 0, 0, 5)))  # noqa: DTZ001

    assert recording.start is None
    assert codes(recording) == ["W-CLOCK-UNSET"]


def test_a_start_in_the_preamble_that_the_rows_contradict_is_said_and_not_believed() -> None:
    first = datetime(2026, 3, 2, 8)  # noqa: DTZ001

    recording = read_text("# start: 2026-03-02T09:30:00-05:00\n" + calendar_table(ISO, first))

    (flag,) = recording.flags
    assert f"{recording.start:%H:%M:%S %z}" == "08:00:00 -0500"
    assert (flag.code, flag.facts["header"]) == ("W-START", "2026-03-02 09:30:00")


def test_a_start_in_the_preamble_gives_the_rows_their_offset() -> None:
    first = datetime(2026, 3, 2, 8)  # noqa: DTZ001

    recording = read_text("# start: 2026-03-02T08:00:00-05:00\n" + calendar_table(ISO, first))

    assert (recording.time_zone, codes(recording)) == ("UTC-05:00", [])


# Day and month: settled by the dates, by a person, or by the header's start; else refused or said.

SECOND_OF_MARCH = datetime(2026, 3, 2, 7)  # noqa: DTZ001
DAY_FIRST, MONTH_FIRST = "%d/%m/%Y %H:%M:%S.%f", "%m/%d/%Y %H:%M:%S.%f"


@pytest.mark.parametrize("pattern", [DAY_FIRST, MONTH_FIRST], ids=["day first", "month first"])
@pytest.mark.parametrize(
    ("date", "order"), [("3/2/2026", "M/d/yyyy"), ("02/03/2026", "dd/MM/yyyy"), ("2026-03-02", "yyyy-MM-dd")]
)
def test_the_start_in_the_header_settles_day_and_month(date: str, order: str, pattern: str) -> None:
    recording = read_text(resaved(pattern, SECOND_OF_MARCH, date, order))

    assert (recording.start, codes(recording)) == (SECOND_OF_MARCH, ["W-LOCALE"])


def test_rows_that_begin_a_day_after_the_header_are_settled_too() -> None:
    recording = read_text(resaved(DAY_FIRST, SECOND_OF_MARCH, "3/1/2026"))

    assert recording.start == SECOND_OF_MARCH


def test_a_header_that_fits_neither_reading_is_said() -> None:
    recording = read_text(resaved(DAY_FIRST, SECOND_OF_MARCH, "9/9/2025"))

    flag = next(flag for flag in recording.flags if flag.code == "W-DATE-ORDER")
    assert recording.start == datetime(2026, 2, 3, 7)  # noqa: DTZ001 - as the header's M/d/yyyy says
    assert flag.facts == {"date": "2026-02-03"}


def test_a_format_that_the_headers_own_date_belies_is_not_believed() -> None:
    first = datetime(2026, 12, 9, 7)  # noqa: DTZ001

    recording = read_text(resaved(MONTH_FIRST, first, "11/28/2026", "dd/MM/yyyy"))

    assert recording.start == first


@pytest.mark.parametrize("pattern", [DAY_FIRST, MONTH_FIRST], ids=["day first", "month first"])
def test_the_start_of_a_preamble_settles_day_and_month(pattern: str) -> None:
    text = "# start: 2026-03-02T07:00:00-05:00\n" + calendar_table(pattern, SECOND_OF_MARCH)

    assert read_text(text).duration_us == 60_000_000


@pytest.mark.parametrize(
    ("pattern", "date"),
    [
        ("%d/%m/%y %H:%M:%S.%f", "3/2/2026"),
        ("%m/%d/%y %H:%M:%S.%f", "3/2/26"),
        ("%y-%m-%d %H:%M:%S.%f", "3/2/26"),
    ],
)
def test_a_year_of_two_digits_is_settled_by_the_header(pattern: str, date: str) -> None:
    assert read_text(resaved(pattern, SECOND_OF_MARCH, date)).start == SECOND_OF_MARCH


@pytest.mark.parametrize(
    ("pattern", "first"),
    [
        ("%d/%m/%y %H:%M:%S.%f", datetime(2032, 3, 14, 8)),  # noqa: DTZ001 - no month has 32 days
        (DAY_FIRST, datetime(2026, 3, 14, 7)),  # noqa: DTZ001
        (DAY_FIRST, datetime(2026, 3, 2, 23, 59, 30)),  # noqa: DTZ001 - over midnight
        (MONTH_FIRST, datetime(2026, 3, 3, 23, 59, 30)),  # noqa: DTZ001
    ],
)
def test_dates_that_can_be_read_one_way_need_no_header(pattern: str, first: datetime) -> None:
    assert read_text(calendar_table(pattern, first)).start == first


def test_midnight_in_a_packed_table_settles_day_and_month() -> None:
    first = datetime(2026, 3, 3, 23, 59, 30)  # noqa: DTZ001
    packed = gzip.compress(resaved(DAY_FIRST, first, "03/03/2026").encode())

    assert read_text(packed, "shift.csv.gz").start == first
