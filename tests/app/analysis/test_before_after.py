"""One day beside another: the change, whether days differ as much anyway, and what else is different."""

import json
import re
from dataclasses import replace
from datetime import timedelta

import pytest

from app.errors import CannotCompare
from app.report.findings import Kept
from app.report.model import Report, format_brief
from app.report.pairs import build_comparison, describe_comparison, encode_document, refuse_no_comparison
from app.report.render.html import render_html
from app.report.render.pdf import render_pdf, spell_uncovered
from app.report.words.wording import LANGUAGES, Language
from fusion.conventions import CalibrationState
from fusion.exposure.types import TimeAbove
from tests.app.analysis_factory import ANALYSED_S, make_analysis, make_exposure, make_quality, make_subject


def kept_with(above_60_percent: float = 7.6, side: str = "right", subject: str = "S012") -> Kept:
    exposure = make_exposure()
    above = tuple(
        TimeAbove(60, ANALYSED_S * above_60_percent / 100, above_60_percent) if t.threshold_deg == 60 else t
        for t in exposure.time_above
    )
    findings = make_analysis(exposure=replace(exposure, time_above=above), quality=make_quality("good"))
    return Kept(findings, make_subject(subject, side=side))


def the_day_before(kept: Kept) -> Kept:
    start = kept.findings.recording.start
    assert start is not None
    recording = replace(kept.findings.recording, sha256="0" * 64, start=start - timedelta(days=1))
    return replace(kept, findings=replace(kept.findings, recording=recording))


BEFORE = the_day_before(kept_with())


def report_of(after: Kept, language: Language = "en") -> Report:
    return build_comparison(BEFORE, after, language)


def plain(text: str) -> str:
    return re.sub(r"[\u202f\u00a0]", " ", text).replace("’", "'")


def test_a_change_above_the_least_detectable_one_is_called_larger() -> None:
    sentence = plain(report_of(kept_with(13.2)).sentences[0])

    assert sentence == (
        "Time above 60° went from 7.6 % to 13.2 % of the analysed time (+5.6 points). "
        "The change is larger than the usual day-to-day variation "
        "(minimal detectable change, 95 %: 5.5 points)."
    )


def test_a_change_below_it_is_not() -> None:
    sentence = plain(report_of(kept_with(13.1), "fr").sentences[0])

    assert sentence == (
        "Le temps au-dessus de 60° est passé de 7,6 % à 13,1 % du temps analysé (+5,5 points). "
        "Le changement ne dépasse pas la variation habituelle d'un jour à l'autre "
        "(changement minimal détectable, 95 % : 5,5 points)."
    )


def test_like_is_compared_with_like() -> None:
    assert report_of(kept_with()).verdict.level == "good"


def test_what_differs_besides_the_work_is_named() -> None:
    day = kept_with()
    assert day.findings.method is not None
    method = replace(day.findings.method, name="published")

    verdict = report_of(replace(day, findings=replace(day.findings, method=method))).verdict
    told = "The two differ in more than the work: the method or its version."
    assert (verdict.level, verdict.reason) == ("caution", told)


def test_another_pose_is_named() -> None:
    after = kept_with()
    calibration = replace(after.findings.calibration, pose="side-lean")  # type: ignore[type-var]

    report = report_of(replace(after, findings=replace(after.findings, calibration=calibration)))

    assert "the calibration pose" in report.verdict.reason


def held(kept: Kept, state: CalibrationState) -> Kept:
    assert kept.findings.calibration is not None
    calibration = replace(kept.findings.calibration, state=state)
    return replace(kept, findings=replace(kept.findings, calibration=calibration))


@pytest.mark.parametrize(
    ("language", "first"),
    [
        (
            "en",
            (
                "After: calibration pose assumed, not confirmed. "
                "A change cannot be told from an error of the pose."
            ),
        ),
        (
            "fr",
            (
                "Après : pose d'étalonnage supposée, non confirmée. "
                "Un changement ne peut pas être distingué d'une erreur de la pose."
            ),
        ),
    ],
)
def test_a_pose_that_nobody_confirmed_comes_first_and_no_change_is_judged(
    language: Language, first: str
) -> None:
    after = held(kept_with(13.2), "assumed")
    report = report_of(after, language)
    answer, page = plain(format_brief(report).decode()), plain(render_html(report).decode())

    assert answer.splitlines()[0] == first
    assert first in page.replace("&#39;", "'")
    for told in ("larger than the usual day-to-day", "Like with like", "dépasse la", "conditions égales"):
        assert told not in answer
    document = describe_comparison(BEFORE, after)
    assert document["differences"] == ["unconfirmed pose"]
    assert {(f["detectable"], f["verdict"]) for f in document["figures"]} == {(None, "unconfirmed pose")}


def test_a_strapped_axis_needs_no_confirmed_pose_and_a_day_without_a_pose_does() -> None:
    told = [report_of(held(kept_with(), state)).needs_pose for state in ("axis", "none")]

    assert told[0] == ""
    assert told[1].startswith("After: no calibration pose found, none confirmed.")


def test_a_figure_without_published_variation_has_no_verdict() -> None:
    rows = {row[0]: row for row in report_of(kept_with()).sections[0].tables[0].rows}

    assert rows["P90 of elevation"][4:] == ("–", "not known")


def test_the_known_error_of_the_pose_stands_beside_the_change_once() -> None:
    assert report_of(kept_with()).pose_caution.count("15° low") == 1


def test_the_document_holds_the_same_change_as_the_page() -> None:
    document = describe_comparison(BEFORE, kept_with(13.2))

    figure = next(f for f in document["figures"] if f["name"] == "time_above_60_percent")
    assert (figure["before"], figure["after"], figure["change"]) == (7.6, 13.2, 5.6)
    assert (figure["detectable"], figure["verdict"]) == (5.543717, "larger")


@pytest.mark.parametrize(
    ("subject", "stated", "one_person"),
    [("S012", False, "codes"), ("", True, "person"), ("S013", True, "no")],
)
def test_the_document_says_whether_both_days_are_of_one_person(
    subject: str, stated: bool, one_person: str
) -> None:
    document = describe_comparison(BEFORE, kept_with(subject=subject), same_subject=stated)

    assert document["one_person"] == one_person


def test_a_missing_code_is_said_beside_the_change() -> None:
    report = build_comparison(BEFORE, kept_with(subject=""), "en", same_subject=True)

    assert plain(report.pose_caution).startswith("A subject code is missing; the person who asked")


@pytest.mark.parametrize("subject", ["", "NA", "?"])
def test_a_day_without_a_code_is_not_taken_for_one_of_the_same_person(subject: str) -> None:
    with pytest.raises(CannotCompare) as refused:
        refuse_no_comparison(BEFORE, kept_with(subject=subject))

    assert refused.value.facts == {"why": "person"}


def test_the_document_names_both_analyses_and_what_differs() -> None:
    document = json.loads(encode_document(describe_comparison(BEFORE, kept_with(side="left"))))

    assert (document["before"]["side"], document["after"]["side"]) == ("right", "left")
    assert document["differences"] == ["side"]


@pytest.mark.parametrize("language", LANGUAGES)
def test_it_is_one_page_and_one_pdf_in_words_that_can_be_drawn(language: Language) -> None:
    report = report_of(kept_with(13.2), language)

    assert f'<html lang="{language}">' in render_html(report).decode()
    assert render_pdf(report, {"comparison.json": b"{}\n"}).startswith(b"%PDF-")
    assert "[U+" not in spell_uncovered(str(report))


def why_refused(after: Kept, *, before: Kept = BEFORE, mixed_methods: bool = False) -> object:
    try:
        refuse_no_comparison(before, after, mixed_methods=mixed_methods)
    except CannotCompare as refusal:
        return refusal.facts["why"]
    return None


def analysed_by(kept: Kept, version: str) -> Kept:
    assert kept.findings.method is not None
    method = replace(kept.findings.method, version=version)
    return replace(kept, findings=replace(kept.findings, method=method))


def test_two_days_of_one_arm_are_compared() -> None:
    assert why_refused(kept_with(30.0)) is None


def test_two_people_are_refused() -> None:
    assert why_refused(kept_with(30.0, subject="S999")) == "subjects"


def test_the_same_hours_of_one_arm_are_refused() -> None:
    at_once = replace(BEFORE.findings.recording, start=kept_with().findings.recording.start)
    before = replace(BEFORE, findings=replace(BEFORE.findings, recording=at_once))

    assert why_refused(kept_with(), before=before) == "same hours"
    assert why_refused(kept_with(side="left"), before=before) is None


def test_one_analysis_beside_itself_is_refused_and_another_of_the_recording_is_not() -> None:
    other = replace(kept_with(13.0).findings, recording=BEFORE.findings.recording)

    assert why_refused(BEFORE) == "same"
    assert why_refused(replace(BEFORE, findings=other)) is None


def test_two_methods_are_refused_unless_asked_for() -> None:
    after = analysed_by(kept_with(), "999")

    assert [why_refused(after, mixed_methods=asked) for asked in (False, True)] == ["methods", None]


def test_the_french_plural_begins_at_two() -> None:
    told = [plain(report_of(kept_with(above), "fr").sentences[0]) for above in (9.5, 9.6)]

    assert "(+1,9 point)" in told[0]
    assert "(+2,0 points)" in told[1]


def test_its_date_is_the_end_of_the_later_recording() -> None:
    after = kept_with()
    recording = after.findings.recording
    assert recording.start is not None

    later = replace(recording, start=recording.start + timedelta(days=1))
    report = report_of(replace(after, findings=replace(after.findings, recording=later)))
    assert report.made_of == recording.start + timedelta(days=1, microseconds=recording.duration_us)


def test_a_hostile_subject_code_stays_text() -> None:
    after = kept_with(subject="<script>alert(1)</script>")
    page = render_html(build_comparison(the_day_before(after), after, "en")).decode()

    assert "<script" not in page


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_recording_beside_itself_is_said_to_be_no_change(language: Language) -> None:
    report = build_comparison(kept_with(7.6), kept_with(20.0), language)

    told = plain(f"{report.verdict.label} {report.verdict.reason} {report.sentences[0]}")
    plainly = {
        "en": "Not two days. Both are the same recording.",
        "fr": "Les deux sont le même enregistrement.",
    }
    assert plainly[language] in told
    assert {"en": "no judgement is made", "fr": "aucune conclusion n'est tirée"}[language] in told


def test_the_left_arm_beside_the_right_is_said_to_be_no_change() -> None:
    report = report_of(kept_with(20.0, side="left"))

    assert report.verdict.label == "Not the same arm."
    assert "no judgement is made" in report.sentences[0]
