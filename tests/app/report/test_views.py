"""From an analysis to the values of a report: what is chosen, rounded and said."""

import re
from dataclasses import replace
from typing import Any

import pytest

from acromion.app.report.single.report import Report, build_report
from acromion.app.report.words.wording import LANGUAGES, Language
from acromion.fusion.exposure.types import Cycles, Entries, Episodes, Interval, PartExposure, PeakWindow
from acromion.fusion.quality import Quality, TimeAccount
from acromion.fusion.recording import QualityFlag
from tests.app.analysis_factory import (
    make_analysis,
    make_exposure,
    make_quality,
    make_subject,
    with_velocity,
)
from tests.app.report.report_reading import plain, report_of, section_of, table_of


def test_the_answer_in_english() -> None:
    assert [plain(sentence) for sentence in report_of().sentences] == [
        (
            "The right arm was above 60° for 7.6 % of the 7 h 5 min analysed: "
            "cannot tell whether this is below the proposed 10 %."
        ),
        (
            "Above 60° for 32 min; above 90° for 8 min 56 s (2.1 %). "
            "The right arm made 214 rises above 60° (30 per hour); "
            "longest stay until below 55°: 48 s, at 10:42."
        ),
        "The 15 minutes with the most time above 60° were 13:05–13:20 (41.2 %).",
    ]


RANGED = tuple(replace(item, interval=Interval(1.5, 2.8)) for item in make_exposure().time_above)
SENTENCES: dict[str, tuple[dict[str, Any], Language, int, str]] = {
    "a range above 60 deg": (
        {"time_above": make_exposure(above_60_interval=Interval(6.0, 9.5)).time_above},
        "fr",
        0,
        "7,6 % des 7 h 5 min analysées (6,0–9,5 %) : sous les 10 % proposés.",
    ),
    "a range above 90 deg": (
        {"time_above": RANGED},
        "en",
        1,
        "above 90° for 8 min 56 s (2.1 %; range 1.5–2.8 %).",
    ),
    "no hourly rate of a few minutes": (
        {"analysed_s": 179.0},
        "en",
        1,
        "The right arm made 214 rises above 60°;",
    ),
    "no rise": (
        {"entries": (Entries(60, 0, 0.0),), "episodes": (Episodes(60, 0, None, None, None, 0),)},
        "en",
        1,
        "The right arm made no rises above 60°.",
    ),
    "one rise in the singular": (
        {"entries": (Entries(60, 1, 0.14),), "episodes": (Episodes(60, 1, 12.0, 12.0, 60.0, 0),)},
        "fr",
        1,
        "un passage au-dessus de 60° ; durée jusqu'à moins de 55° : 12 s, à 7 h 59.",
    ),
    "too short for the window": (
        {"peak_windows": (PeakWindow(900, None, None),)},
        "en",
        2,
        "No 15-minute period has enough",
    ),
    "no time above in the worst window": (
        {"peak_windows": (PeakWindow(900, 0.0, 0.0),)},
        "en",
        2,
        "The arm was not above 60° in any 15 minutes.",
    ),
}


@pytest.mark.parametrize("case", SENTENCES)
def test_the_answer_follows_what_is_known(case: str) -> None:
    changes, language, number, told = SENTENCES[case]

    report = report_of(exposure=replace(make_exposure(), **changes), language=language)

    assert told in plain(report.sentences[number])


def test_no_interval_is_invented() -> None:
    report = report_of()

    cells = [cell for s in report.sections for t in s.tables for row in t.rows for cell in row[1:]]
    assert "range" not in " ".join(report.sentences)
    assert [cell for cell in cells if re.search(r"^[\d.,]+ \(\d", cell)] == []
    assert "In brackets" not in str([section.paragraphs for section in report.sections])


def test_a_figure_and_its_range_share_a_cell_with_the_upper_end_of_the_pose() -> None:
    report = report_of(exposure=make_exposure(above_60_interval=Interval(6.0, 9.5, 6.0, 12.3)))

    rows = table_of(report, "spread", "thresholds").rows

    assert [row[2] for row in rows] == ["32.5", "7.6 (6.0–9.5; pose 12.3)", "2.1"]
    assert section_of(report, "spread").paragraphs == (
        "In brackets: 95\u202f% range; pose: its upper end if the calibration pose read low.",
    )


def test_an_arm_of_unknown_side_is_the_arm() -> None:
    report = build_report(make_analysis(), make_subject(side=None), "fr")

    assert report.sentences[0].startswith("Le bras a dépassé 60°")


def test_without_a_clock_times_are_told_from_the_start() -> None:
    report = report_of(analysis=make_analysis(start=None))

    assert plain(report.sentences[2]).startswith(
        "The 15 minutes with the most time above 60° were 5:07:00–5:22:00 after the start"
    )
    assert report.made_of is None


def test_the_first_page_has_the_verdict_with_its_reason_its_date_and_what_was_not_analysed() -> None:
    report = report_of()

    assert (report.verdict.level, report.verdict.label) == ("caution", "Data quality: use with care.")
    assert report.verdict.reason.startswith("Holes in the recording.")
    assert plain(report.verdict.reason).endswith(" Not analysed: break 45 min, missing 9 min.")
    assert str(report.made_of) == "2026-03-03 15:57:12-05:00"
    assert report.amendment == ""


def test_every_other_grave_reason_is_named_with_its_time() -> None:
    flags = (QualityFlag("W-REMOUNT"), QualityFlag("W-GAP", 2, 1200.0), QualityFlag("W-DUP"))
    quality = Quality("caution", ("W-REMOUNT", "W-GAP"), flags)

    told = plain(report_of(analysis=make_analysis(quality=quality)).verdict.reason)
    assert told.startswith("No pose after the sensor moved. ")
    assert " Also: holes in the recording (20 min). " in told


def test_the_first_page_says_what_its_ranges_hold() -> None:
    ready = make_analysis(calibrated=False)
    drawn = replace(ready, exposure=replace(ready.exposure, intervals={"elevation_p50_deg": Interval(1, 2)}))

    notes = [report_of(analysis=analysis).range_note for analysis in (make_analysis(), drawn, ready)]
    assert "angle error only" in notes[0]
    assert "The error of these precomputed angles is not known" in notes[1]
    assert notes[2].startswith("No range is given")
    assert report_of(exposure=replace(make_exposure(), analysed_s=1799.9)).range_note == (
        "Less than half an hour was analysed: ranges and rates per hour are not given."
    )


def test_a_range_of_ready_angles_is_called_what_it_is() -> None:
    interval, ready = Interval(6.0, 9.5), make_analysis(calibrated=False)
    exposure = replace(make_exposure(above_60_interval=interval), intervals={"elevation_p50_deg": interval})

    report = report_of(analysis=replace(ready, exposure=exposure))

    told = plain(str([report.sentences, [section.paragraphs for section in report.sections]])).lower()
    assert plain(report.sentences[0]).count("sampling range") == 1
    assert (told.count("sampling range") > 2, "95 % range" in told) == (True, False)


@pytest.mark.parametrize(
    ("name", "told"), [("smoothed", "simulated"), ("published", "1.7° to 11.2°"), ("live", "1.3°")]
)
def test_the_accuracy_told_is_that_of_the_method_used(name: str, told: str) -> None:
    analysis = make_analysis()
    assert analysis.method is not None
    used = replace(analysis, method=replace(analysis.method, name=name))

    paragraphs = " ".join(report_of(analysis=used).limits.paragraphs)
    assert told in paragraphs
    assert paragraphs.count("Angle error") == 1


def test_a_good_verdict_names_what_the_n_pose_hides_and_ready_angles_have_no_pose() -> None:
    good = make_quality("good")
    posed = report_of(analysis=make_analysis(quality=good))
    ready = report_of(analysis=make_analysis(quality=good, calibrated=False))
    limits = " ".join(ready.limits.paragraphs)

    assert "The calibration pose limits these figures" in posed.verdict.reason
    assert "15° low" in posed.pose_caution
    assert ready.verdict.reason.startswith("No fault was found in the recording.")
    assert ready.pose_caution == ""
    assert section_of(ready, "full-method").pairs[0].value.startswith("The file contains precomputed angles")
    assert "their error is not known" in limits
    assert not re.search("turns on the arm|Angle error", limits)


def test_the_bar_merges_the_nine_bins_of_the_table_in_whole_numbers_that_add_up() -> None:
    report = report_of()

    shares = [plain(row[2]) for row in report.figures[0].table.rows]
    assert shares == ["67 %", "25 %", "6 %", "2 %"]  # 32.5, 7.6 and 2.1 % above 30, 60 and 90 deg
    bins = [int(row[2]) for row in table_of(report, "standards", "bins").rows]
    assert bins == [46, 21, 17, 8, 5, 1, 1, 1, 0]


def test_the_range_of_a_whole_share_is_rounded_outwards() -> None:
    exposure = make_exposure()
    ranged = replace(exposure.bins[3], interval=Interval(8.2, 9.1))  # 8.8 %, printed as 16 - 8

    bins = (*exposure.bins[:3], ranged, *exposure.bins[4:])
    rows = table_of(report_of(exposure=replace(exposure, bins=bins)), "standards", "bins").rows

    assert rows[3][2] == "8 (8–10)"


def test_what_is_printed_of_the_time_is_rounded_and_adds_up() -> None:
    time = TimeAccount(10_120_000, 7_040_000, 2_040_000, 1_040_000)

    table = table_of(report_of(analysis=replace(make_analysis(), time=time)), "quality", "recorded time")

    assert [row[2] for row in table.rows] == ["7.0", "2.1", "1.0", "10.1"]


def test_every_flag_stands_in_the_quality_table_with_its_clock_times() -> None:
    row = table_of(report_of(), "findings", "Findings").rows[0]

    assert [plain(cell) for cell in (row[0], *row[2:])] == ["W-GAP", "1", "9 min", "13:38:12", "13:47:12"]


def test_provenance_names_file_hash_version_and_report() -> None:
    pairs = {pair.name: pair.value for pair in section_of(report_of(), "provenance").pairs}

    assert pairs["SHA-256 of the file"].startswith("9f86d081")
    assert (pairs["Software"], pairs["Revision"]) == ("Acromion 0.1.0", "a1b2c3d4e5f6")
    assert pairs["Report"] == report_of().report_id


def list_compared(report: Report) -> dict[str, str]:
    """What was measured beside each published value."""
    table = table_of(report, "published", "published")
    return {row[0]: plain(row[3]) for row in table.rows}


def test_a_working_day_is_compared_with_the_proposals_but_not_by_its_fused_speed() -> None:
    report = report_of(exposure=with_velocity(make_exposure(), "generalised_accelerometer", None))

    compared = list_compared(report)

    assert compared["Time above 60°"] == "7.6 %"
    assert compared["Median speed, accelerometer-based"] == "–"
    note = table_of(report, "published", "published").note
    assert "a fused speed reads two to four times lower" in note


def test_the_subject_code_is_cut_and_freed_of_what_cannot_be_seen() -> None:
    report = build_report(make_analysis(), make_subject(subject="A\u202e\x00" + "b" * 300), "en")

    told = {pair.name: pair.value for pair in section_of(report, "provenance").pairs}
    assert told["Subject"] == "A" + "b" * 199
    assert report.header[0].value == "A" + "b" * 22 + "…"


def test_a_report_that_replaces_another_says_so_with_the_reason() -> None:
    subject = replace(make_subject(), version=2, reason="side corrected")

    report = build_report(make_analysis(), subject, "en")

    assert report.amendment == ("Version 2 of this report; it replaces version 1. Reason: side corrected")


# The charts and tables behind page 1: each figure with its range.


def test_the_distribution_and_the_heat_map_hold_all_of_the_time() -> None:
    curve, heat = section_of(report_of(), "spread").figures

    ends = [plain(cell) for row in (curve.table.rows[0], curve.table.rows[-1]) for cell in row]
    assert ends == ["10°", "14.3", "180°", "100.0"]
    assert [row[-1] for row in heat.table.rows] == ["20.0"] * 5


def test_the_range_of_a_percentile_stands_on_the_curve_as_the_language_writes_it() -> None:
    exposure = replace(make_exposure(), intervals={"elevation_p90_deg": Interval(47.2, 61.4)})

    curves = [
        section_of(report_of(exposure=exposure, language=each), "spread").figures[0] for each in LANGUAGES
    ]

    assert "P90: 54° (47–61°)" in curves[0].wide
    assert "P90\u00a0: 54°" in curves[1].wide


def test_a_period_that_was_left_out_has_a_length_and_no_figures() -> None:
    away = PartExposure("Lunch", 0.0, 1800.0, 0.0, {}, {}, None, "break", 1800.0, "break")
    work = replace(make_exposure().by_hour[1], label="Shelves", kind="task", recorded_s=3600.0)
    report = report_of(exposure=replace(make_exposure(), by_period=(away, work)))

    row = table_of(report, "figures", "By diary period").rows[0]

    assert [plain(cell) for cell in row[1:]] == ["30 min, left out", *["–"] * 6]


def test_the_last_sample_of_a_recording_that_ends_on_the_hour_is_no_hour() -> None:
    hours = make_exposure().by_hour
    end_s = hours[-1].end_s
    sliver = PartExposure("16", end_s, end_s + 0.02, 0.02, {}, {}, None)

    section = section_of(report_of(exposure=replace(make_exposure(), by_hour=(*hours, sliver))), "hours")

    assert len(section.tables[0].rows) == len(section.figures[0].table.rows) == len(hours)


def test_the_bar_of_the_first_page_and_those_behind_it_show_the_same_classes() -> None:
    report = report_of()

    first, hours = report.figures[0].table, section_of(report, "hours").figures[0].table
    assert (
        tuple(row[0] for row in first.rows) == hours.columns[1:] == ("0–30°", "30–60°", "60–90°", "90–180°")
    )


def test_the_ranges_of_a_part_stand_beside_its_figures() -> None:
    intervals = {
        "elevation_p50_deg": Interval(17.6, 29.6),
        "time_above_60_percent": Interval(5.0, 11.2),
        "entries_above_60_per_h": Interval(18.2, 44.9),
    }
    hour = replace(make_exposure().by_hour[1], intervals=intervals)

    table = section_of(report_of(exposure=replace(make_exposure(), by_hour=(hour,))), "hours").tables[0]

    hour_s = hour.percentiles_deg[50], hour.time_above_percent[60], hour.entries_above_60_per_h
    median, share, rate = (f"{value:.{decimals}f}" for value, decimals in zip(hour_s, (0, 1, 0), strict=True))
    row = table.rows[0]
    assert (row[2], row[5], row[7]) == (f"{median} (18–30)", f"{share} (5.0–11.2)", f"{rate} (18–45)")


def make_task(label: str, percent: float, low: float, high: float, **changes: Any) -> PartExposure:
    """An hour of one task, with the range of its share above 60 deg."""
    ranges = {"time_above_60_percent": Interval(low, high, low, 2 * high)}
    above = {30: 40.0, 60: percent, 90: 1.0}
    hour = PartExposure(label, 0.0, 3600.0, 3600.0, {}, above, 30.0, "task", 3600.0, "", ranges)
    return replace(hour, **changes)


def test_a_task_is_told_by_share_minutes_rises_longest_rest_and_difference_with_their_ranges() -> None:
    figures = {
        "episodes_above_60_longest_s": 48.0,
        "recovery_neutral_slow_percent": 12.5,
        "time_above_60_less_rest_percent": -2.0,
    }
    task = make_task("Shelves", 10.0, 5.0, 15.0, periods=2, **figures)
    known = {
        "entries_above_60_per_h": Interval(20.0, 40.0),
        "episodes_above_60_longest_s": Interval(48.0, 48.2),
        "recovery_neutral_slow_percent": Interval(10.0, 14.0),
        "time_above_60_less_rest_percent": Interval(-6.5, 0.5),
    }
    task = replace(task, intervals=task.intervals | known)

    table = table_of(report_of(exposure=replace(make_exposure(), by_task=(task,))), "hours", "Task by task")

    assert [plain(cell) for cell in table.rows[0]] == [
        *("Shelves (2 ×)", "1 h", "10.0 (5.0–15.0; pose 30.0)", "6.0 (3.0–9.0)", "30 (20–40)"),
        *("48 s (48 s–49 s)", "12.5 (10.0–14.0)", "−2.0 (−6.5 to +0.5)"),
    ]


def test_the_time_before_each_mark_stands_beside_the_rest_of_the_shift_and_shows_no_cause() -> None:
    mark = replace(make_task("Pain", 20.0, 15.0, 25.0, kind="mark"), start_s=7200.0, end_s=8100.0, periods=1)
    mark = replace(mark, analysed_s=840.0, percentiles_deg={50: 21.0})
    few = replace(mark, label="", analysed_s=599.0)
    rest = replace(mark, label="", kind="rest", analysed_s=18000.0)

    table = table_of(
        report_of(exposure=replace(make_exposure(), by_mark=(mark, few, rest))), "hours", "The 15 minutes"
    )

    assert [[plain(cell) for cell in row] for row in table.rows] == [
        ["10:13 Pain", "14 min", "20.0", "21", "30"],
        ["10:13 Mark", "9 min 59 s", "20.0", "21", "–"],
        ["Rest of the shift", "5 h", "20.0", "21", "30"],
    ]
    assert "It does not show a cause, and has no ranges" in plain(table.note)


def test_the_shares_while_upright_refer_to_the_time_with_a_known_posture() -> None:
    """Of five hours, the arm was upright for an hour and a quarter, and the posture unknown for half."""
    part = replace(make_task("", 20.0, 15.0, 25.0), analysed_s=4500.0)
    part = replace(
        part, time_above_percent={30: 40.0, 60: 20.0, 90: 4.0}, percentiles_deg={50: 21.0, 90: 70.0}
    )
    parts = [replace(part, kind=kind) for kind in ("seated", "upright", "unstated")]
    exposure = replace(
        make_exposure(), analysed_s=18000.0, by_posture=(*parts[:2], replace(parts[2], analysed_s=9000.0))
    )

    table = table_of(report_of(exposure=exposure), "hours", "By posture")

    assert [row[0] for row in table.rows] == ["Seated or lying", "Upright", "Posture not stated"]
    assert plain(table.rows[1][5]) == "20.0 (15.0–25.0; pose 50.0)"
    shares = "20.0 %, 10.0 %, 2.0 % of the time with a known posture, which is 50.0 % of the analysed time"
    assert shares in plain(table.note)
    assert "21 %, 4 % and 1 % of working time (Gupta et al. 2022)" in plain(table.note)


def test_without_upright_time_no_published_share_is_shown() -> None:
    part = replace(make_task("", 20.0, 15.0, 25.0), kind="seated")

    table = table_of(report_of(exposure=replace(make_exposure(), by_posture=(part,))), "hours", "By posture")

    assert "Gupta" not in table.note


def test_only_a_task_whose_range_overlaps_with_no_other_has_a_rank() -> None:
    tasks = (make_task("Till", 2.0, 1.0, 4.0), make_task("Shelves", 3.0, 2.0, 5.0))
    ceilings = make_task("Ceilings", 20.0, 15.0, 25.0)
    shift = make_task("", 2.5, 1.0, 4.0, kind="shift")
    exposure = replace(make_exposure(), by_task=(*tasks, shift, ceilings))

    rows = table_of(report_of(exposure=exposure), "hours", "Task by task").rows

    assert [row[0] for row in rows] == ["1. Ceilings", "Shelves", "Till", "Shift without tasks"]


def test_the_cycles_say_what_their_range_does_not_hold() -> None:
    assert "4 of 10" in plain(table_of(report_of(), "figures", "Movement cycles by range").note)


@pytest.mark.parametrize("language", LANGUAGES)
def test_no_two_tables_bear_the_same_name(language: Language) -> None:
    report = report_of(language=language)
    figures = [*report.figures, *(f for s in report.sections for f in s.figures)]
    captions = [f.table.caption for f in figures] + [t.caption for s in report.sections for t in s.tables]

    assert len(captions) == len(set(captions))


def test_the_range_of_a_speed_of_rises_and_of_episodes_stands_beside_them() -> None:
    known = {"inclination_velocity_p50_dps": Interval(13.25, 16.0)}
    names = ("entries_above_60_per_h", "episodes_above_60_longest_s")
    exposure = replace(make_exposure(), intervals=known | dict.fromkeys(names, Interval(20.0, 50.0)))
    report = report_of(exposure=exposure)

    speeds, rises = (table_of(report, "spread", caption).rows for caption in ("Speed", "Rises"))

    assert speeds[0][2].endswith(" (13.2–16.0)")
    assert [plain(rises[1][k]) for k in (2, 6)] == ["30 (20–50)", "48 s (20 s–50 s)"]


def test_cycles_have_no_decimals() -> None:
    cycles = (Cycles(10.0, 30.0, 3436.5),)

    table = table_of(report_of(exposure=replace(make_exposure(), cycles=cycles)), "figures", "cycles")

    assert [plain(cell) for cell in table.rows[0]] == ["10–30°", "3 436"]


def test_every_published_value_stands_in_the_table_behind_the_first_page() -> None:
    section = section_of(report_of(), "published")

    published = [plain(row[2]) for row in section.tables[0].rows]
    assert published == ["≤ 50 %", "≤ 10 %", "≤ 60°/s", "49–124°", "2.0–4.0 h", "4.4–7.9 %", "1.0–2.8 %"]
    assert "1.23" in section.paragraphs[0]
    assert "nothing about one person" in section.paragraphs[0]


def test_a_table_of_many_hours_is_cut_and_says_so() -> None:
    hour = make_exposure().by_hour[0]
    hours = tuple(replace(hour, start_s=3600.0 * k, end_s=3600.0 * (k + 1), intervals={}) for k in range(20))
    exposure = replace(make_exposure(), by_hour=hours)

    table = table_of(report_of(exposure=exposure), "hours", "By hour")

    assert len(table.rows) == 14
    assert "The first 14 of 20 rows; hours.csv and results.json have all." in plain(table.note)


def test_a_table_of_a_shift_without_ranges_has_a_row_for_each_hour_and_is_not_cut() -> None:
    table = table_of(report_of(), "hours", "By hour")

    assert len(table.rows) == len(make_exposure().by_hour)
    assert "The first" not in table.note


@pytest.mark.parametrize(
    ("language", "expected"),
    [
        ("en", "3 March 2026, 07:58 to 4 March 2026, 17:58"),
        ("fr", "du 3 mars 2026, 7 h 58, au 4 mars 2026, 17 h 58"),
    ],
)
def test_the_header_of_a_recording_over_midnight_has_both_dates(language: Language, expected: str) -> None:
    analysis = make_analysis()
    recording = replace(analysis.recording, duration_us=34 * 3600 * 1_000_000)

    report = report_of(analysis=replace(analysis, recording=recording), language=language)

    assert plain(report.header[1].value) == expected
