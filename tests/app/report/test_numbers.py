"""Numbers, durations and times as the two languages write them."""

from datetime import UTC, date, datetime
from zoneinfo import ZoneInfo

import pytest

from app.report.words.numbers import (
    Clock,
    format_angle,
    format_clock,
    format_date,
    format_duration,
    format_duration_range,
    format_elapsed,
    format_exact,
    format_hour,
    format_long_duration,
    format_number,
    format_percent,
    format_rate,
)
from fusion.exposure.types import Interval

N = "\u202f"
MORNING = datetime(2026, 3, 3, 10, 42, 5, tzinfo=UTC)
TORONTO = datetime(2027, 3, 14, 1, 30, tzinfo=ZoneInfo("America/Toronto"))  # half an hour before summer time

WRITTEN = {
    "a percentage always has one decimal": (
        [format_percent(x, "en") for x in (0, 7.55, 100)],
        [f"0.0{N}%", f"7.5{N}%", f"100.0{N}%"],
    ),
    "French has a decimal comma": (format_percent(7.6, "fr"), "7,6\u00a0%"),
    "thousands are grouped with a narrow space": (format_number(28740.5, 1, "fr"), f"28{N}740,5"),
    "a small negative number is not minus zero": (format_number(-0.04, 1, "en"), "0.0"),
    "a negative number has a true minus": (format_number(-3.2, 1, "en"), "−3.2"),
    "a missing number is a dash": (
        [format_number(value, 1, "en") for value in (None, float("nan"), float("inf"))],
        ["–"] * 3,
    ),
    "degrees are whole": (format_angle(54.4, "fr"), "54°"),
    "exact seconds have no trailing zeros": (format_exact(24492.3456, "en"), f"24{N}492.3456"),
    "the time account is exact to the second": (
        format_long_duration(24492.4),
        f"6{N}h\u00a048{N}min\u00a012{N}s",
    ),
    "clock times": ([format_clock(MORNING, "en"), format_clock(MORNING, "fr")], ["10:42", f"10{N}h{N}42"]),
    "a whole hour is short on a French axis": (
        format_hour(datetime(2026, 3, 3, 8, tzinfo=UTC), "fr"),
        f"8{N}h",
    ),
    "dates are unambiguous": (
        [format_date(date(2026, 3, 3), "en"), format_date(date(2026, 8, 1), "fr")],
        ["3\u00a0March\u00a02026", "1er\u00a0août\u00a02026"],
    ),
    "rates are whole from ten on": ([format_rate(x, "en") for x in (31.7, 8.61)], ["32", "8.6"]),
    "elapsed time": (format_elapsed(3725), "1:02:05"),
    "without a clock, time counts from the first sample": (Clock(None, "fr").format(3725), "1:02:05"),
    "a zone with daylight saving is followed": (Clock(TORONTO, "en").format(3600), "03:30"),
    "a device clock counts on": (Clock(TORONTO.replace(tzinfo=None), "en").format(3600), "02:30"),
    "the axis begins with the first whole hour": (
        Clock(datetime(2026, 3, 3, 7, 58, 12, tzinfo=UTC)).seconds_to_whole_hour(),
        108.0,
    ),
}


@pytest.mark.parametrize("fact", WRITTEN)
def test_numbers_and_times_are_written_as_the_language_asks(fact: str) -> None:
    written, expected = WRITTEN[fact]

    assert written == expected


@pytest.mark.parametrize(
    ("seconds", "told"),
    [
        (0, f"0{N}s"),
        (4.24, f"4.2{N}s"),
        (9.96, f"10{N}s"),
        (48.3, f"48{N}s"),
        (179, f"2{N}min\u00a059{N}s"),
        (120, f"2{N}min"),
        (599.6, f"10{N}min"),
        (1860, f"31{N}min"),
        (24480, f"6{N}h\u00a048{N}min"),
        (3599, f"1{N}h"),
        (None, "–"),
    ],
)
def test_durations_have_the_two_units_that_matter(seconds: float | None, told: str) -> None:
    assert format_duration(seconds, "en") == told


@pytest.mark.parametrize(
    ("low_s", "high_s", "told"),
    [
        (40.2, 65.1, "40 s–1 min 5 s"),
        (21.3, 21.5, "21 s–22 s"),
        (65.1, 65.3, "1 min 5 s–1 min 6 s"),
        (4.22, 4.24, "4.2 s–4.3 s"),
    ],
)
def test_a_narrow_range_of_lengths_includes_its_figure(low_s: float, high_s: float, told: str) -> None:
    assert " ".join(format_duration_range(Interval(low_s, high_s), "en").split()) == told
