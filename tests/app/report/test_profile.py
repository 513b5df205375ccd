"""The first page: the Arm Elevation Profile."""

import io
import re
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from math import hypot

import pytest
from pypdf import PdfReader

from app.report.findings import Findings
from app.report.model import Profile, Report
from app.report.render.pdf import render_pdf
from app.report.single.report import build_report
from app.report.words.wording import LANGUAGES, Language
from app.request import Paper
from fusion.conventions import Pose
from fusion.exposure.types import Entries, Exposure, Interval
from fusion.quality import Quality, TimeAccount
from fusion.recording import QualityFlag
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


def short_day() -> Findings:
    """Three minutes, which have neither ranges nor rates."""
    exposure = replace(
        make_exposure(), analysed_s=180.0, quarter_hours=(), entries=(Entries(60, 15, None),), peak_windows=()
    )
    time = TimeAccount(180_000_000, 180_000_000, 0, 0)
    return replace(make_analysis(exposure=exposure, quality=make_quality("poor")), time=time)


# Tiles.


def test_each_published_value_is_named_by_author_and_year() -> None:
    assert [plain(tile.published) for tile in profile_of().tiles] == [
        "Proposal: at most 50 % (Arvidsson 2021)",
        "Proposal: at most 10 % (Arvidsson 2021)",
        "Other workers (Lewis 2026)",
        "No comparable published value",
    ]


def test_the_scale_shows_the_published_value() -> None:
    scales = [plain(tile.scale) for tile in profile_of().tiles]

    assert [
        mark in scale
        for mark, scale in zip((">50 %<", ">10 %<", ">1.0–2.8 %<", "accent"), scales, strict=True)
    ] == [True, True, True, False]


def test_less_than_four_hours_and_poor_data_have_no_published_value_beside_them() -> None:
    exposure = replace(make_exposure(), analysed_s=14_399.0)
    analysis = replace(
        make_analysis(exposure=exposure), time=TimeAccount(14_399_000_000, 14_399_000_000, 0, 0)
    )

    tiles = profile_of(analysis).tiles

    assert [tile.published for tile in tiles[:3]] == ["Under 4\u00a0h: not compared"] * 3
    assert not any("accent" in tile.scale for tile in tiles)
    assert (
        profile_of(make_analysis(quality=make_quality("poor"))).tiles[1].published
        == "Poor data: not compared"
    )


def test_a_rate_that_is_not_given_has_no_scale() -> None:
    tile = profile_of(short_day()).tiles[3]

    assert (tile.value, plain(tile.duration), tile.scale) == ("–", "15 in all", "")


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


def test_the_tasks_stand_under_the_day_with_their_rank() -> None:
    strip = profile_of(exposure=with_diary(make_exposure())).strip.wide

    assert re.findall(r">(\d? ?(?:Shelves|Ceilings|Till))<", strip) == [
        "2 Shelves", "1 Ceilings", "3 Till", "2 Shelves",
    ]  # fmt: skip


# How sure.


def test_a_side_lean_is_within_two_degrees_and_ready_angles_have_no_pose() -> None:
    analysis = replace(make_analysis(), calibration=replace(make_calibration(), pose="side-lean"))

    assert "pose, within 2°" in profile_of(analysis).sure.alternative
    assert "pose" not in profile_of(make_analysis(calibrated=False)).sure.alternative


def test_under_half_an_hour_the_page_says_why_it_is_not_sure() -> None:
    sure = profile_of(short_day()).sure

    assert (sure.svg, sure.note.startswith("Not known: with under half an hour")) == ("", True)


def test_under_half_an_hour_the_pose_has_its_french_colon() -> None:
    assert "Pose\u00a0: sous-estimé jusqu’à 15°." in profile_of(short_day(), language="fr").sure.note


# What next.


@pytest.mark.parametrize(
    ("percent", "step"),
    [
        (4.0, "To detect a change of 2.5 points above 60°, measure 4 more days now and 5 after it."),
        (8.0, "To detect a change of 3.9 points above 60°, measure 1 more day now and 2 after it."),
        (11.2, "To detect a change of 5.5 points above 60°, measure one day after it."),
    ],
)
def test_the_days_asked_for_tell_a_change_of_half_the_time_above(percent: float, step: str) -> None:
    assert step in profile_of(exposure=with_percent(percent)).next_steps


def test_a_short_recording_is_followed_by_a_whole_shift() -> None:
    steps = profile_of(short_day()).next_steps

    assert plain(steps[0]) == "Record a whole shift, at least 4 h."
    assert not any("after a change" in step for step in steps)


@pytest.mark.parametrize(
    ("side", "step"), [("right", "Measure the left arm too."), (None, "State which arm was measured.")]
)
def test_the_other_arm_is_next(side: str | None, step: str) -> None:
    profile = build_report(make_analysis(), make_subject(side=side), "en").profile

    assert profile is not None
    assert profile.next_steps[-1] == step


# The line of quality.


def test_the_line_of_quality_names_the_gravest_two() -> None:
    flags = (QualityFlag("W-REMOUNT"), QualityFlag("W-GAP", 2, 1200.0), QualityFlag("W-DUP"))
    quality = Quality("caution", ("W-REMOUNT", "W-GAP", "W-DUP"), flags)

    assert plain(profile_of(make_analysis(quality=quality)).quality) == (
        "No pose after the sensor moved; holes in the recording (20 min); 1 more."
    )


@pytest.mark.parametrize(
    ("pose", "more"), [("n-pose", ", but the pose may hide time above 60°"), ("side-lean", "")]
)
def test_a_recording_without_a_fault_is_told_so_with_what_its_pose_hides(pose: Pose, more: str) -> None:
    findings = make_analysis(quality=make_quality("good"))

    told = profile_of(replace(findings, calibration=replace(make_calibration(), pose=pose))).quality

    assert told == f"No fault was found in the recording{more}."


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
