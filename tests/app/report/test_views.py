"""From an analysis to the values of a report: what is chosen, rounded and said."""

import re
from dataclasses import replace

import pytest

from app.report.analysis.report import Report, build_report
from app.report.words.wording import LANGUAGES, Language
from fusion.exposure import Entries, Episodes, Interval, PeakWindow, Velocity
from fusion.quality import Quality, TimeAccount
from fusion.recording import QualityFlag
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
            "The right arm was raised above 60° for 32 min of 7 h 5 min analysed (7.6 %), "
            "and above 90° for 8 min 56 s (2.1 %)."
        ),
        (
            "The right arm made 214 rises above 60° (30 per hour); "
            "longest continuous time above 60°: 48 s, at 10:42."
        ),
        "The 15 minutes with the most time above 60° were 13:05–13:20 (41.2 %).",
    ]


def test_the_answer_in_french() -> None:
    assert [plain(sentence) for sentence in report_of(language="fr").sentences] == [
        (
            "Le bras droit a été élevé à plus de 60° pendant 32 min sur 7 h 5 min de temps analysé (7,6 %), "
            "et à plus de 90° pendant 8 min 56 s (2,1 %)."
        ),
        (
            "Le bras droit compte 214 passages au-dessus de 60° (30 par heure) ; "
            "plus longue durée continue au-dessus de 60° : 48 s, à 10 h 42."
        ),
        "Les 15 minutes comptant le plus de temps au-dessus de 60° : de 13 h 05 à 13 h 20 (41,2 %).",
    ]


def test_an_interval_is_told_where_the_exposure_carries_one() -> None:
    exposure = make_exposure(above_60_interval=Interval(6.0, 9.5))

    sentence = plain(report_of(exposure=exposure, language="fr").sentences[0])

    assert "(7,6 % ; intervalle à 95 % : 6,0–9,5 %), et" in sentence


def test_the_range_of_the_time_above_90_deg_stands_beside_it() -> None:
    above = tuple(replace(item, interval=Interval(1.5, 2.8)) for item in make_exposure().time_above)

    sentence = plain(report_of(exposure=replace(make_exposure(), time_above=above)).sentences[0])

    assert sentence.endswith("above 90° for 8 min 56 s (2.1 %; range 1.5–2.8 %).")


def test_no_interval_is_invented() -> None:
    report = report_of()

    assert "range" not in " ".join(report.sentences)
    assert table_of(report, "figures", "bins").columns == ("Elevation", "Time", "Share")


def test_the_table_gains_a_column_where_an_interval_exists() -> None:
    report = report_of(exposure=make_exposure(above_60_interval=Interval(6.0, 9.5)))

    rows = table_of(report, "figures", "thresholds").rows

    assert [plain(row[3]) for row in rows] == ["–", "6.0–9.5 %", "–"]


def test_an_arm_of_unknown_side_is_the_arm() -> None:
    report = build_report(make_analysis(), make_subject(side=None), "fr")

    assert report.sentences[0].startswith("Le bras a été élevé")


def test_a_recording_of_a_few_minutes_has_no_hourly_rate() -> None:
    exposure = replace(make_exposure(), analysed_s=179.0)

    sentence = plain(report_of(exposure=exposure).sentences[1])

    assert sentence.startswith("The right arm made 214 rises above 60°;")


def test_a_day_without_a_rise_is_told_so() -> None:
    exposure = replace(
        make_exposure(), entries=(Entries(60, 0, 0.0),), episodes=(Episodes(60, 0, None, None, None, 0),)
    )

    assert report_of(exposure=exposure).sentences[1] == "The right arm made no rise above 60°."


def test_a_single_rise_is_told_in_the_singular() -> None:
    exposure = replace(
        make_exposure(), entries=(Entries(60, 1, 0.14),), episodes=(Episodes(60, 1, 12.0, 12.0, 60.0, 0),)
    )

    assert plain(report_of(exposure=exposure, language="fr").sentences[1]) == (
        "Le bras droit compte un passage au-dessus de 60° ; durée continue au-dessus de 60° : 12 s, à 7 h 59."
    )


def test_a_recording_too_short_for_the_window_says_so() -> None:
    exposure = replace(make_exposure(), peak_windows=(PeakWindow(900, None, None),))

    assert report_of(exposure=exposure).sentences[2].startswith("No 15 minutes in a row hold enough")


def test_no_time_above_in_the_worst_window_is_told_so() -> None:
    exposure = replace(make_exposure(), peak_windows=(PeakWindow(900, 0.0, 0.0),))

    assert report_of(exposure=exposure).sentences[2] == "The arm was above 60° in no 15 minutes."


def test_without_a_clock_times_are_told_from_the_start() -> None:
    report = report_of(analysis=make_analysis(start=None))

    assert plain(report.sentences[2]).startswith(
        "The 15 minutes with the most time above 60° were 5:07:00–5:22:00 after the start"
    )
    assert report.made_of is None


def test_the_date_of_the_report_is_the_end_of_the_recording() -> None:
    made_of = report_of().made_of

    assert made_of is not None
    assert made_of.isoformat() == "2026-03-03T15:57:12-05:00"


def test_the_verdict_comes_with_its_one_reason() -> None:
    verdict = report_of().verdict

    assert (verdict.level, verdict.label) == ("caution", "Data quality: use with care.")
    assert verdict.reason.startswith("Holes in the recording.")


def test_every_other_grave_reason_is_named_with_its_time() -> None:
    flags = (QualityFlag("W-REMOUNT"), QualityFlag("W-GAP", 2, 1200.0), QualityFlag("W-DUP"))
    quality = Quality("caution", ("W-REMOUNT", "W-GAP"), flags)

    english, french = (
        plain(report_of(analysis=make_analysis(quality=quality), language=language).verdict.reason)
        for language in LANGUAGES
    )
    assert english.startswith("No pose after the sensor moved. ")
    assert " Also: holes in the recording (20 min). " in english
    assert " Aussi : trous dans l'enregistrement (20 min). " in french


def test_what_was_not_analysed_is_told_on_the_first_page() -> None:
    assert plain(report_of().verdict.reason).endswith(" Not analysed: break 45 min, missing 9 min.")


def test_the_first_page_says_what_its_ranges_hold() -> None:
    ready = make_analysis(calibrated=False)
    drawn = replace(ready, exposure=replace(ready.exposure, intervals={"elevation_p50_deg": Interval(1, 2)}))

    notes = [report_of(analysis=analysis).range_note for analysis in (make_analysis(), drawn, ready)]
    assert "for an error of the angle alone" in notes[0]
    assert "The error of these ready angles is not known" in notes[1]
    assert notes[2].startswith("No range is given")


def test_under_half_an_hour_the_first_page_says_that_ranges_and_rates_are_not_given() -> None:
    short = replace(make_exposure(), analysed_s=1799.9)

    assert report_of(exposure=short).range_note == (
        "Less than half an hour was analysed: ranges and rates per hour are not given."
    )


@pytest.mark.parametrize(
    ("language", "name", "other"),
    [("en", "sampling range", "95 % range"), ("fr", "intervalle d'échantillonnage", "intervalle à 95 %")],
)
def test_a_range_of_ready_angles_is_called_what_it_is(language: Language, name: str, other: str) -> None:
    interval, ready = Interval(6.0, 9.5), make_analysis(calibrated=False)
    exposure = replace(make_exposure(above_60_interval=interval), intervals={"elevation_p50_deg": interval})

    report = report_of(analysis=replace(ready, exposure=exposure), language=language)

    tables = [table for section in report.sections for table in section.tables]
    told = plain(str([report.sentences, [(table.columns, table.rows) for table in tables]])).lower()
    assert plain(report.sentences[0]).count(name) == 1
    assert (told.count(name) > 2, other in told) == (True, False)


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


def test_ready_angles_have_no_accuracy_of_ours() -> None:
    paragraphs = " ".join(report_of(analysis=make_analysis(calibrated=False)).limits.paragraphs)

    assert "turns on the arm" not in paragraphs
    assert "Angle error" not in paragraphs
    assert "their error is not known here" in paragraphs


def test_a_good_verdict_of_a_ready_angle_series_says_that_no_fault_was_found() -> None:
    report = report_of(analysis=make_analysis(quality=make_quality("good"), calibrated=False))

    assert report.verdict.reason.startswith("No fault was found in the recording.")


def test_a_good_verdict_does_not_hide_what_the_pose_does_to_the_figures() -> None:
    report = report_of(analysis=make_analysis(quality=make_quality("good")))

    assert "The calibration pose limits these figures" in report.verdict.reason
    assert report.pose_caution != ""


def test_the_error_of_the_n_pose_stands_beside_the_figures() -> None:
    assert "15° low" in report_of().pose_caution


def test_a_ready_angle_series_has_no_pose() -> None:
    report = report_of(analysis=make_analysis(calibrated=False))

    assert report.pose_caution == ""
    assert section_of(report, "method").pairs[0].value.startswith("The file holds ready angles")


def test_the_bar_merges_whole_bins() -> None:
    assert [plain(row[2]) for row in report_of().figures[0].table.rows] == [
        "67.5 %",
        "24.9 %",
        "5.5 %",
        "2.1 %",
    ]


def test_all_nine_bins_stand_in_the_table() -> None:
    assert len(table_of(report_of(), "figures", "bins").rows) == 9


def test_what_is_printed_of_the_time_is_rounded_and_adds_up() -> None:
    time = TimeAccount(10_120_000, 7_040_000, 2_040_000, 1_040_000)

    table = table_of(report_of(analysis=replace(make_analysis(), time=time)), "quality", "recorded time")

    assert [row[2] for row in table.rows] == ["7.0", "2.1", "1.0", "10.1"]


def test_every_flag_stands_in_the_quality_table_with_its_clock_times() -> None:
    row = table_of(report_of(), "quality", "Findings").rows[0]

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


def test_a_working_day_is_compared_with_the_proposals() -> None:
    assert list_compared(report_of())["Time above 60°"] == "7.6 %"


def test_a_fused_speed_is_never_compared_with_the_proposal() -> None:
    report = report_of()

    assert list_compared(report)["Median speed, accelerometer-based"] == "–"
    assert "a fused speed reads two to four times lower" in table_of(report, "published", "published").note


def test_the_accelerometer_based_speed_is_compared_with_the_proposal() -> None:
    exposure = with_velocity(make_exposure(), "generalised_accelerometer", Velocity(5, 48.4, 160, 300, 70))

    report = report_of(exposure=exposure)

    assert list_compared(report)["Median speed, accelerometer-based"] == "48.4°/s"
    assert table_of(report, "published", "published").note == ""


def test_less_than_four_hours_are_not_compared_with_a_working_day() -> None:
    report = report_of(exposure=replace(make_exposure(), analysed_s=60.0))

    assert set(list_compared(report).values()) == {"–"}
    assert "less than 4 h were analysed" in plain(table_of(report, "published", "published").note)


def test_poor_data_are_not_compared() -> None:
    report = report_of(analysis=make_analysis(quality=Quality("poor", (), ())))

    assert set(list_compared(report).values()) == {"–"}
    assert "the data quality is poor" in table_of(report, "published", "published").note


def test_the_subject_code_is_cut_and_freed_of_what_cannot_be_seen() -> None:
    report = build_report(make_analysis(), make_subject(subject="A\u202e\x00" + "b" * 300), "en")

    told = {pair.name: pair.value for pair in section_of(report, "provenance").pairs}
    assert told["Subject"] == "A" + "b" * 199


def test_a_long_subject_code_is_cut_at_the_head_of_the_page() -> None:
    report = build_report(make_analysis(), make_subject(subject="b" * 30), "en")

    assert report.header[0].value == "b" * 23 + "…"


def test_the_figures_do_not_depend_on_the_language() -> None:
    def digits(report: Report) -> list[str]:
        cells = [
            cell
            for s in report.sections
            if s.key == "figures"
            for t in s.tables
            for row in t.rows
            for cell in row[1:]
        ]
        return [re.sub(r"\D", "", cell) for cell in cells]

    assert digits(report_of()) == digits(report_of(language="fr"))


def test_a_first_report_speaks_of_no_version() -> None:
    assert report_of().amendment == ""


def test_a_report_that_replaces_another_says_so_with_the_reason() -> None:
    subject = replace(make_subject(), version=2, reason="side corrected")

    report = build_report(make_analysis(), subject, "en")

    assert report.amendment == ("Version 2 of this report; it replaces version 1. Reason: side corrected")
