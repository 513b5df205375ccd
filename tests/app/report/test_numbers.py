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


def test_percent_has_one_decimal_always() -> None:
    assert [format_percent(x, "en") for x in (0, 7.55, 100)] == [f"0.0{N}%", f"7.5{N}%", f"100.0{N}%"]


def test_french_has_the_decimal_comma() -> None:
    assert format_percent(7.6, "fr") == "7,6\u00a0%"


def test_thousands_are_grouped_with_a_narrow_space() -> None:
    assert format_number(28740.5, 1, "fr") == f"28{N}740,5"


def test_a_small_negative_number_is_not_minus_zero() -> None:
    assert format_number(-0.04, 1, "en") == "0.0"


def test_a_negative_number_has_a_true_minus() -> None:
    assert format_number(-3.2, 1, "en") == "−3.2"


@pytest.mark.parametrize("value", [None, float("nan"), float("inf")])
def test_what_cannot_be_computed_is_a_dash(value: float | None) -> None:
    assert format_number(value, 1, "en") == "–"


def test_degrees_are_whole() -> None:
    assert format_angle(54.4, "fr") == "54°"


def test_seconds_are_exact_without_closing_zeros() -> None:
    assert format_exact(24492.3456, "en") == f"24{N}492.3456"


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
def test_a_narrow_range_of_lengths_holds_what_it_is_the_range_of(
    low_s: float, high_s: float, told: str
) -> None:
    assert " ".join(format_duration_range(Interval(low_s, high_s), "en").split()) == told


def test_the_time_account_is_told_to_the_second() -> None:
    assert format_long_duration(24492.4) == f"6{N}h\u00a048{N}min\u00a012{N}s"


def test_clock_times() -> None:
    moment = datetime(2026, 3, 3, 10, 42, 5, tzinfo=UTC)

    assert [format_clock(moment, "en"), format_clock(moment, "fr")] == ["10:42", f"10{N}h{N}42"]


def test_a_whole_hour_is_short_on_a_french_axis() -> None:
    assert format_hour(datetime(2026, 3, 3, 8, tzinfo=UTC), "fr") == f"8{N}h"


def test_dates_cannot_be_misread() -> None:
    told = [format_date(date(2026, 3, 3), "en"), format_date(date(2026, 8, 1), "fr")]

    assert told == ["3\u00a0March\u00a02026", "1er\u00a0août\u00a02026"]


def test_rates_are_whole_from_ten_on() -> None:
    assert [format_rate(x, "en") for x in (31.7, 8.61)] == ["32", "8.6"]


def test_elapsed_time() -> None:
    assert format_elapsed(3725) == "1:02:05"


def test_without_a_clock_time_is_told_from_the_first_sample() -> None:
    assert Clock(None, "fr").format(3725) == "1:02:05"


def test_a_zone_with_daylight_saving_is_followed() -> None:
    start = datetime(2027, 3, 14, 1, 30, tzinfo=ZoneInfo("America/Toronto"))

    assert Clock(start, "en").format(3600) == "03:30"


def test_a_device_clock_counts_on() -> None:
    start = datetime(2027, 3, 14, 1, 30)  # noqa: DTZ001 - a device clock has no zone

    assert Clock(start, "en").format(3600) == "02:30"


def test_the_first_whole_hour_of_the_axis() -> None:
    assert Clock(datetime(2026, 3, 3, 7, 58, 12, tzinfo=UTC)).seconds_to_whole_hour() == 108.0
