"""One day beside another: the change, whether days differ as much anyway, and what else is different."""

import json
from dataclasses import replace
from datetime import timedelta
from typing import Any, Literal

import pytest

from acromion.app.errors import CannotCompare
from acromion.app.report.findings import FinishedAnalysis
from acromion.app.report.model import Report, format_brief
from acromion.app.report.pairs import build_comparison, check_comparable, describe_comparison, encode_document
from acromion.app.report.render.html import render_html
from acromion.fusion.conventions import CalibrationState
from tests.app.analysis.days_factory import MONDAY, make_day
from tests.app.report.report_reading import plain


def kept_with(
    above_60_percent: float = 7.6, side: str = "right", subject: str = "S012", day: int = 1
) -> FinishedAnalysis:
    return make_day(day, above_60_percent, subject=subject, side=side).kept


BEFORE = kept_with(day=0)


def analysed_otherwise(
    kept: FinishedAnalysis, part: Literal["method", "calibration", "recording"], **changes: Any
) -> FinishedAnalysis:
    changed: Any = replace(getattr(kept.findings, part), **changes)
    return replace(kept, findings=replace(kept.findings, **{part: changed}))


def held(kept: FinishedAnalysis, state: CalibrationState) -> FinishedAnalysis:
    return analysed_otherwise(kept, "calibration", state=state)


def report_of(after: FinishedAnalysis) -> Report:
    return build_comparison(BEFORE, after, "en")


def test_a_change_above_the_least_detectable_one_is_called_larger() -> None:
    sentence = plain(report_of(kept_with(13.2)).sentences[0])

    assert sentence == (
        "Time above 60° changed from 7.6 % to 13.2 % of the analysed time (+5.6 points). "
        "The change is larger than the usual day-to-day variation "
        "(minimal detectable change, 95 %: 5.5 points)."
    )


def test_like_is_compared_with_like_and_the_error_of_the_pose_stands_there_once() -> None:
    report = report_of(kept_with())

    assert report.verdict.level == "good"
    assert report.pose_caution.count("15° low") == 1


def test_what_differs_besides_the_work_is_named() -> None:
    verdict = report_of(analysed_otherwise(kept_with(), "calibration", pose="side-lean")).verdict

    assert verdict.level == "caution"
    assert verdict.reason == "The two differ in more than the work: the calibration pose."


def test_a_pose_that_nobody_confirmed_comes_first_and_no_change_is_judged() -> None:
    after = held(kept_with(13.2), "assumed")
    report = report_of(after)
    answer, page = plain(format_brief(report).decode()), plain(render_html(report).decode())

    first = (
        "After: calibration pose assumed, not confirmed. A change cannot be distinguished from a pose error."
    )
    assert answer.splitlines()[0] == first
    assert first in page
    for told in ("larger than the usual day-to-day", "Like with like"):
        assert told not in answer
    document = describe_comparison(BEFORE, after)
    assert document["differences"] == ["unconfirmed pose"]
    assert {(f["detectable"], f["verdict"]) for f in document["figures"]} == {(None, "unconfirmed pose")}


def test_a_strapped_axis_needs_no_confirmed_pose_and_a_day_without_a_pose_does() -> None:
    told = [report_of(held(kept_with(), state)).needs_pose for state in ("axis", "none")]

    assert told[0] == ""
    assert told[1].startswith("After: no calibration pose found, none confirmed.")


def test_the_document_holds_the_same_change_as_the_page() -> None:
    document = describe_comparison(BEFORE, kept_with(13.2))

    figure = next(f for f in document["figures"] if f["name"] == "time_above_60_percent")
    assert (figure["before"], figure["after"], figure["change"]) == (7.6, 13.2, 5.6)
    assert (figure["detectable"], figure["verdict"]) == (5.543717, "larger")
    other_arm = json.loads(encode_document(describe_comparison(BEFORE, kept_with(side="left"))))
    assert (other_arm["before"]["side"], other_arm["after"]["side"]) == ("right", "left")
    assert other_arm["differences"] == ["side"]


def test_a_missing_code_is_said_beside_the_change() -> None:
    report = build_comparison(BEFORE, kept_with(subject=""), "en", same_subject=True)

    assert plain(report.pose_caution).startswith("A subject code is missing; the person who requested")


def why_refused(
    after: FinishedAnalysis, before: FinishedAnalysis = BEFORE, *, mixed_methods: bool = False
) -> object:
    try:
        check_comparable(before, after, mixed_methods=mixed_methods)
    except CannotCompare as refusal:
        return refusal.facts["why"]
    return None


@pytest.mark.parametrize(
    ("after", "why"),
    [
        (kept_with(30.0), None),
        (kept_with(subject="S999"), "subjects"),
        (kept_with(subject=""), "person"),
        (analysed_otherwise(kept_with(), "recording", start=MONDAY), "same hours"),
        (analysed_otherwise(kept_with(side="left"), "recording", start=MONDAY), None),
        (BEFORE, "same"),
        (kept_with(13.0, day=0), None),  # another analysis of the same recording
        (analysed_otherwise(kept_with(), "method", version="999"), "methods"),
    ],
)
def test_only_different_days_of_one_person_by_one_method_are_compared(
    after: FinishedAnalysis, why: str | None
) -> None:
    assert why_refused(after) == why


def test_two_methods_are_compared_if_that_is_asked_for() -> None:
    assert why_refused(analysed_otherwise(kept_with(), "method", version="999"), mixed_methods=True) is None


def test_its_date_is_the_end_of_the_later_recording() -> None:
    after = kept_with()
    recording = after.findings.recording
    assert recording.start is not None

    later = replace(recording, start=recording.start + timedelta(days=1))
    report = report_of(replace(after, findings=replace(after.findings, recording=later)))
    assert report.made_of == recording.start + timedelta(days=1, microseconds=recording.duration_us)


def test_a_recording_beside_itself_is_said_to_be_no_change() -> None:
    report = build_comparison(kept_with(7.6), kept_with(20.0), "en")

    told = plain(f"{report.verdict.label} {report.verdict.reason}")
    assert told.startswith("Not two days. Both are the same recording.")
    assert "no conclusion is drawn" in report.sentences[0]


def test_the_left_arm_beside_the_right_is_said_to_be_no_change() -> None:
    report = report_of(kept_with(20.0, side="left"))

    assert report.verdict.label == "Not the same arm."
    assert "no conclusion is drawn" in report.sentences[0]
