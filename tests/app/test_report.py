"""From an analysis to the values of a report: what is chosen, rounded and said."""

import re
from dataclasses import replace

import pytest

from app.report.content import Report, build_report
from app.report.findings import Findings
from app.report.parts import Section, Table
from app.report.wording import LANGUAGES, Language
from fusion.exposure import Entries, Episodes, Exposure, Interval, PartExposure, PeakWindow, Velocity
from fusion.quality import Quality, TimeAccount
from fusion.recording import QualityFlag
from tests.app.analysis_factory import (
    make_analysis,
    make_exposure,
    make_quality,
    make_subject,
    with_velocity,
)


def report_of(
    *, analysis: Findings | None = None, exposure: Exposure | None = None, language: Language = "en"
) -> Report:
    return build_report(analysis or make_analysis(exposure=exposure), make_subject(), language)


def plain(text: str) -> str:
    """Make every no-break space a plain one."""
    return re.sub(r"[\u202f\u00a0]", " ", text).replace("’", "'")


def section_of(report: Report, key: str) -> Section:
    return next(section for section in report.sections if section.key == key)


def table_of(report: Report, key: str, caption: str) -> Table:
    return next(table for table in section_of(report, key).tables if caption in table.caption)


def test_the_answer_in_english() -> None:
    assert [plain(sentence) for sentence in report_of().sentences] == [
        "The right arm was raised above 60° for 32 min of 7 h 5 min analysed (7.6 %).",
        "The right arm rose above 60° 214 times (30 per hour); the longest stay was 48 s, at 10:42.",
        "The most loaded 15 minutes were 13:05–13:20 (41.2 % of the time above 60°).",
    ]


def test_the_answer_in_french() -> None:
    assert [plain(sentence) for sentence in report_of(language="fr").sentences] == [
        "Le bras droit a été élevé à plus de 60° pendant 32 min sur 7 h 5 min de temps analysé (7,6 %).",
        (
            "Le bras droit a dépassé 60° 214 fois (30 fois par heure) ; "
            "le maintien le plus long a duré 48 s, à 10 h 42."
        ),
        "Les 15 minutes les plus sollicitantes : de 13 h 05 à 13 h 20 (41,2 % du temps au-dessus de 60°).",
    ]


def test_an_interval_is_told_where_the_exposure_carries_one() -> None:
    exposure = make_exposure(above_60_interval=Interval(6.0, 9.5))

    sentence = plain(report_of(exposure=exposure, language="fr").sentences[0])

    assert sentence.endswith("(7,6 % ; intervalle à 95 % : 6,0–9,5 %).")


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

    assert sentence.startswith("The right arm rose above 60° 214 times;")


def test_a_day_without_a_rise_is_told_so() -> None:
    exposure = replace(
        make_exposure(), entries=(Entries(60, 0, 0.0),), episodes=(Episodes(60, 0, None, None, None, 0),)
    )

    assert report_of(exposure=exposure).sentences[1] == "The right arm did not rise above 60°."


def test_a_single_rise_is_told_in_the_singular() -> None:
    exposure = replace(
        make_exposure(), entries=(Entries(60, 1, 0.14),), episodes=(Episodes(60, 1, 12.0, 12.0, 60.0, 0),)
    )

    assert plain(report_of(exposure=exposure, language="fr").sentences[1]) == (
        "Le bras droit a dépassé 60° une fois ; le maintien a duré 12 s, à 7 h 59."
    )


def test_a_recording_too_short_for_the_window_says_so() -> None:
    exposure = replace(make_exposure(), peak_windows=(PeakWindow(900, None, None),))

    assert report_of(exposure=exposure).sentences[2].startswith("No 15 minutes in a row hold enough")


def test_no_time_above_in_the_worst_window_is_told_so() -> None:
    exposure = replace(make_exposure(), peak_windows=(PeakWindow(900, 0.0, 0.0),))

    assert report_of(exposure=exposure).sentences[2] == "In no 15 minutes was the arm above 60°."


def test_without_a_clock_times_are_told_from_the_start() -> None:
    report = report_of(analysis=make_analysis(start=None))

    assert plain(report.sentences[2]).startswith(
        "The most loaded 15 minutes were 5:07:00–5:22:00 after the start"
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
    assert english.startswith("Sensor moved on the arm. ")
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


def test_small_turns_of_the_sensor_that_go_unnoticed_are_told() -> None:
    paragraphs = " ".join(report_of(analysis=make_analysis()).limits.paragraphs)

    assert "turns on the arm by less than about 45° during the day often goes unnoticed" in paragraphs


def test_ready_angles_have_no_accuracy_of_ours() -> None:
    paragraphs = " ".join(report_of(analysis=make_analysis(calibrated=False)).limits.paragraphs)

    assert "turns on the arm" not in paragraphs
    assert "Angle error" not in paragraphs
    assert "their error is not known here" in paragraphs


def test_a_good_verdict_of_a_ready_angle_series_says_that_nothing_was_found() -> None:
    report = report_of(analysis=make_analysis(quality=make_quality("good"), calibrated=False))

    assert "nothing was found in it that limits these figures." in report.verdict.reason


def test_a_good_verdict_does_not_hide_what_the_pose_does_to_the_figures() -> None:
    report = report_of(analysis=make_analysis(quality=make_quality("good")))

    assert "limits these figures is the calibration pose" in report.verdict.reason
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
        "1.6 %",
        "0.5 %",
    ]


def test_all_nine_bins_stand_in_the_table() -> None:
    assert len(table_of(report_of(), "figures", "bins").rows) == 9


def test_time_adds_up_to_the_microsecond() -> None:
    time = TimeAccount(10_000_003, 7_000_001, 2_000_000, 1_000_002)

    table = table_of(report_of(analysis=replace(make_analysis(), time=time)), "quality", "time went")

    assert [row[2] for row in table.rows] == ["7.000001", "2", "1.000002", "10.000003"]


def test_every_flag_stands_in_the_quality_table_with_its_clock_times() -> None:
    row = table_of(report_of(), "quality", "found").rows[0]

    assert [plain(cell) for cell in (row[0], *row[2:])] == ["W-GAP", "1", "9 min", "13:38:12", "13:47:12"]


def test_provenance_names_file_hash_version_and_report() -> None:
    pairs = {pair.name: pair.value for pair in section_of(report_of(), "provenance").pairs}

    assert pairs["SHA-256 of the file"].startswith("9f86d081")
    assert (pairs["Software"], pairs["Revision"]) == ("Acromion 0.1.0", "a1b2c3d4e5f6")
    assert pairs["Report"] == report_of().report_id


def test_a_working_day_is_compared_with_the_proposals() -> None:
    statements = [plain(reference.statement) for reference in report_of().references]

    assert statements[1] == "Measured 7.6 %; proposal at most 10 % of a working day."


def test_a_fused_speed_is_never_compared_with_the_proposal() -> None:
    velocity = report_of().references[2]

    assert (velocity.scale, velocity.statement.startswith("Does not apply because")) == ("", True)


def test_the_accelerometer_based_speed_is_compared_with_the_proposal() -> None:
    exposure = with_velocity(make_exposure(), "generalised_accelerometer", Velocity(5, 48.4, 160, 300, 70))

    velocity = report_of(exposure=exposure).references[2]

    assert plain(velocity.statement) == "Measured 48°/s; proposal at most 60°/s over a working day."


def test_less_than_four_hours_are_not_compared_with_a_working_day() -> None:
    short = replace(make_analysis(), time=TimeAccount(60_000_000, 60_000_000, 0, 0))

    references = report_of(analysis=short).references

    assert [reference.scale for reference in references] == ["", "", "", ""]
    assert "less than 4 h were analysed" in plain(references[0].statement)


def test_poor_data_are_not_compared() -> None:
    poor = make_analysis(quality=Quality("poor", (), ()))

    assert "the data quality is poor" in report_of(analysis=poor).references[0].statement


def test_the_subject_code_is_cut_and_freed_of_what_cannot_be_seen() -> None:
    report = build_report(make_analysis(), make_subject(subject="A\u202e\x00" + "b" * 300), "en")

    told = {pair.name: pair.value for pair in section_of(report, "provenance").pairs}
    assert told["Subject"] == "A" + "b" * 199


def test_a_long_subject_code_is_cut_at_the_head_of_the_page() -> None:
    report = build_report(make_analysis(), make_subject(subject="b" * 30), "en")

    assert report.header[0].value == "b" * 23 + "…"


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_same_analysis_gives_the_same_report(language: Language) -> None:
    assert report_of(language=language) == report_of(language=language)


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


def test_the_distribution_starts_at_nothing_and_ends_at_all() -> None:
    curve = section_of(report_of(), "spread").figures[0]

    assert [plain(cell) for row in (curve.table.rows[0], curve.table.rows[-1]) for cell in row] == [
        "10°", "14.3", "180°", "100.0",
    ]  # fmt: skip


def test_the_range_of_a_percentile_stands_on_the_curve() -> None:
    exposure = replace(make_exposure(), intervals={"elevation_p90_deg": Interval(47.2, 61.4)})

    curve = section_of(report_of(exposure=exposure), "spread").figures[0]

    assert "P90: 54° (47–61°)" in curve.wide


def test_in_french_a_colon_on_the_curve_has_its_space() -> None:
    curve = section_of(report_of(language="fr"), "spread").figures[0]

    assert "P90\u202f: 54°" in curve.wide or "P90\u00a0: 54°" in curve.wide


def test_the_heat_map_sums_to_all() -> None:
    heat = section_of(report_of(), "spread").figures[1]

    assert [row[-1] for row in heat.table.rows] == ["20.0"] * 5


def test_a_period_that_was_left_out_is_hatched_and_never_a_bar() -> None:
    away = PartExposure("Lunch", 0.0, 1800.0, 0.0, {}, {}, None, "break", 1800.0, "break")
    work = replace(make_exposure().by_hour[1], label="Shelves", kind="task", recorded_s=3600.0)

    section = section_of(report_of(exposure=replace(make_exposure(), by_period=(away, work))), "hours")

    chart = section.figures[1]
    assert plain(chart.wide).count("left out, 30 min") == 2  # on the bar and in the description
    assert chart.table.rows[0][1:] == ("–",) * 4


def test_the_ranges_of_a_part_stand_under_its_figures() -> None:
    intervals = {
        "elevation_p50_deg": Interval(17.6, 29.6),
        "time_above_60_percent": Interval(5.0, 11.2),
        "entries_above_60_per_h": Interval(18.2, 44.9),
    }
    hour = replace(make_exposure().by_hour[1], intervals=intervals)

    table = section_of(report_of(exposure=replace(make_exposure(), by_hour=(hour,))), "hours").tables[0]

    assert [plain(cell) for cell in table.rows[1]] == [
        "95 % range", "", "", "18–30", "", "", "5.0–11.2", "", "18–45",
    ]  # fmt: skip


def test_a_task_of_one_period_repeats_no_ranges() -> None:
    hour = replace(make_exposure().by_hour[1], intervals={"elevation_p50_deg": Interval(17.6, 29.6)})
    tasks = (replace(hour, label="Shelves", periods=2), replace(hour, label="Ceiling"))

    table = section_of(report_of(exposure=replace(make_exposure(), by_task=tasks)), "hours").tables[-1]

    assert [row[0] for row in table.rows] == ["Shelves (2\u00a0×)", "95\u202f% range", "Ceiling"]


def test_a_part_without_ranges_has_no_row_of_them() -> None:
    table = section_of(report_of(), "hours").tables[0]

    assert len(table.rows) == len(make_exposure().by_hour)


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_cycles_say_what_their_range_does_not_hold(language: Language) -> None:
    caption = {"en": "Movement cycles by range", "fr": "Cycles de mouvement par amplitude"}[language]
    tables = section_of(report_of(language=language), "figures").tables

    note = next(table.note for table in tables if table.caption == caption)
    assert re.search(r"4 (of|cas sur) 10", plain(note))


def test_the_range_of_time_above_stands_beside_the_proposal() -> None:
    report = report_of(exposure=make_exposure(above_60_interval=Interval(6.0, 9.5)))

    statement = plain(report.references[1].statement)
    assert statement == "Measured 7.6 % (range 6.0–9.5 %); proposal at most 10 % of a working day."


@pytest.mark.parametrize("language", LANGUAGES)
def test_no_two_tables_bear_the_same_name(language: Language) -> None:
    report = report_of(language=language)
    figures = [*report.figures, *(f for s in report.sections for f in s.figures)]
    captions = [f.table.caption for f in figures] + [t.caption for s in report.sections for t in s.tables]

    assert len(captions) == len(set(captions))


def test_the_range_of_a_speed_stands_under_it() -> None:
    exposure = replace(make_exposure(), intervals={"inclination_velocity_p50_dps": Interval(13.25, 16.0)})

    rows = table_of(report_of(exposure=exposure), "figures", "Speed").rows

    assert rows[1] == ("95\u202f% range", "", "13.2–16.0", "", "", "")


def test_the_range_of_rises_and_stays_stands_under_them() -> None:
    names = ("entries_above_60_per_h", "episodes_above_60_longest_s")
    exposure = replace(make_exposure(), intervals=dict.fromkeys(names, Interval(20.0, 50.0)))

    rows = table_of(report_of(exposure=exposure), "figures", "Repetitions").rows

    assert [plain(cell) for cell in rows[2][1:]] == ["", "20–50", "", "", "20 s–50 s", ""]


@pytest.mark.parametrize("language", LANGUAGES)
def test_every_published_value_stands_in_the_table_behind_the_first_page(language: Language) -> None:
    report = report_of(language=language)

    (section,) = [section for section in report.sections if section.key == "published"]
    (table,) = section.tables
    published = [plain(row[2]).replace(",", ".") for row in table.rows]
    assert published == ["≤ 50 %", "≤ 10 %", "≤ 60°/s", "49–124°", "2.0–4.0 h", "4.4–7.9 %", "1.0–2.8 %"]
    assert "1.23" in section.paragraphs[0].replace(",", ".")
    assert {"en": "Nothing about one person follows", "fr": "rien pour une personne"}[
        language
    ] in section.paragraphs[0]
