"""A recording of the trunk: a report and tables without any figure of an arm."""

import io
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from pypdf import PdfReader

from acromion.app.errors import CannotCompare
from acromion.app.library.listing import read_headline
from acromion.app.report.export.fhir import encode_fhir
from acromion.app.report.export.results import encode_results
from acromion.app.report.export.tables import describe_tables, summarise_results
from acromion.app.report.findings import FinishedAnalysis, ReleaseStamp
from acromion.app.report.model import format_brief
from acromion.app.report.pairs import check_comparable
from acromion.app.report.render.html import render_html
from acromion.app.report.render.pdf import render_pdf
from acromion.app.report.single.report import Report, build_report
from acromion.app.report.words.wording import LANGUAGES, Language
from acromion.app.request import Conclusion
from tests.app.analysis_factory import make_analysis, make_subject
from tests.app.report.report_reading import plain


def report_of_trunk(language: Language = "en") -> Report:
    return build_report(make_analysis(), make_subject(side="trunk"), language)


@pytest.fixture(scope="module")
def results() -> dict[str, Any]:
    found: dict[str, Any] = json.loads(encode_results(make_analysis(), make_subject(side="trunk")))
    return found


def test_the_answer_states_the_inclination_and_no_arm_above_an_angle() -> None:
    percentiles = make_analysis().exposure.percentiles_deg

    use, inclination, _ = map(plain, report_of_trunk().sentences)

    assert use.startswith("This sensor was worn on the trunk: this report has no figures of an arm.")
    assert f"median {percentiles[50]:.0f}°" in inclination
    assert "60°" not in inclination


@pytest.mark.parametrize(("language", "arm"), [("en", "The arm was above"), ("fr", "Le bras était")])
def test_the_page_and_the_pasted_lines_compare_no_arm_with_a_proposal(language: Language, arm: str) -> None:
    report = report_of_trunk(language)

    shown = plain(render_html(report).decode() + format_brief(report).decode())

    assert arm not in shown
    assert "10 %" not in shown


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_report_of_the_trunk_is_printed_on_one_page(language: Language) -> None:
    document = render_pdf(report_of_trunk(language), {}, "letter")

    assert len(PdfReader(io.BytesIO(document)).pages) == 1


def test_the_pose_has_no_error_of_an_arm_along_the_body() -> None:
    assert "low" not in report_of_trunk().pose_state
    assert not report_of_trunk().pose_caution


def test_a_conclusion_and_a_release_are_in_the_report_of_the_trunk() -> None:
    said = Conclusion("The trunk is often bent.", "M. Tremblay", "2026-11-23")
    subject = replace(make_subject(side="trunk"), conclusion=said)
    report = build_report(make_analysis(), subject, "en", ReleaseStamp("A. Roy", "2026-11-24"))

    text = plain(render_html(report).decode())

    assert "The trunk is often bent." in text
    assert "Released by A. Roy, 24 November 2026" in text


def test_the_summary_has_its_times_and_no_figure_of_an_arm(results: dict[str, Any]) -> None:
    row = summarise_results(results)

    assert (row["side"], row["recorded_s"]) == ("trunk", 28740.0)
    assert (row["time_above_60_percent"], row["elevation_p50_deg"]) == (None, None)


def test_no_table_of_days_or_parts_has_a_row_of_the_trunk(results: dict[str, Any]) -> None:
    filled = {name for name, rows in describe_tables([results]).items() if rows}

    assert filled == {"summary", "warnings"}


def test_a_list_of_recordings_ranks_no_trunk(results: dict[str, Any], tmp_path: Path) -> None:
    (tmp_path / "results.json").write_bytes(encode_results(make_analysis(), make_subject(side="trunk")))

    headline = read_headline(tmp_path / "results.json")

    assert headline is not None
    assert headline.above_60_percent is None


def test_health_records_place_the_sensor_on_the_trunk(results: dict[str, Any]) -> None:
    bundle = json.loads(encode_fhir(results, {}, ""))

    kept = [entry["resource"] for entry in bundle["entry"]]
    observed = [one for one in kept if one["resourceType"] == "Observation"]
    assert {one["bodySite"]["text"] for one in observed} == {"trunk"}
    assert {one["code"]["coding"][0]["code"] for one in observed} == {
        *("rate_hz", "recorded_s", "analysed_s", "missing_s", "excluded_s", "pose_sigma_deg")
    }


def test_a_trunk_is_not_compared_with_an_arm() -> None:
    trunk, arm = (FinishedAnalysis(make_analysis(), make_subject(side=side)) for side in ("trunk", "right"))

    with pytest.raises(CannotCompare) as refused:
        check_comparable(trunk, arm)

    assert refused.value.facts["why"] == "trunk"


def test_the_results_compare_no_trunk_with_the_levels_of_an_arm(results: dict[str, Any]) -> None:
    assert results["comparison"]["levels"] == []
    assert results["comparison"]["other_days"] == {"between": None, "combined": None}


def test_a_health_record_names_the_report_of_the_trunk(results: dict[str, Any]) -> None:
    bundle = json.loads(encode_fhir(results, {}, ""))

    (report,) = (
        entry["resource"]
        for entry in bundle["entry"]
        if entry["resource"]["resourceType"] == "DiagnosticReport"
    )
    assert report["code"]["text"] == "Report on a sensor on the trunk"
