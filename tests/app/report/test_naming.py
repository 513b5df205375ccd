"""The name a report is taken away under."""

from typing import Any

import pytest

from app.report.export.naming import Origin, format_file_name, format_report_name


def results_of(subject: str = "S012", start: str | None = "2026-03-03T07:58:12-05:00") -> dict[str, Any]:
    side = "right" if start else None
    return {"recording": {"subject": subject, "start": start, "side": side, "file_name": "shift 3.gt3x"}}


def test_it_tells_whose_when_which_arm_and_which_version() -> None:
    assert format_report_name(results_of(), 2, "pdf") == "S012_2026-03-03_right_report_v2.pdf"


def test_what_is_not_known_is_left_out() -> None:
    assert format_report_name(results_of("", None), 1, "html") == "shift 3_report_v1.html"


@pytest.mark.parametrize(
    ("subject", "stem"),
    [("../../etc/passwd", "etc-passwd"), ("É-012", "É-012"), ('a"b;c', "a-b-c"), ("...", "recording")],
)
def test_only_signs_that_every_file_system_takes_are_kept(subject: str, stem: str) -> None:
    assert format_report_name(results_of(subject, None), 1, "pdf") == f"{stem}_report_v1.pdf"


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        ("report.fr.pdf", "S012_2026-03-03_left_report_v3.fr.pdf"),
        ("elevation.csv.gz", "S012_2026-03-03_left_elevation_v3.csv.gz"),
        ("bundle.zip", "S012_2026-03-03_left_bundle_v3.zip"),
    ],
)
def test_every_file_is_named_by_the_same_rule(kind: str, name: str) -> None:
    origin = Origin("S012", "shift 3.gt3x", "2026-03-03T07:58:12-05:00", "left", 3)

    assert format_file_name(origin, kind) == name
