"""The posture divides the figures: seated, upright, and the time whose posture is not stated."""

import io

import numpy as np
import pytest

from acromion.fusion.diary import DiaryEntry, read_diary
from acromion.fusion.errors import UnusableDiary
from acromion.fusion.exposure.types import PartExposure
from acromion.fusion.pipeline import Analysis, analyse_angles
from acromion.fusion.settings import AnalysisSettings

HOUR_S = 3600.0


def analyse_hours(*diary: DiaryEntry) -> Analysis:
    """Analyse two hours at 1 Hz: 10 deg; 70 deg in the minutes 0 to 9; 100 deg in the minutes 60 to 89."""
    minute = np.arange(7200) // 60
    angle = np.where(minute < 10, 70, np.where((minute >= 60) & (minute < 90), 100, 10))
    lines = (f"{i},{angle[i]}\n" for i in range(7200))
    table = io.BytesIO(f"time_s,elevation_deg\n{''.join(lines)}".encode())
    return analyse_angles(table, settings=AnalysisSettings(diary=diary))


def describe(part: PartExposure) -> tuple[str, float, float | None, float | None, float | None]:
    above = part.time_above_percent
    return part.kind, part.analysed_s, above.get(30), above.get(60), above.get(90)


def test_seated_upright_and_unstated_time_add_up_to_the_analysed_time() -> None:
    diary = DiaryEntry(0.0, 1800.0, "seated"), DiaryEntry(HOUR_S, 5400.0, "upright")

    exposure = analyse_hours(*diary).exposure

    assert [describe(part) for part in exposure.by_posture] == [
        ("seated", 1800.0, pytest.approx(100 / 3), pytest.approx(100 / 3), 0.0),
        ("upright", 1800.0, 100.0, 100.0, 100.0),
        ("unstated", 3600.0, 0.0, 0.0, 0.0),
    ]


def test_rises_count_in_the_posture_in_which_they_begin() -> None:
    diary = DiaryEntry(0.0, 1800.0, "seated"), DiaryEntry(3000.0, 5400.0, "upright")

    seated, upright, unstated = analyse_hours(*diary).exposure.by_posture

    assert seated.entries_above_60_per_h == 0.0  # the arm is up at the start
    assert upright.entries_above_60_per_h == pytest.approx(3600 / 2400)
    assert unstated.entries_above_60_per_h == 0.0


def test_without_a_posture_nothing_is_divided() -> None:
    assert analyse_hours(DiaryEntry(0.0, 1800.0, "task", "Painting")).exposure.by_posture == ()


def test_a_posture_not_stated_is_never_filled() -> None:
    seated, upright, unstated = analyse_hours(DiaryEntry(0.0, 1800.0, "upright")).exposure.by_posture

    assert describe(seated) == ("seated", 0.0, None, None, None)
    assert (upright.analysed_s, unstated.analysed_s) == (1800.0, 5400.0)


def test_excluded_time_has_no_posture() -> None:
    diary = DiaryEntry(0.0, 1800.0, "seated"), DiaryEntry(0.0, 900.0, "break")

    seated, _, unstated = analyse_hours(*diary).exposure.by_posture

    assert (seated.analysed_s, unstated.analysed_s) == (900.0, 5400.0)


def test_supported_time_keeps_its_posture() -> None:
    diary = DiaryEntry(0.0, 1800.0, "seated"), DiaryEntry(0.0, 600.0, "supported")

    exposure = analyse_hours(*diary).exposure

    assert exposure.by_posture[0].analysed_s == 1800.0
    assert [(part.kind, part.analysed_s) for part in exposure.by_period] == [
        ("supported", 600.0),
        ("work", 6600.0),
    ]


@pytest.mark.parametrize("label", ["", "sitting"])
def test_a_stated_posture_is_no_task_and_leaves_the_task_whole(label: str) -> None:
    diary = DiaryEntry(0.0, HOUR_S, "task", "Painting"), DiaryEntry(0.0, 1800.0, "seated", label)

    exposure = analyse_hours(*diary).exposure

    assert [(part.label, part.analysed_s) for part in exposure.by_task] == [
        ("Painting", HOUR_S),
        ("", HOUR_S),
    ]
    assert exposure.by_posture[0].analysed_s == 1800.0


def test_seated_time_with_a_name_is_a_task_too() -> None:
    exposure = analyse_hours(DiaryEntry(0.0, 1800.0, "seated", "Paperwork")).exposure

    assert (exposure.by_task[0].label, exposure.by_task[0].analysed_s) == ("Paperwork", 1800.0)
    assert exposure.by_posture[0].analysed_s == 1800.0


def test_words_for_an_upright_posture() -> None:
    rows = b"time,event\n08:00,upright\n09:00,debout\n10:00,Standing\n11:00,walking\n"

    assert [entry.kind for entry in read_diary(rows)] == ["upright"] * 4


def test_a_day_in_one_posture_has_the_ranges_of_the_day() -> None:
    exposure = analyse_hours(DiaryEntry(0.0, 7200.0, "upright")).exposure
    upright = exposure.by_posture[1]

    assert upright.percentiles_deg[50] == exposure.percentiles_deg[50]
    assert [upright.intervals[f"time_above_{c}_percent"] for c in (30, 60, 90)] == [
        above.interval for above in exposure.time_above
    ]


def test_overlapping_stated_postures_are_refused_with_both_lines() -> None:
    diary = DiaryEntry(0.0, 360.0, "seated", line=2), DiaryEntry(180.0, 480.0, "upright", line=3)

    with pytest.raises(UnusableDiary) as refused:
        analyse_hours(*diary)

    assert (refused.value.facts["line"], refused.value.facts["other"]) == (3, 2)
