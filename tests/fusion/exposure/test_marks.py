"""A mark of the diary shows the 15 minutes before it beside the rest; it divides and excludes nothing."""

import io
from dataclasses import replace

import numpy as np
import pytest

from acromion.fusion.diary import DiaryEntry, read_diary
from acromion.fusion.errors import UnusableDiary
from acromion.fusion.exposure.periods import Mark, place_diary
from acromion.fusion.exposure.types import PartExposure
from acromion.fusion.pipeline import Analysis, analyse_angles
from acromion.fusion.settings import AnalysisSettings

MINUTE_S = 60
HOUR_US = 3_600_000_000


def analyse_hours(*diary: DiaryEntry) -> Analysis:
    """Analyse two hours at 1 Hz: 10 deg, but 70 deg in each odd minute from 41 to 59."""
    seconds = np.arange(7200)
    minute = seconds // MINUTE_S
    angle = np.where((minute >= 40) & (minute < 60) & (minute % 2 == 1), 70, 10)
    lines = (f"{i},{angle[i]}\n" for i in seconds)
    table = io.BytesIO(f"time_s,elevation_deg\n{''.join(lines)}".encode())
    return analyse_angles(table, settings=AnalysisSettings(diary=diary))


def describe(part: PartExposure) -> tuple[float, float, float | None]:
    return part.analysed_s, part.time_above_percent[60], part.entries_above_60_per_h


def test_a_mark_shows_the_quarter_of_an_hour_before_it_and_the_rest_of_the_day() -> None:
    before, rest = analyse_hours(DiaryEntry(3600.0, None, "mark", "Pain")).exposure.by_mark

    assert (before.kind, before.label, before.start_s, before.end_s) == ("mark", "Pain", 2700.0, 3600.0)
    # minutes 45 to 59: raised in 45, 47, ... 59: 8 of 15; the arm is up at the start and rises 8 times
    assert describe(before) == pytest.approx((900.0, 100 * 8 / 15, 8 * 4.0))
    assert before.percentiles_deg[50] == pytest.approx(70.0, abs=0.1)
    # the other 105 minutes: raised in 41 and 43
    assert (rest.kind, rest.label) == ("rest", "")
    assert describe(rest) == pytest.approx((6300.0, 100 * 2 / 105, 2 * 3600 / 6300))
    assert rest.percentiles_deg[50] == pytest.approx(10.0, abs=0.1)


def test_a_mark_changes_no_other_figure() -> None:
    plain, marked = analyse_hours(), analyse_hours(DiaryEntry(3000.5, None, "mark", "Pain"))

    assert plain.exposure.analysed_s == marked.exposure.analysed_s
    assert plain.exposure.time_above == marked.exposure.time_above
    assert plain.exposure.entries == marked.exposure.entries
    assert plain.exposure.by_period == marked.exposure.by_period == ()
    assert plain.exclusions == marked.exclusions == ()


def test_only_analysed_time_counts_before_a_mark() -> None:
    diary = DiaryEntry(2700.0, 3300.0, "break"), DiaryEntry(3600.0, None, "mark")

    before, rest = analyse_hours(*diary).exposure.by_mark

    assert before.analysed_s == 300.0
    assert rest.analysed_s == 6300.0


def test_an_early_mark_has_a_shorter_window_and_the_rest_lies_outside_all_windows() -> None:
    diary = DiaryEntry(300.0, None, "mark"), DiaryEntry(600.0, None, "mark"), DiaryEntry(7200.0, None, "mark")

    *before, rest = analyse_hours(*diary).exposure.by_mark

    assert [part.analysed_s for part in before] == [300.0, 600.0, 900.0]
    assert rest.analysed_s == 7200.0 - 600.0 - 900.0


def test_a_mark_ends_no_row_and_its_own_end_is_ignored() -> None:
    entries = read_diary(
        b"time,event,label,end\n08:00,Painting,,\n08:30,pain,left,08:40\n09:00,Sanding,,\n09:30,end,,\n"
    )
    start = analyse_hours().recording.start

    assert [(e.kind, e.label, e.end) for e in entries] == [
        ("task", "Painting", None),
        ("mark", "left", None),
        ("task", "Sanding", "09:30:00"),
    ]
    assert start is None
    seconds = tuple(replace(e, start=s, end=None) for e, s in zip(entries, (0.0, 600.0, 1200.0), strict=True))
    placed = place_diary(seconds, None, HOUR_US)
    assert [(p.start_us // 10**6, p.end_us // 10**6) for p in placed.periods] == [(0, 1200), (1200, 3600)]
    assert placed.marks == (Mark(600_000_000, "left"),)


def test_a_mark_outside_the_recording_is_left_aside_with_a_caveat() -> None:
    inside, outside = DiaryEntry(60.0, None, "mark"), DiaryEntry(7200.0, None, "mark", line=3)

    assert [flag.code for flag in place_diary([inside, outside], None, HOUR_US).flags] == ["W-DIARY"]
    with pytest.raises(UnusableDiary) as refusal:
        place_diary([outside], None, HOUR_US)
    assert (refusal.value.facts["line"], refusal.value.facts["why"]) == (3, "outside recording")
