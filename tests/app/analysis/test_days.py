"""Several days of a person, of both arms, or of a group: what is refused, what is told, and the figures."""

import csv
import io
import json
import re
from dataclasses import replace
from math import sqrt
from typing import Any

import pytest

from acromion.app.errors import CannotProfile
from acromion.app.report.model import Report
from acromion.app.report.pairs import encode_document, mark_rounding
from acromion.app.report.several.charts import FigureRow, build_rows
from acromion.app.report.several.document import describe_profile, encode_day_table, encode_overlay_table
from acromion.app.report.several.people import MeasuredDay, Stage, StudiedDays, group_days
from acromion.app.report.several.report import build_days
from acromion.app.report.words.wording import Language, load_wording
from acromion.fusion.comparison.days import ClockBand
from acromion.fusion.exposure.types import Interval
from tests.app.analysis.days_factory import MONDAY, change_findings, change_recording, make_day
from tests.app.analysis_factory import make_quality
from tests.app.report.report_reading import plain

FIVE = (4.0, 6.0, 6.0, 6.0, 8.0)
BANDS = (
    ClockBand(28_800.0, 5, {10: 5.0, 25: 12.0, 50: 25.0, 75: 40.0, 90: 61.0}),
    ClockBand(29_700.0, 1, None),
    ClockBand(31_500.0, 4, {10: 6.0, 25: 13.0, 50: 26.0, 75: 41.0, 90: 62.0}),
)


def week(*percents: float, **words: Any) -> list[MeasuredDay]:
    return [make_day(day, percent, **words) for day, percent in enumerate(percents)]


def short(day: MeasuredDay) -> MeasuredDay:
    return change_findings(day, exposure=replace(day.kept.findings.exposure, analysed_s=14_399.0))


def by_another_method(day: MeasuredDay) -> MeasuredDay:
    assert day.kept.findings.method is not None
    return change_findings(day, method=replace(day.kept.findings.method, version="0.9"))


def of_another_person(day: MeasuredDay) -> MeasuredDay:
    return replace(day, kept=replace(day.kept, subject=replace(day.kept.subject, subject="S999")))


def group_of(people: int, *, both_sides: int | None = None) -> list[MeasuredDay]:
    """Days of several people: 4 and 6 % or 10 and 12 %; with a change one day before and one after it."""
    days = []
    for person in range(people):
        first, second = (4.0, 6.0) if person % 2 == 0 else (10.0, 12.0)
        subject = f"S{person:02d}"
        if both_sides is None:
            days += week(first, second, subject=subject)
        else:
            stage: Stage = "after" if person < both_sides else "before"
            days.append(make_day(0, first, subject=subject, stage="before"))
            days.append(make_day(30, second + person / 2, subject=subject, stage=stage))
    return days


# ------------------------------------------------------------------ what is refused


LATER = MONDAY.replace(hour=15)  # the first day lasts 7 h 59 min from 8 h on


@pytest.mark.parametrize(
    ("days", "why"),
    [
        (week(7.6), "one"),
        ([make_day(0), of_another_person(make_day(0))], "same"),
        ([make_day(0), change_recording(make_day(1), start=LATER)], "hours"),
        ([make_day(0, stage="before"), change_recording(make_day(1, stage="after"), start=MONDAY)], "hours"),
        ([make_day(0), make_day(1, subject="S013"), make_day(2, subject="")], "codes"),
        ([make_day(0), by_another_method(make_day(1))], "methods"),
        ([make_day(0), make_day(1, subject="")], "person"),
        (group_of(4), "few"),
        ([*group_of(4), short(make_day(0, subject="S99"))], "few"),
    ],
)
def test_what_is_no_profile_is_refused(days: list[MeasuredDay], why: str) -> None:
    with pytest.raises(CannotProfile) as refused:
        group_days(days)

    assert refused.value.facts["why"] == why


def test_both_arms_of_one_shift_are_accepted() -> None:
    studied = group_days([make_day(0), make_day(0, side="left")])

    assert [arm.side for arm in studied.arms] == ["left", "right"]


def test_two_methods_are_accepted_and_named_if_that_is_asked_for() -> None:
    studied = group_days([make_day(0), by_another_method(make_day(1))], mixed_methods=True)

    assert studied.differences == ("method",)


# ------------------------------------------------------------------ what is told


def test_somebody_may_say_that_a_recording_without_a_code_is_of_the_one_person() -> None:
    studied = group_days([make_day(0), make_day(1, subject="")], same_subject=True)

    assert (studied.one_person, studied.people) == ("person", ("S012",))


def in_another_way(day: MeasuredDay) -> MeasuredDay:
    other = change_recording(day, device="axivity")
    calibration = replace(other.kept.findings.calibration, pose="side-lean")  # type: ignore[type-var]
    return change_findings(other, calibration=calibration, quality=make_quality("poor"))


@pytest.mark.parametrize(
    ("days", "named"),
    [
        (week(*FIVE), ()),
        ([make_day(0), in_another_way(make_day(1))], ("pose", "sensor", "poor")),  # the gravest first
        ([make_day(0), make_day(1, side=None)], ("side",)),
        ([make_day(0), change_recording(make_day(1), start=MONDAY.replace(hour=16))], ("date",)),
        ([make_day(0), change_recording(make_day(1), start=None)], ("clock",)),
        ([make_day(0, stage="after"), make_day(1, stage="before")], ("order",)),
        ([*week(4.0, 8.0), short(make_day(2, 90.0))], ("short",)),
    ],
)
def test_what_differs_between_the_days_is_named(days: list[MeasuredDay], named: tuple[str, ...]) -> None:
    assert group_days(days).differences == named


def test_a_day_of_less_than_four_hours_or_more_than_a_day_does_not_count() -> None:
    long = change_recording(make_day(3, 90.0), duration_us=86_401_000_000)
    studied = group_days([*week(4.0, 8.0), short(make_day(2, 90.0)), long])

    assert [day.left_out for day in studied.days] == [None, None, "short", "long"]
    assert studied.arms[0].list_values("time_above_60_percent") == [4.0, 8.0]


# ------------------------------------------------------------------ figures


def figures_of(studied: StudiedDays) -> dict[str, Any]:
    figures: dict[str, Any] = describe_profile(studied)["arms"][0]["figures"]["time_above_60_percent"]
    return figures


def with_pose(day: MeasuredDay, high_pose: float) -> MeasuredDay:
    exposure = day.kept.findings.exposure
    above = tuple(
        replace(item, interval=Interval(5.0, 9.0, 4.0, high_pose)) if item.threshold_deg == 60 else item
        for item in exposure.time_above
    )
    return change_findings(day, exposure=replace(exposure, time_above=above))


def test_the_error_of_the_pose_is_the_mean_of_the_days_and_unknown_if_one_has_another_pose() -> None:
    days = [with_pose(make_day(0), 12.0), with_pose(make_day(1), 14.0)]
    known, unknown = (figures_of(group_days(some)) for some in (days, [days[0], make_day(1)]))

    assert (known["low_pose"], known["high_pose"]) == (4.0, 13.0)
    assert (unknown["low_pose"], unknown["high_pose"]) == (None, None)
    assert "up to 13.0 % with the N-pose error" in plain(report_of(days).sentences[0])


def test_from_five_days_on_the_trend_is_judged_by_the_persons_own_deviation() -> None:
    (arm,) = describe_profile(group_days(week(*FIVE)))["arms"]
    trend = arm["trend"]  # deviation sqrt(2): 1.96 sqrt(2) sqrt(2) = 3.92, and 8 is 4 above the first

    assert (trend["sd_from"], trend["outside"]) == ("person", 1)
    assert trend["detectable"] == pytest.approx(3.92, abs=1e-6)


def test_the_answer_tells_the_way_from_the_first_day_to_the_last() -> None:
    sentences = build_days(group_days(week(10.0, 12.0, 16.0)), "en").sentences

    assert plain(sentences[2]) == (
        "From 2 March 2026 (10.0 %) to 4 March 2026 (16.0 %): +6.0 points. This is larger than the usual "
        "variation between two single days (5.5 points, using the published standard deviation). "
        "Of the 2 later days, 1 differs from the first by more."
    )


def test_every_day_is_drawn_by_its_date_with_what_days_differ_by() -> None:
    report = report_of(week(10.0, 12.0))

    (drawing,) = (figure for section in report.sections for figure in section.figures)
    assert drawing.title == "Day after day: time above 60°"
    told = [(date, plain(percent)) for _, date, percent in drawing.table.rows]
    assert told == [("2026-03-02", "10.0 %"), ("2026-03-03", "12.0 %")]
    assert drawing.wide.count("<circle") == 2
    assert "minimal detectable change between two single days (95 %): Right arm 5.5 points" in plain(
        drawing.note
    )


def test_days_without_a_clock_are_not_drawn_and_those_before_and_after_have_no_trend() -> None:
    clockless = report_of([change_recording(day, start=None) for day in week(10.0, 12.0)])
    days = [make_day(0, stage="before"), make_day(1, stage="before"), make_day(2, stage="after")]

    assert not any(section.figures for section in clockless.sections)
    assert [arm["trend"] for arm in describe_profile(group_days(days))["arms"]] == [None, None]


def test_a_group_has_its_spread_between_and_within_people() -> None:
    (group,) = describe_profile(group_days(group_of(5)))["group"]

    above = group["figures"]["time_above_60_percent"]
    assert (above["people"], above["days"], above["mean"]) == (5, 10, 7.4)
    assert above["within_sd"] == pytest.approx(sqrt(2), abs=1e-6)
    assert above["between_sd"] == pytest.approx(sqrt(9.8), abs=1e-6)


def test_a_group_names_nobody_and_one_person_is_none() -> None:
    days = group_of(5)
    document, report = describe_profile(group_days(days)), report_of(days)

    assert document["arms"] == []
    assert re.search(r"S0\d\b|\.gt3x", json.dumps(document) + str(report)) is None
    assert describe_profile(group_days(week(*FIVE)))["group"] == []


def test_the_chart_of_a_group_has_one_row_for_the_mean_with_its_range() -> None:
    (chart,) = report_of(group_of(5)).figures
    mean = describe_profile(group_days(group_of(5)))["group"][0]["figures"]["time_above_60_percent"]

    (row,) = chart.table.rows
    assert plain(row[2]) == f"{mean['mean']:.1f} %"
    assert chart.wide.count('stroke-width="1.6"') == 4 * 3  # a range with two ends for each figure


def test_no_change_is_given_of_four_people_of_five_or_without_a_day_on_both_sides() -> None:
    four = group_of(5, both_sides=4)
    one_sided = [make_day(0, stage="before"), make_day(30, side="left", stage="after")]

    assert describe_profile(group_days(four))["change"] == []
    assert report_of(four).sentences[0].startswith("Fewer than five people")
    assert report_of(one_sided).sentences == (
        "Nobody has counted days both before and after, so no change is given.",
    )


def test_one_persons_change_is_judged_by_their_own_deviation_from_four_degrees_of_freedom_on() -> None:
    days = [*week(9.0, 10.0, 11.0, stage="before")]
    days += [make_day(30 + day, 7.0 + day, stage="after") for day in range(3)]

    (change,) = describe_profile(group_days(days))["change"]

    told = change["figures"]["time_above_60_percent"]
    assert (told["change"], told["verdict"]) == (-2.0, "larger")
    assert told["detectable"] == pytest.approx(1.96 * sqrt(2 / 3), abs=1e-6)  # pooled SD 1


def test_a_groups_change_is_judged_by_its_own_range() -> None:
    (change,) = describe_profile(group_days(group_of(5, both_sides=5)))["change"]

    above = change["figures"]["time_above_60_percent"]
    # changes of 2.0, 2.5, 3.0, 3.5 and 4.0: 2.776 x 0.7906 / sqrt(5)
    assert above["change_range"] == pytest.approx([2.018, 3.982], abs=1e-3)
    assert above["verdict"] == "larger"


# ------------------------------------------------------------------ tables


def read(table: bytes) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(table.decode())))


def test_the_table_has_a_row_for_each_day() -> None:
    rows = read(encode_day_table(group_days(week(*FIVE))))

    assert [row["time_above_60_percent"] for row in rows] == ["4.0", "6.0", "6.0", "6.0", "8.0"]
    assert rows[0]["start"] == "2026-03-02T08:00:00"
    (formula, _) = read(encode_day_table(group_days(week(4.0, 6.0, subject="=1+1"))))
    assert formula["subject"] == "'=1+1"


def test_the_overlay_is_empty_where_too_few_days_are() -> None:
    studied = overlaid(group_days(week(*FIVE)))

    rows = read(encode_overlay_table(studied))

    assert [(row["clock"], row["days"], row["p50_deg"]) for row in rows] == [
        ("08:00", "5", "25.0"),
        ("08:15", "1", ""),
        ("08:45", "4", "26.0"),
    ]


# ------------------------------------------------------------------ the report


def overlaid(studied: StudiedDays) -> StudiedDays:
    return replace(studied, arms=tuple(replace(arm, bands=BANDS) for arm in studied.arms))


def report_of(days: list[MeasuredDay], language: Language = "en") -> Report:
    return build_days(overlaid(group_days(days)), language)


def test_the_answer_states_mean_range_and_spread() -> None:
    mean, spread, _ = map(plain, report_of(week(*FIVE)).sentences)

    assert mean == (
        "Right arm, 5 days: time above 60° was 6.0 % of the analysed time on average (4.2–7.8 %), "
        "and 4.0 % to 8.0 % on single days. Compared with the proposed 10 % of a working day: cannot tell."
    )
    assert spread == (
        "Days differ by 1.4 points (standard deviation, 95 % range 0.8–4.1). These days can detect "
        "a change of 1.8 points (1.1–5.0) against as many later days, using this person's standard deviation."
    )


def with_ranges(day: MeasuredDay, low: float, high: float, high_pose: float) -> MeasuredDay:
    """The same day, with the given distances of the ends from each share."""
    exposure = day.kept.findings.exposure
    above = tuple(
        replace(
            item,
            interval=Interval(
                item.percent - low, item.percent + high, item.percent, item.percent + high_pose
            ),
        )
        for item in exposure.time_above
    )
    return change_findings(day, exposure=replace(exposure, time_above=above))


@pytest.mark.parametrize(
    ("percents", "distances", "told"),
    [
        # mean 6, t(4) sd/sqrt(5) = 2.776 × 1.414 / 2.236 = 1.756: 4.2 to 7.8
        (FIVE, (1.0, 1.0, 3.9), ("4.2–7.8", 9.9, "below", 0)),  # the pose raises the days to 9.9 on average
        (FIVE, (1.0, 1.0, 4.0), ("4.2–7.8", 10.0, "cannot tell", 0)),
        (FIVE, (3.4, 4.1, 4.1), ("2.6–10.1", 10.1, "cannot tell", 0)),  # the error of the angle alone
        ((14.0, 16.0, 16.0, 16.0, 18.0), (3.9, 1.0, 3.0), ("12.1–17.8", 19.0, "above", 5)),
    ],
)
def test_a_mean_is_below_a_level_only_with_every_end_of_its_range(
    percents: tuple[float, ...], distances: tuple[float, float, float], told: tuple[Any, ...]
) -> None:
    studied = group_days([with_ranges(day, *distances) for day in week(*percents)])

    levels = {level["key"]: level for level in describe_profile(studied)["arms"][0]["levels"]}

    level = levels["above_60"]
    assert f"{level['low']:.1f}–{level['high']:.1f}" == told[0]
    assert (level["standing"], level["days_above"], level["days"]) == (told[2], told[3], 5)
    assert level["high_pose"] == pytest.approx(told[1])


def test_a_poor_day_is_not_compared_with_a_level() -> None:
    days = [with_ranges(day, 1.0, 1.0, 1.0) for day in week(*FIVE)]
    poor = change_findings(days[0], quality=make_quality("poor"))

    sentence = plain(report_of([poor, *days[1:]]).sentences[0])

    assert sentence.endswith("proposed 10 % of a working day: not compared (poor data).")


def test_a_group_is_compared_with_the_levels_each_person_once() -> None:
    days = [with_ranges(day, 1.0, 1.0, 1.0) for day in group_of(6)]

    report, document = report_of(days), describe_profile(group_days(days))

    level = document["group"][0]["levels"][1]
    assert (level["measured"], level["standing"], level["days_above"], level["days"]) == (
        8.0,
        "cannot tell",
        3,
        12,
    )
    rows = [[plain(cell) for cell in row] for row in report.sections[0].tables[0].rows]
    assert rows[1] == [
        "Time above 60°",
        "at most 10 %",
        "8.0 %",
        "4.6–11.4 %",
        "9.0 %",
        "cannot tell",
        "3 of 12",
    ]


def test_the_line_of_a_range_is_never_cut() -> None:
    row = FigureRow("Mean", (2.0,), ("2.0 %",), ((0.0, 9.0),), is_mean=True)

    chart = build_rows([row], ("Days", "Day"), ["Above 60°"], load_wording("en", "days"))

    ends = {float(x) for x in re.findall(r'<line x1="([\d.]+)" y1="[\d.]+" x2="\1"', chart.wide)}
    assert ends == {150.0, 670.0}  # the column from its start to its end


@pytest.mark.parametrize(
    ("values", "mark"),
    [((4.0, 6.0, 2.0), ""), ((12.04, 6.96, -5.08), "*"), ((27.3, 13.6, -13.7), "")],
)
def test_a_difference_that_the_printed_values_do_not_give_is_marked(
    values: tuple[float, float, float], mark: str
) -> None:
    assert mark_rounding(*values, "time_above_60_percent", "*") == mark


def test_the_answer_says_how_many_days_are_still_needed() -> None:
    spread = plain(report_of(week(4.0, 8.0), "fr").sentences[1])

    assert spread.endswith(
        "Avec 3 jours de plus, 5 jours décèlent un changement de 2,5 points par rapport à "
        "autant de jours ultérieurs, d'après l'écart type publié."
    )


def test_a_change_is_the_whole_answer() -> None:
    days = [*week(10.0, 12.0, stage="before"), make_day(30, 5.0, stage="after")]

    (told,) = map(plain, report_of(days).sentences)

    assert told == (
        "Right arm: mean time above 60° changed from 11.0 % (2 days) to 5.0 % (1 day): −6.0 points. The "
        "change is larger than the usual variation for this many days (minimal detectable change: "
        "4.8 points)."
    )


def test_one_day_that_counts_has_no_spread_and_both_arms_are_drawn_on_one_clock() -> None:
    one = report_of([make_day(0), short(make_day(1))])
    both = report_of([*week(4.0, 8.0), *week(5.0, 6.0, side="left")])

    assert (one.verdict.level, one.verdict.label) == ("poor", "One day shows no spread.")
    assert [figure.title for figure in both.figures] == ["The days by time of day", "Day by day"]
    drawn = plain(both.figures[0].wide)
    assert [name in drawn for name in ("Left arm, 5 days", "Right arm, 5 days")] == [True] * 2


def test_time_with_too_few_days_is_left_white_and_each_time_has_its_number_of_days() -> None:
    drawing = report_of(week(*FIVE)).figures[0]

    assert drawing.wide.count('class="median"') == 3  # two runs, and the key of the legend
    assert [row[1:3] for row in drawing.table.rows] == [("08:00", "5"), ("08:15", "1"), ("08:45", "4")]


def test_the_same_days_give_the_same_bytes_in_whatever_order() -> None:
    there, back = (describe_profile(group_days(days)) for days in (week(*FIVE), week(*FIVE)[::-1]))

    assert encode_document(there) == encode_document(back)


def in_job(days: list[MeasuredDay], title: str, isco_code: str = "") -> list[MeasuredDay]:
    stated = [replace(day.kept.subject, job_title=title, isco_code=isco_code) for day in days]
    return [
        replace(day, kept=replace(day.kept, subject=subject))
        for day, subject in zip(days, stated, strict=True)
    ]


def in_two_jobs(first: int, second: int) -> list[MeasuredDay]:
    """Days of ``first`` carpenters (7115) and ``second`` people whose job is not stated, two each."""
    days = group_of(first + second)
    return [*in_job(days[: 2 * first], "Carpenter", "7115"), *days[2 * first :]]


def test_each_job_of_five_people_has_its_spread_between_and_within_people() -> None:
    carpenters, others = describe_profile(group_days(in_two_jobs(5, 6)))["jobs"]

    above = carpenters["figures"]["time_above_60_percent"]
    assert (carpenters["job_title"], carpenters["isco_code"]) == ("Carpenter", "7115")
    assert (above["people"], above["days"], above["mean"]) == (5, 10, 7.4)
    assert above["within_sd"] == pytest.approx(sqrt(2), abs=1e-6)
    assert above["between_sd"] == pytest.approx(sqrt(9.8), abs=1e-6)
    assert (others["job_title"], others["figures"]["time_above_60_percent"]["people"]) == (None, 6)


def test_no_job_is_shown_if_the_others_would_be_fewer_than_five_people() -> None:
    assert describe_profile(group_days(in_two_jobs(6, 4)))["jobs"] == []


def test_the_smallest_job_joins_others_of_fewer_than_five_people() -> None:
    days = group_of(14)
    days = [*in_job(days[:12], "Painter"), *in_job(days[12:24], "Cook", "5120"), *days[24:]]

    shown = describe_profile(group_days(days))["jobs"]

    people = [job["figures"]["time_above_60_percent"]["people"] for job in shown]
    assert [job["job_title"] for job in shown] == ["Painter", None]
    assert people == [6, 8]


def test_a_job_title_is_the_same_in_capitals() -> None:
    days = group_of(6)
    (job,) = describe_profile(group_days([*in_job(days[:4], "PAINTER"), *in_job(days[4:], "Painter")]))[
        "jobs"
    ]

    assert (job["job_title"], job["figures"]["time_above_60_percent"]["people"]) == ("Painter", 6)


def test_the_report_of_a_group_has_a_table_for_each_job() -> None:
    (jobs,) = (part for part in report_of(in_two_jobs(5, 5)).sections if part.key == "jobs")

    assert [table.caption.split(",")[0] for table in jobs.tables] == ["7115 Carpenter", "Other jobs"]
