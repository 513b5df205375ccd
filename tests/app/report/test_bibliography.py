"""Whatever the report cites stands in its bibliography, with an identifier that leads there."""

import re
from dataclasses import replace
from typing import Any, get_args

import pytest

from acromion.app.report.bibliography import BIBLIOGRAPHY, format_bibliography, write_methods
from acromion.app.report.export.results import build_results
from acromion.app.report.findings import CalibrationFacts
from acromion.app.report.render.html import render_html
from acromion.app.report.words.wording import LANGUAGES, Language, Part, load_wording
from acromion.fusion.comparison.change import REFERENCES, SOURCE, STATEMENTS
from acromion.fusion.conventions import CalibrationState
from tests import ROOT
from tests.app.analysis_factory import make_analysis, make_subject
from tests.app.report.report_reading import report_of, section_of
from tests.app.report.test_wording import walk_texts

CITED = {publication.cited for publication in BIBLIOGRAPHY}
AUTHORS = r"[A-ZÆØÅ]\w+ et al\. \d{4}|Bioengineering \d{4};\d+:\d+"


def find_citations(text: str) -> set[str]:
    return {
        found.replace("Dalboge", "Dalbøge").replace("Waersted", "Wærsted")
        for found in re.findall(AUTHORS, text)
    }


@pytest.mark.parametrize("language", LANGUAGES)
def test_every_work_cited_in_the_words_is_in_the_bibliography(language: Language) -> None:
    texts = " ".join(text for part in get_args(Part) for _, text in walk_texts(load_wording(language, part)))

    assert find_citations(texts.replace("\u00a0", " ")) - CITED == set()


def test_every_published_value_finding_and_definition_is_in_the_bibliography() -> None:
    sources = [*(reference.source for reference in REFERENCES), *STATEMENTS.values(), SOURCE]

    assert [s for s in sources if not find_citations(s) & CITED] == ["WISHA, Washington State, repealed 2003"]
    assert find_citations((ROOT / "docs" / "profile.md").read_text()) - CITED == set()


def test_an_identifier_is_a_doi_and_stands_once_in_the_order_of_first_authors() -> None:
    given = [publication.doi for publication in BIBLIOGRAPHY if publication.doi]
    order = [publication.cited.replace("Wæ", "Wz").lower() for publication in BIBLIOGRAPHY]

    assert [doi for doi in given if not re.fullmatch(r"10\.\d{4,5}/[\w.;()/-]+", doi)] == []
    assert len(given) == len(set(given))
    assert order == sorted(order)


@pytest.mark.parametrize(("language", "title"), [("en", "## Bibliography"), ("fr", "## Bibliographie")])
def test_the_bibliography_ends_the_report_and_the_methods_text(language: Language, title: str) -> None:
    report = report_of(language=language)
    methods = write_methods([build_results(make_analysis(), make_subject())], 0, language).decode()

    assert report.sections[-1].key == "bibliography"
    assert section_of(report, "bibliography").sources == format_bibliography()
    assert "doi:10.1136/oem.2003.010637" in render_html(report).decode()
    assert [line for line in format_bibliography() if f"- {line}" not in methods.split(title)[1]] == []


# The paragraph on methods that a run writes for a manuscript.


def name_device(device: str, language: Language) -> str:
    analysis = make_analysis()
    told = replace(analysis, recording=replace(analysis.recording, device=device))
    return write_methods([build_results(told, make_subject())], 0, language).decode()


@pytest.mark.parametrize(
    ("device", "language", "named"),
    [
        ("other", "en", "inertial sensors"),
        ("other", "fr", "des capteurs inertiels"),
        ("Acme armband", "en", "Acme armband sensors"),  # as its plug-in calls it
        ("Acme armband", "fr", "des capteurs Acme armband"),
    ],
)
def test_a_device_is_called_by_its_name_or_as_inertial_sensors(
    device: str, language: Language, named: str
) -> None:
    assert named in name_device(device, language)


def write_calibrated(state: CalibrationState) -> str:
    analysis = make_analysis()
    assert analysis.calibration is not None
    stated = replace(analysis, calibration=replace(analysis.calibration, pose="n-pose", state=state))
    return write_methods([build_results(stated, make_subject())], 0, "en").decode()


@pytest.mark.parametrize("state", ["given", "held_at_start", "repeated", "carried"])
def test_a_confirmed_pose_is_named_as_found(state: CalibrationState) -> None:
    text = write_calibrated(state)

    assert "found from still periods in the N-pose (arm hanging along the body; recordings: 1)" in text
    assert "confirmed" not in text


def test_a_pose_that_was_only_assumed_is_not_named_as_found() -> None:
    text = write_calibrated("assumed")

    assert "was found from still periods" not in text
    assert "No person confirmed the pose" in text
    assert "was assumed to be the N-pose (arm hanging along the body; recordings: 1)" in text
    assert "The N-pose reads up to" in text  # its error applies all the same


def test_an_axis_without_a_still_period_is_not_of_a_pose() -> None:
    text = write_calibrated("none")

    assert "N-pose" not in text
    assert "estimated from walking or the stillest moment: 1." in text


def test_the_methods_name_the_version_and_revision_of_the_results() -> None:
    results: dict[str, Any] = build_results(make_analysis(), make_subject())
    software = {**results["software"], "version": "0.1.0"}
    every = [
        {**results, "software": {**software, "revision": revision}}
        for revision in ("git 1a2b3c4d5e6f", "release 0.1.0", "git 1a2b3c4d5e6f")
    ]

    text = write_methods(every, 0, "en").decode()

    named = "Acromion 0.1.0 (revision: git 1a2b3c4d5e6f); Acromion 0.1.0 (revision: release 0.1.0)"
    assert f"analysed with {named}." in text


def test_a_recording_without_a_pose_is_told_by_the_axis_that_was_given() -> None:
    analysis = make_analysis()
    calibration = CalibrationFacts(None, "axis", 8.0, None, None, None, (0.1, 0.2, 0.3), axis="y")
    strapped = replace(analysis, calibration=calibration)

    text = write_methods([build_results(strapped, make_subject())], 0, "en").decode()

    assert "If no pose was held (recordings: 1), the sensor axis" in text.replace("’", "'")
    assert "still periods" not in text
    assert "N-pose" not in text


def test_the_methods_state_which_days_count() -> None:
    text = write_methods([build_results(make_analysis(), make_subject())], 0, "fr", 2.5).decode()

    assert "si au moins 2,5\u202fh en ont été analysées" in text.replace("\u00a0", "\u202f")


def test_a_trunk_is_no_arm_in_the_methods_and_is_named_as_measured() -> None:
    every = [build_results(make_analysis(), make_subject(side=side)) for side in ("left", "trunk")]

    text = write_methods(every, 0, "en").decode()

    assert "Recordings analysed: 1 " in text
    assert "In further recordings (1) the sensor was on the trunk" in text
    assert "The trunk was not measured" not in text
