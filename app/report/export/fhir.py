"""One analysis as a FHIR R4 bundle: a DiagnosticReport with the PDF, and its figures as Observations.

There are no standard codes for arm elevation, so the codes are ours: the names of ``summary.csv`` in the
system ``urn:acromion:dictionary``. Each resource names the base profile of R4 that it follows: the profiles
for vital signs or devices require codes that do not exist for these figures. The subject is an identifier,
never a name. The bundle has no creation time, so that the same analysis gives the same bytes. Format: HL7
FHIR R4 (4.0.1), Bundle, DiagnosticReport, Observation; units: UCUM.
"""

import base64
import hashlib
import json
import uuid
from collections.abc import Iterable, Mapping
from datetime import datetime, timedelta
from typing import Any

from acromion.app.report.export.naming import format_report_name
from acromion.app.report.export.tables import summarise_results
from acromion.app.report.figures import RANGE_ENDS, SUMMARY, Results, find_unit, read_ranges
from acromion.app.report.words.wording import Language

CODES = "urn:acromion:dictionary"
SUBJECTS = "urn:acromion:subject"
_PROFILES = "http://hl7.org/fhir/StructureDefinition"
_UCUM = {"%": "%", "1/h": "/h", "deg/s": "deg/s", "deg": "deg", "Hz": "Hz", "s": "s"}


_ARM_REPORT = ("upper_arm_elevation", "Upper-arm elevation report")
_REPORTS = {"trunk": ("trunk_inclination", "Report on a sensor on the trunk")}


def encode_fhir(results: Results, pdfs: Mapping[Language, bytes], conclusion: str, version: int = 1) -> bytes:
    """Encode the bundle; ``pdfs`` by language, ``conclusion`` is the answer in a few lines."""
    text = json.dumps(build_fhir(results, pdfs, conclusion, version), ensure_ascii=False, indent=1)
    return text.encode("utf-8") + b"\n"


def build_fhir(
    results: Results, pdfs: Mapping[Language, bytes], conclusion: str, version: int = 1
) -> dict[str, Any]:
    """Build the bundle."""
    digest = hashlib.sha256(json.dumps(results, sort_keys=True).encode()).hexdigest()
    common, name = _describe_common(results), format_report_name(results, version, "pdf")
    observations = [
        (_address(digest, name), observation) for name, observation in _list_observations(results, common)
    ]
    report = {
        **_head("DiagnosticReport"),
        **common,
        "code": _build_code(*_REPORTS.get(results["recording"]["side"], _ARM_REPORT)),
        "result": [{"reference": address} for address, _ in observations],
        "conclusion": conclusion,
        "presentedForm": [
            {
                "contentType": "application/pdf",
                "language": language,
                "data": base64.b64encode(pdf).decode("ascii"),
                "title": name,
            }
            for language, pdf in pdfs.items()
        ],
    }
    entries = [(_address(digest, "report"), report), *observations]
    return {
        **_head("Bundle"),
        "type": "collection",
        "identifier": {"system": "urn:ietf:rfc:3986", "value": _address(digest, "bundle")},
        "entry": [{"fullUrl": address, "resource": resource} for address, resource in entries],
    }


def _head(resource: str) -> dict[str, Any]:
    return {"resourceType": resource, "meta": {"profile": [f"{_PROFILES}/{resource}"]}}


def _describe_common(results: Results) -> dict[str, Any]:
    """Return the fields that the report and all observations share: status, subject, period.

    FHIR requires a time zone for times, so that a clock without one gives only the date.
    """
    recording = results["recording"]
    common: dict[str, Any] = {"status": "final"}
    if recording["subject"]:
        common["subject"] = {"identifier": {"system": SUBJECTS, "value": recording["subject"]}}
    if recording["start"]:
        first = datetime.fromisoformat(recording["start"])
        ends = (first, first + timedelta(seconds=results["time"]["recorded_s"]))
        shown = (end.isoformat(timespec="seconds") if end.tzinfo else end.date().isoformat() for end in ends)
        common["effectivePeriod"] = dict(zip(("start", "end"), shown, strict=True))
    return common


def _list_observations(results: Results, common: Mapping[str, Any]) -> Iterable[tuple[str, dict[str, Any]]]:
    """Return one observation per known figure, with the ends of its range if they are known."""
    row, ranges, posed = summarise_results(results), read_ranges(results), read_ranges(results, "_pose")
    side = row["side"]
    site = f"{side} upper arm" if side in {"left", "right"} else side
    for column in SUMMARY:
        name = column.name
        if column.kind != "number" or row[name] is None or name.endswith(RANGE_ENDS):
            continue
        # ranges with the pose exist only beside the others
        every = (*ranges.get(name, ()), *posed.get(name, ()))
        ranged = [
            {"code": _build_code(code, code), "valueQuantity": _measure(code, value)}
            for code, value in zip((f"{name}{end}" for end in RANGE_ENDS), every, strict=False)
        ]
        yield (
            name,
            {
                **_head("Observation"),
                **common,
                "code": _build_code(name, column.explain("en")),
                "valueQuantity": _measure(name, row[name]),
                **({"bodySite": {"text": site}} if site else {}),
                **({"component": ranged} if ranged else {}),
            },
        )


def _build_code(code: str, display: str) -> dict[str, Any]:
    return {"coding": [{"system": CODES, "code": code, "display": display}], "text": display}


def _measure(name: str, value: object) -> dict[str, Any]:
    unit = _UCUM.get(find_unit(name), "1")
    return {"value": value, "unit": unit, "system": "http://unitsofmeasure.org", "code": unit}


def _address(digest: str, name: str) -> str:
    return f"urn:uuid:{uuid.uuid5(uuid.NAMESPACE_URL, f'{CODES}:{digest}:{name}')}"
