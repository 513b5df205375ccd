"""One analysed shift, which the tests of every range and of the stored findings read."""

import pytest

from acromion.app.report.findings import Findings, build_findings
from acromion.fusion.diary import DiaryEntry
from acromion.fusion.pipeline import analyse
from acromion.fusion.recording import Recording, Segment
from acromion.fusion.settings import AnalysisSettings
from acromion.fusion.simulation.shift import simulate_shift
from tests.simulated_shifts import play_shift


@pytest.fixture(scope="session")
def analysed() -> Findings:
    """Two and a quarter simulated hours (three clock hours are compared or left out) with a diary."""
    day = play_shift(simulate_shift("gt9x", 2.25, seed=3))
    segment = Segment(0, day.rate_hz, day.acc_g, day.gyr_dps)
    recording = Recording("gt9x", "0" * 64, day.start, None, segment.duration_us, (segment,))
    rows = ((600.0, "task", "a"), (2400.0, "break", ""), (4200.0, "task", "a"), (6000.0, "task", "b"))
    diary = tuple(DiaryEntry(start, start + 1500.0, kind, label) for start, kind, label in rows)  # type: ignore[arg-type]
    return build_findings(analyse(recording, AnalysisSettings(diary=diary)))
