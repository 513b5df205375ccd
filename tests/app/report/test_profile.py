"""The first page: the Arm Elevation Profile."""

import io
import re
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from math import hypot
from pathlib import Path

import pytest
from pypdf import PdfReader

from acromion.app.report.export.results import encode_results
from acromion.app.report.findings import Findings, ReleaseStamp
from acromion.app.report.model import Profile, Report, format_brief
from acromion.app.report.products import set_report_again
from acromion.app.report.render.html import render_html
from acromion.app.report.render.pdf import render_pdf
from acromion.app.report.single.report import build_report
from acromion.app.report.words.wording import LANGUAGES, Language
from acromion.app.request import Conclusion, Paper, ReportRequest
from acromion.fusion.exposure.types import Entries, Exposure, Interval
from acromion.fusion.quality import Quality, TimeAccount
from acromion.fusion.recording import QualityFlag
from tests.app.analysis_factory import (
    make_analysis,
    make_calibration,
    make_exposure,
    make_quality,
    make_subject,
    with_diary,
)
from tests.app.report.report_reading import plain, report_of
from tests.app.report.test_pose import open_calibration

PAPERS: tuple[Paper, ...] = ("a4", "letter")
MOST_WORDS = 200
LEAST_PT = 9.0


def profile_of(
    analysis: Findings | None = None, exposure: Exposure | None = None, language: Language = "en"
) -> Profile:
    profile = report_of(analysis=analysis, exposure=exposure, language=language).profile
    assert profile is not None
    return profile


def with_percent(percent: float, interval: Interval | None = None) -> Exposure:
    """Return the day with another time above 60 deg."""
    exposure = make_exposure()
    above = (
        replace(item, percent=percent, interval=interval) if item.threshold_deg == 60 else item
        for item in exposure.time_above
    )
    return replace(exposure, time_above=tuple(above))


def ranged_day() -> Exposure:
    """Return the day with ranges; the pose takes the time above 60 deg across the proposal, and no other."""
    pose = {30: (20.0, 41.3, 20.0, 48.6), 60: (5.2, 9.9, 5.2, 14.7), 90: (1.4, 3.0, 1.4, 6.4)}
    exposure = make_exposure()
    above = tuple(
        replace(item, interval=Interval(*pose[int(item.threshold_deg)])) for item in exposure.time_above
    )
    speeds = {"generalised_accelerometer_velocity_p50_dps": Interval(38.2, 44.7)}
    return replace(exposure, time_above=above, intervals=speeds)


def last(hours: float, exposure: Exposure | None = None, shift_h: float | None = None) -> Findings:
    """Return a recording of so many analysed hours, in a shift of a stated length."""
    analysed_us, shift_us = round(hours * 3.6e9), None if shift_h is None else round(shift_h * 3.6e9)
    day = replace(exposure or make_exposure(), analysed_s=hours * 3600.0)
    time = TimeAccount(analysed_us, analysed_us, 0, 0, shift_us=shift_us)
    return replace(make_analysis(exposure=day), time=time, exclusions=())


def short_day() -> Findings:
    """Three minutes, which have neither ranges nor rates."""
    exposure = replace(
        make_exposure(), analysed_s=180.0, quarter_hours=(), entries=(Entries(60, 15, None),), peak_windows=()
    )
    time = TimeAccount(180_000_000, 180_000_000, 0, 0)
    return replace(make_analysis(exposure=exposure, quality=make_quality("poor")), time=time)


# Tiles.


def test_each_tile_says_where_it_lies_beside_the_proposal() -> None:
    told = [plain(tile.standing) for tile in profile_of(exposure=ranged_day()).tiles]

    assert told == [
        "Below 50 %",
        "Below 10 %? Cannot tell",
        "No proposal; means of 4 trades, workers over 50 (Lewis 2026)",
        "Below 60°/s",
    ]


def test_the_scale_shows_the_published_value() -> None:
    scales = [plain(tile.scale) for tile in profile_of().tiles]

    marks = (">50 %<", ">10 %<", ">1.0–2.8 %<", ">60°/s<")
    assert [mark in scale for mark, scale in zip(marks, scales, strict=True)] == [True] * 4


@pytest.mark.parametrize("is_short", [True, False], ids=["short", "poor"])
def test_less_than_four_hours_and_poor_data_have_no_published_value_beside_them(is_short: bool) -> None:
    tiles = profile_of(last(3.99) if is_short else make_analysis(quality=make_quality("poor"))).tiles

    assert [tile.standing for tile in tiles] == ["Not compared"] * 4
    assert not any("accent" in tile.scale for tile in tiles)


def test_a_velocity_that_was_not_computed_has_no_scale() -> None:
    exposure = replace(make_exposure(), velocity_dps={})

    tile = profile_of(exposure=exposure).tiles[3]

    assert (tile.value, tile.standing, tile.scale) == ("–", "Not computed", "")


# The answer.


ANALYSED = "of the 7 h 5 min analysed"
DAY, OPEN = f"7.6 % {ANALYSED}", "cannot tell whether this is below the proposed 10 %"


@pytest.mark.parametrize(
    ("findings", "told"),
    [
        (
            lambda: make_analysis(exposure=ranged_day()),
            f"{DAY} (5.2–9.9 %, up to 14.7 % if the pose read low): {OPEN}.",
        ),
        (
            lambda: make_analysis(exposure=with_percent(7.6, Interval(5.2, 9.9, 5.2, 9.9))),
            f"{DAY} (5.2–9.9 %): below the proposed 10 %.",
        ),
        (
            lambda: make_analysis(exposure=with_percent(14.0, Interval(11.0, 17.0, 11.0, 21.0))),
            f"14.0 % {ANALYSED} (11.0–17.0 %, up to 21.0 % if the pose read low): above the proposed 10 %.",
        ),
        (
            lambda: make_analysis(exposure=with_percent(7.6, Interval(5.2, 9.3)), calibrated=False),
            f"{DAY} (sampling range 5.2–9.3 %): {OPEN}, because the error of these angles is unknown.",
        ),
        (
            lambda: replace(
                make_analysis(exposure=with_percent(7.6, Interval(5.2, 9.3))),
                calibration=replace(make_calibration(), pose="side-lean", state="assumed"),
            ),
            f"{DAY} (5.2–9.3 %): {OPEN}, because the pose is not confirmed.",
        ),
        (lambda: last(3.0), "7.6 % of the 3 h analysed: under 4 h, so not compared."),
        (
            lambda: make_analysis(quality=make_quality("poor")),
            f"{DAY}: poor data, so not compared.",
        ),
        (
            lambda: last(5.0, with_percent(7.6, Interval(5.2, 9.3)), shift_h=8.0),
            "7.6 % of the 5 h analysed (5.2–9.3 %): below the proposed 10 %, for part of a shift of 8 h.",
        ),
    ],
    ids=["pose", "below", "above", "ready", "assumed", "short", "poor", "part"],
)
def test_one_sentence_says_how_much_beside_what_and_how_sure(
    findings: Callable[[], Findings], told: str
) -> None:
    report = report_of(analysis=findings())

    assert plain(report.sentences[0]) == f"The right arm was above 60° for {told}"


def test_the_first_line_of_the_text_to_copy_is_the_sentence_on_top() -> None:
    report = report_of(analysis=make_analysis(exposure=ranged_day()))

    assert format_brief(report).decode().splitlines()[0] == report.sentences[0]


@pytest.mark.parametrize(
    ("kind", "told"),
    [
        ("task", "Not measured: trunk, arm support, force, seated time."),
        ("seated", "Not measured: trunk, arm support, force."),
        ("supported", "Not measured: trunk, force, seated time."),
    ],
)
def test_what_the_diary_does_not_state_is_not_measured(kind: str, told: str) -> None:
    exposure = with_diary(make_exposure())
    periods = tuple(replace(part, kind=kind) for part in exposure.by_period)

    assert profile_of(exposure=replace(exposure, by_period=periods)).not_measured == told


def test_rest_and_busy_minutes_are_on_page_1_with_their_ranges() -> None:
    ranges = {"recovery_neutral_slow_percent": Interval(28.4, 34.0)}

    shown = profile_of(exposure=replace(make_exposure(), intervals=ranges)).rest

    assert [(pair.name, plain(pair.value)) for pair in shown] == [
        ("Rest (arm down, still)", "31.2 % (28.4–34.0 %)"),
        ("Longest without rest", "12 min"),
        ("Minutes with 2+ rises > 60°", "13.4 %"),
    ]


def test_a_scale_that_a_value_would_leave_is_longer() -> None:
    tile = profile_of(exposure=with_percent(47.0)).tiles[1]  # 1.1 x 47 = 51.7

    assert ">60 %<" in plain(tile.scale)


# The day and its tasks.


def test_no_more_than_three_tasks_are_listed_and_a_break_is_none() -> None:
    exposure = with_diary(make_exposure())
    more = replace(exposure.by_task[2], label="Window")
    lunch = replace(exposure.by_task[1], label="Lunch", kind="break", reason="break")

    full, empty = (
        profile_of(exposure=replace(exposure, by_task=tasks)).tasks
        for tasks in ((*exposure.by_task, more), (lunch,))
    )

    assert full is not None
    assert empty is not None
    assert (len(full.rows), empty.columns[0]) == (3, "Time")


def test_the_tasks_stand_under_the_day_with_a_rank_if_their_range_overlaps_with_no_other() -> None:
    strip = profile_of(exposure=with_diary(make_exposure())).strip.wide

    assert re.findall(r">(\d? ?(?:Shelves|Ceilings|Till))<", strip) == [
        "Shelves", "Ceilings", "3 Till", "Shelves",
    ]  # fmt: skip


# How sure.


def test_a_side_lean_is_within_two_degrees_and_ready_angles_have_no_pose() -> None:
    analysis = replace(make_analysis(), calibration=replace(make_calibration(), pose="side-lean"))

    assert "pose error, within 2°" in profile_of(analysis).sure.alternative
    assert "pose" not in profile_of(make_analysis(calibrated=False)).sure.alternative


def test_all_sources_together_lead_the_list_on_the_scale_of_the_tile() -> None:
    sure = profile_of(exposure=ranged_day()).sure

    assert plain(sure.alternative) == (
        "Time above 60°: 7.6 % measured. Range by source of uncertainty: all together, another day, "
        "3.0–15.7 %; this day: angle, variation, 5.2–9.9 %; pose error, up to 14.7 %; between days, "
        "3.7–11.5 %."
    )
    assert ">40 %<" in plain(sure.svg)
    assert ">10 %<" in plain(sure.svg)


def test_poor_data_have_no_range_to_rely_on_and_no_step_that_relies_on_them() -> None:
    upside = (QualityFlag("W-UPSIDE", 1, 25_500.0),)
    poor = replace(make_analysis(exposure=ranged_day()), quality=Quality("poor", ("W-UPSIDE",), upside))
    profile = profile_of(poor)

    assert "all together" not in profile.sure.alternative
    assert profile.next_steps[0] == "Check pose and sensor axis: the angle may be upside down."
    assert not any("planned change" in step or "Look at" in step for step in profile.next_steps)


@pytest.mark.parametrize(("high", "is_told"), [(7.0, False), (9.0, True)])
def test_a_day_below_the_proposal_does_not_speak_for_other_days(high: float, is_told: bool) -> None:
    # 5.0 + sqrt(2.0² + 3.92²) = 9.4; 5.0 + sqrt(4.0² + 3.92²) = 10.6
    note = profile_of(exposure=with_percent(5.0, Interval(4.0, high, 4.0, high))).sure.note

    assert ("Headline: this day only." in note) == is_told


def test_under_half_an_hour_the_page_says_why_it_is_not_sure() -> None:
    sure = profile_of(short_day()).sure

    assert (sure.svg, sure.note.startswith("Not known: with under half an hour")) == ("", True)


def test_under_half_an_hour_the_pose_has_its_french_colon() -> None:
    assert (
        "Erreur de pose\u00a0: sous-estimé jusqu’à 15°." in profile_of(short_day(), language="fr").sure.note
    )


# What next.


@pytest.mark.parametrize(
    ("percent", "step"),
    [
        (4.0, "For a planned change: 5 days before, 5 after (detects 3.5 percentage points, power 80 %)."),
        (11.3, "For a planned change: 2 days before, 2 after (detects 5.6 percentage points, power 80 %)."),
        (16.0, "For a planned change: 1 day before, 1 after (detects 7.9 percentage points, power 80 %)."),
    ],
)
def test_the_days_asked_for_detect_half_the_time_above_with_eighty_percent_power(
    percent: float, step: str
) -> None:
    assert step in map(plain, profile_of(exposure=with_percent(percent)).next_steps)


def test_a_short_recording_is_followed_by_a_whole_shift() -> None:
    steps = profile_of(short_day()).next_steps

    assert plain(steps[0]) == "Record a whole shift, at least 4 h."
    assert not any("planned change" in step for step in steps)


@pytest.mark.parametrize("side", ["right", None])
def test_the_arm_is_asked_for_only_if_it_was_not_stated(side: str | None) -> None:
    profile = build_report(make_analysis(), make_subject(side=side), "en").profile

    assert profile is not None
    assert ("State which arm was measured." in profile.next_steps) == (side is None)
    assert not any("Measure the" in step for step in profile.next_steps)


def test_no_more_than_three_steps_are_offered() -> None:
    open_pose = replace(crowded_day(), calibration=replace(make_calibration(), state="assumed"))

    assert len(profile_of(open_pose).next_steps) == 3


# The conclusion.


def conclude(text: str) -> Report:
    subject = replace(make_subject(), conclusion=Conclusion(text, "A. Martin", "2026-03-10"))
    return build_report(make_analysis(), subject, "en")


def test_a_conclusion_is_on_page_1_with_name_and_date() -> None:
    first = read_first_page(conclude("Shelves lowered; measure again."))

    assert flatten("Conclusion: A. Martin, 10 March 2026") in first
    assert flatten("Shelves lowered; measure again.") in first
    assert flatten("Released by") in first


def test_without_a_conclusion_page_1_has_space_for_one() -> None:
    first = read_first_page(report_of())

    assert flatten("Conclusion Name, date Released by") in first


@pytest.mark.parametrize(
    ("language", "stamp"),
    [("en", "Released by A. Martin, 10 March 2026"), ("fr", "Validé par A. Martin, le 10 mars 2026")],
)
def test_a_released_report_has_the_stamp_on_page_1_in_place_of_the_line_to_sign(
    language: Language, stamp: str
) -> None:
    release = ReleaseStamp("A. Martin", "2026-03-10")
    report = build_report(make_analysis(), make_subject(), language, release)

    first = read_first_page(report)
    assert first.count(flatten(report.words["released_by"])) == 1
    assert flatten(stamp) in first
    assert f'<span class="released">{stamp}</span>' in plain(render_html(report).decode())


def test_a_report_is_set_again_with_the_stamp_of_its_release(tmp_path: Path) -> None:
    results = encode_results(make_analysis(), make_subject())
    (tmp_path / "results.json").write_bytes(results)
    (tmp_path / "again").mkdir()

    request = ReportRequest("a.gt3x", languages=("en",))
    stamp = ReleaseStamp("A. Martin", "2026-03-10")
    set_report_again(tmp_path / "results.json", request, tmp_path / "again", stamp)

    page = PdfReader(tmp_path / "again/report.en.pdf").pages[0].extract_text()
    assert flatten("Released by A. Martin, 10 March 2026") in flatten(page)


def test_a_long_conclusion_begins_on_page_1_and_is_whole_behind_it() -> None:
    text = "Lower the shelves and measure again after four weeks. " * 18
    report = conclude(text)
    pages = [flatten(page.extract_text()) for page in PdfReader(io.BytesIO(render_pdf(report, {}))).pages]

    assert flatten("(continued on page 2)") in pages[0]
    assert flatten(text) in pages[1]


def read_first_page(report: Report) -> str:
    return flatten(PdfReader(io.BytesIO(render_pdf(report, {}))).pages[0].extract_text())


# The line of quality.


def test_the_line_of_quality_names_the_gravest_two() -> None:
    flags = (QualityFlag("W-REMOUNT"), QualityFlag("W-GAP", 2, 1200.0), QualityFlag("W-DUP"))
    quality = Quality("caution", ("W-REMOUNT", "W-GAP", "W-DUP"), flags)

    assert plain(profile_of(make_analysis(quality=quality)).quality) == (
        "No pose after the sensor moved; holes in the recording (20 min); 1 more."
    )


def test_a_recording_without_a_fault_is_called_so() -> None:
    quality = profile_of(make_analysis(quality=make_quality("good"))).quality

    assert quality == "No fault in the recording."


def test_proposals_are_cited_only_if_something_is_compared_with_them() -> None:
    told = "50 %, 10 %, 60°/s: proposed upper values of a workday (Arvidsson 2021), not limits."
    assert plain(profile_of().proposals) == told
    assert profile_of(short_day()).proposals == ""


# In print.


def crowded_day() -> Findings:
    """A diary of thirty tasks of long names, and as much to warn of as there is."""
    exposure = with_percent(47.0, Interval(41.0, 52.0, 41.0, 61.0))
    part = with_diary(exposure).by_period[0]
    tasks = tuple(
        replace(part, label=f"Mounting and painting the long ceiling panels {k}", start_s=a, end_s=a + 900.0)
        for k, a in enumerate(range(0, 27_000, 900))
    )
    codes = ("W-NO-STILL", "W-LOWCOVER", "W-REMOUNT", "W-GAP", "W-NONWEAR", "W-UNTRUSTED", "W-BIAS", "W-CLIP")
    quality = Quality("poor", codes, tuple(QualityFlag(code, 3, 1234.0) for code in codes))
    return make_analysis(exposure=replace(exposure, by_period=tasks, by_task=tasks), quality=quality)


DAYS: dict[str, Callable[[], Findings]] = {
    "clean": lambda: make_analysis(quality=make_quality("good")),
    "short": short_day,
    "with a diary": lambda: make_analysis(
        exposure=with_diary(with_percent(7.6, Interval(6.0, 9.5, 6.0, 13.3)))
    ),
    "without a clock": lambda: make_analysis(start=None),
    "crowded and amended": crowded_day,
    "pose not confirmed": lambda: replace(
        crowded_day(), calibration=replace(make_calibration(), state="assumed")
    ),
    "needs the pose": lambda: replace(make_analysis(), calibration=open_calibration()),
}
AMENDED = replace(
    make_subject(),
    version=3,
    changes=("diary", "side", "pose"),
    reason="The diary was of the day before, and the arms were exchanged in the protocol of the visit. " * 2,
)


@cache
def print_of(day: str, language: Language, paper: Paper) -> tuple[Report, bytes]:
    subject = AMENDED if day == "crowded and amended" else make_subject()
    report = build_report(DAYS[day](), subject, language)
    return report, render_pdf(report, {}, paper)


def test_an_amended_report_says_so_on_page_1_and_why_behind_it() -> None:
    report, document = print_of("crowded and amended", "en", "a4")
    first, second = (flatten(page.extract_text()) for page in PdfReader(io.BytesIO(document)).pages[:2])

    assert flatten("Version 3 replaces version 2: page 2 says why.") in first
    assert flatten(report.amendment) in second
    assert "exchanged in the protocol" in report.amendment


def flatten(text: str) -> str:
    return re.sub(r"\s", "", text)


@pytest.mark.skipif(shutil.which("pdftotext") is None, reason="poppler (pdftotext) is not installed")
@pytest.mark.parametrize("language", LANGUAGES)
@pytest.mark.parametrize("day", DAYS)
def test_page_1_holds_at_most_two_hundred_words_of_three_letters(day: str, language: Language) -> None:
    _, document = print_of(day, language, "a4")

    command = ["pdftotext", "-f", "1", "-l", "1", "-", "-"]
    text = subprocess.run(command, input=document, capture_output=True, check=True).stdout.decode()

    assert len(re.findall(r"[^\W\d_]{3,}", text)) <= MOST_WORDS


def list_sizes_pt(document: bytes) -> set[float]:
    """Return the sizes of all words of page 1, those of its drawings included."""
    sizes: set[float] = set()

    def note(text: str, cm: list[float], tm: list[float], _: object, size: float) -> None:
        if text.strip():
            across = tm[2] * cm[0] + tm[3] * cm[2]
            sizes.add(round(size * hypot(across, tm[2] * cm[1] + tm[3] * cm[3]), 2))

    PdfReader(io.BytesIO(document)).pages[0].extract_text(visitor_text=note)
    return sizes


@pytest.mark.parametrize("paper", PAPERS)
@pytest.mark.parametrize("language", LANGUAGES)
@pytest.mark.parametrize("day", DAYS)
def test_the_profile_is_one_page_of_which_no_word_is_smaller_than_9_pt(
    day: str, language: Language, paper: Paper
) -> None:
    report, document = print_of(day, language, paper)

    first, second = (flatten(page.extract_text()) for page in PdfReader(io.BytesIO(document)).pages[:2])
    assert report.profile is not None
    assert flatten(report.profile.not_a_diagnosis) in first
    assert flatten(report.sentences[0]) in second
    assert min(list_sizes_pt(document)) >= LEAST_PT
