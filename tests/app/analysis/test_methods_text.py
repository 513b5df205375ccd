"""The paragraph on methods that a run writes for a manuscript."""

from dataclasses import replace

import pytest

from app.report.export.methods_text import write_methods
from app.report.export.results import build_results
from app.report.findings import CalibrationFacts
from app.report.words.wording import Language
from tests.app.analysis_factory import make_analysis, make_subject


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


def test_a_recording_without_a_pose_is_told_by_the_axis_that_was_given() -> None:
    analysis = make_analysis()
    calibration = CalibrationFacts(None, "axis", 8.0, None, None, None, (0.1, 0.2, 0.3), axis="y")
    strapped = replace(analysis, calibration=calibration)

    text = write_methods([build_results(strapped, make_subject())], 0, "en").decode()

    assert "Where no pose was held (recordings: 1), the sensor's axis" in text.replace("’", "'")
    assert "still periods" not in text
    assert "N-pose" not in text
