"""The paragraph on methods that a run writes for a manuscript."""

from dataclasses import replace

import pytest

from app.report.export.methods_text import write_methods
from app.report.export.results import build_results
from app.report.words.wording import Language
from tests.app.analysis_factory import make_analysis, make_subject


@pytest.mark.parametrize(("language", "named"), [("en", "inertial sensors"), ("fr", "capteurs inertiels")])
def test_a_device_that_the_words_do_not_know_is_an_inertial_sensor(language: Language, named: str) -> None:
    analysis = make_analysis()
    unknown = replace(analysis, recording=replace(analysis.recording, device="tiny"))

    text = write_methods([build_results(unknown, make_subject())], 0, language).decode()

    assert named in text
