"""Day and month: settled by the dates, by a person, or by the header's start; else refused or said."""

import gzip
from datetime import datetime

import pytest

from fusion.errors import UnusableTime
from tests.badfiles.table_files import calendar_table, resaved
from tests.fusion.readers.seen import codes
from tests.fusion.readers.tables.table_builder import read_text

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


@pytest.mark.parametrize("pattern", ["%d/%m/%y %H:%M:%S.%f", DAY_FIRST])
def test_what_nothing_settles_is_asked_for(pattern: str) -> None:
    with pytest.raises(UnusableTime) as refusal:
        read_text(calendar_table(pattern, SECOND_OF_MARCH))

    assert refusal.value.facts == {"why": "date-order"}


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


@pytest.mark.parametrize("pattern", [DAY_FIRST, MONTH_FIRST], ids=["day first", "month first"])
@pytest.mark.parametrize("word", ["M/d/yyyy", "dd/MM/yyyy"])
def test_midnight_goes_before_the_format_of_the_header(pattern: str, word: str) -> None:
    first = datetime(2026, 3, 3, 23, 59, 30)  # noqa: DTZ001

    recording = read_text(resaved(pattern, first, "03/03/2026", word))

    assert (recording.start, recording.duration_us) == (first, 60_000_000)
    assert codes(recording) == ["W-LOCALE"]


def test_midnight_in_a_packed_table_settles_day_and_month() -> None:
    first = datetime(2026, 3, 3, 23, 59, 30)  # noqa: DTZ001
    packed = gzip.compress(resaved(DAY_FIRST, first, "03/03/2026").encode())

    assert read_text(packed, "shift.csv.gz").start == first
