"""A clinician's conclusion: in the report as it was typed, with name and date; never in the figures."""

import io
import json
from dataclasses import replace

import pypdf
import pytest

from app.errors import BadParameter
from app.report.analysis.report import build_report
from app.report.export.results import build_results, decode_results, encode_results, identify_report
from app.report.render.html import render_html
from app.report.render.pdf import render_pdf
from app.report.words.subject import ReportSubject
from app.request import Conclusion, ReportRequest
from app.web.recording.analysis import read_conclusion
from fusion.settings import DEFAULT_SETTINGS
from tests.app.analysis_factory import make_analysis, make_subject

SAID = Conclusion("Overhead work is the load.\nMeasure again in May.", "M. Tremblay", "2026-11-23")


def concluded() -> ReportSubject:
    return replace(make_subject(), conclusion=SAID)


def test_the_report_shows_each_paragraph_with_name_and_date() -> None:
    note = build_report(make_analysis(), concluded(), "en").conclusion

    assert note is not None
    assert note.title == "Conclusion: M. Tremblay, 23\u00a0November\u00a02026"
    typed = "Typed by the person named; not computed."
    assert note.paragraphs == ("Overhead work is the load.", "Measure again in May.", typed)
    assert build_report(make_analysis(), make_subject(), "en").conclusion is None


def test_the_conclusion_stands_on_page_2_of_the_pdf() -> None:
    pdf = render_pdf(build_report(make_analysis(), concluded(), "en"), {})

    pages = [page.extract_text() for page in pypdf.PdfReader(io.BytesIO(pdf)).pages]

    assert "Overhead work is the load." in pages[1]
    assert "M. Tremblay" in pages[1]


def test_markup_in_a_conclusion_is_only_text() -> None:
    subject = replace(make_subject(), conclusion=replace(SAID, text="<b>raised</b>"))

    assert b"&lt;b&gt;raised&lt;/b&gt;" in render_html(build_report(make_analysis(), subject, "en"))


def test_a_report_with_a_conclusion_has_an_id_of_its_own() -> None:
    findings = make_analysis()

    assert identify_report(DEFAULT_SETTINGS, findings, concluded()) != identify_report(
        DEFAULT_SETTINGS, findings, make_subject()
    )


def test_the_conclusion_moves_no_figure() -> None:
    findings = make_analysis()
    with_it, without = (build_results(findings, subject) for subject in (concluded(), make_subject()))

    assert with_it.pop("conclusion") == {
        "text": "Overhead work is the load.\nMeasure again in May.",
        "name": "M. Tremblay",
        "date": "2026-11-23",
    }
    assert without.pop("conclusion") is None
    assert json.dumps(with_it) == json.dumps(without)


def test_results_json_and_a_stored_request_hold_the_conclusion() -> None:
    request = ReportRequest("shift.gt3x", conclusion=SAID)

    assert decode_results(encode_results(make_analysis(), concluded())).subject.conclusion == SAID
    assert ReportRequest.from_json(request.to_json()) == request


@pytest.mark.parametrize(
    ("field", "typed"), [("text", " \u200b "), ("text", "x" * 1001), ("name", ""), ("date", "23/11/2026")]
)
def test_a_conclusion_lacks_nothing(field: str, typed: str) -> None:
    form = {"text": ["Raised."], "name": ["M. Tremblay"], "date": ["2026-11-23"]} | {field: [typed]}

    with pytest.raises(BadParameter) as refused:
        read_conclusion(form)

    assert refused.value.facts["name"] == field
