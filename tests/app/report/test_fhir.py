"""The FHIR R4 bundle: valid, with the PDF inside, with the same figures, and without a name."""

import base64
import json
import re
from dataclasses import replace
from datetime import datetime
from typing import Any

import pytest
from fhir.resources.R4B.bundle import Bundle

from app.report.export.fhir import encode_fhir
from app.report.export.results import encode_results
from fusion.exposure import Interval
from tests.app.analysis_factory import START, make_analysis, make_exposure, make_subject

PDF = b"%PDF-1.7 a report"
ANSWER = "The right arm was raised.\n"


def bundle_of(start: datetime | None = START, subject: str = "S012") -> dict[str, Any]:
    results = json.loads(encode_results(make_analysis(start=start), make_subject(subject)))
    bundle: dict[str, Any] = json.loads(encode_fhir(results, {"en": PDF}, ANSWER))
    return bundle


def report_of(bundle: dict[str, Any]) -> dict[str, Any]:
    report: dict[str, Any] = bundle["entry"][0]["resource"]
    return report


def figure_of(bundle: dict[str, Any], name: str) -> dict[str, Any]:
    resources = (entry["resource"] for entry in bundle["entry"][1:])
    return next(r for r in resources if r["code"]["coding"][0]["code"] == name)


@pytest.mark.parametrize("start", [START, START.replace(tzinfo=None), None])
def test_the_bundle_is_valid_with_any_clock(start: datetime | None) -> None:
    bundle = Bundle.model_validate(bundle_of(start))

    assert bundle.type == "collection"


def test_the_report_holds_the_pdf_and_the_answer() -> None:
    report = report_of(bundle_of())

    assert base64.b64decode(report["presentedForm"][0]["data"]) == PDF
    assert report["presentedForm"][0]["title"] == "S012_2026-03-03_right_report_v1.pdf"
    assert report["conclusion"] == ANSWER


def test_the_report_refers_to_every_figure_which_has_its_value_and_unit() -> None:
    bundle = bundle_of()
    referred = [item["reference"] for item in report_of(bundle)["result"]]
    value = figure_of(bundle, "time_above_60_percent")["valueQuantity"]

    assert referred == [entry["fullUrl"] for entry in bundle["entry"][1:]]
    assert (value["value"], value["code"]) == (7.6, "%")
    assert bundle == bundle_of()  # nothing in it is random or of this moment


def test_every_figure_whose_range_is_known_has_it() -> None:
    exposure = make_exposure(above_60_interval=Interval(6.0, 9.5))
    first, *others = exposure.bins
    bins = (replace(first, interval=Interval(40.0, 50.0)), *others)
    known = {"entries_above_60_per_h": Interval(21.0, 44.0), "elevation_p50_deg": Interval(20.0, 24.0)}
    analysis = make_analysis(exposure=replace(exposure, bins=bins, intervals=known))

    bundle = json.loads(encode_fhir(json.loads(encode_results(analysis, make_subject())), {}, ""))

    ranged = {
        entry["resource"]["code"]["text"]: [
            p["valueQuantity"]["value"] for p in entry["resource"]["component"]
        ]
        for entry in bundle["entry"][1:]
        if "component" in entry["resource"]
    }
    assert sorted(ranged.values()) == [[6.0, 9.5], [20.0, 24.0], [21.0, 44.0], [40.0, 50.0]]


def test_the_subject_is_a_code_and_never_a_name() -> None:
    text = json.dumps(bundle_of())

    assert report_of(bundle_of())["subject"] == {
        "identifier": {"system": "urn:acromion:subject", "value": "S012"}
    }
    assert "subject" not in report_of(bundle_of(subject=""))
    assert re.search(r'"(name|family|given|birthDate)"', text) is None


def test_a_clock_without_a_zone_gives_the_date_only() -> None:
    period = report_of(bundle_of(START.replace(tzinfo=None)))["effectivePeriod"]

    assert period == {"start": "2026-03-03", "end": "2026-03-03"}


def test_every_resource_names_its_profile() -> None:
    bundle = bundle_of()
    resources = [bundle, *(entry["resource"] for entry in bundle["entry"])]

    assert {resource["resourceType"]: resource["meta"]["profile"] for resource in resources} == {
        "Bundle": ["http://hl7.org/fhir/StructureDefinition/Bundle"],
        "DiagnosticReport": ["http://hl7.org/fhir/StructureDefinition/DiagnosticReport"],
        "Observation": ["http://hl7.org/fhir/StructureDefinition/Observation"],
    }
