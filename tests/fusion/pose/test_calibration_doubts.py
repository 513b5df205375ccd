"""What is said of a calibration, or of a method, that the figures cannot rest on as usual."""

import numpy as np
import pytest

from fusion.conventions import MethodName
from fusion.elevation import estimate_elevation
from fusion.pipeline import Analysis, analyse
from fusion.pose.calibrate import calibrate
from fusion.quality.flags import flag_published, flag_untrusted_pose
from fusion.recording import QualityFlag
from fusion.sensor.model import GyroBias
from fusion.settings import AnalysisSettings
from tests.factories import hold

HELD = hold((0.0, 30.0), (60.0, 30.0), (0.0, 30.0)).recording


def analyse_asked(*windows_s: tuple[float, float], method: MethodName = "smoothed") -> Analysis:
    return analyse(HELD, AnalysisSettings(method, "n-pose", windows_s))


def find(analysis: Analysis, code: str) -> list[QualityFlag]:
    return [flag for flag in analysis.quality.flags if flag.code == code]


@pytest.mark.parametrize(("end_s", "told"), [(6.9, 1), (7.0, 0)])
def test_a_window_asked_for_that_is_shorter_than_5_s_is_told(end_s: float, told: int) -> None:
    flags = find(analyse_asked((2.0, end_s)), "W-POSE-SHORT")

    assert [(flag.first_s, flag.last_s) for flag in flags] == [(2.0, end_s)] * told


def test_a_short_window_widens_the_range_of_the_figures() -> None:
    # 5 deg for 5 s or more, 5 x sqrt(5 / 2) = 7.9 deg for 2 s, 10 deg for 1 s.
    recording = hold(*((0.0, 30.0), (60.0, 30.0)) * 30, rate_hz=25.0).recording
    settings = [AnalysisSettings("smoothed", "n-pose", ((2.0, end_s),)) for end_s in (12.0, 4.0, 3.0)]

    ranges = [analyse(recording, asked).exposure.intervals["elevation_p50_deg"] for asked in settings]

    widths = [interval.high - interval.low for interval in ranges]
    assert widths[0] < widths[1] < widths[2]


@pytest.mark.parametrize(("end_s", "told"), [(6.9, 0), (7.1, 1)])
def test_a_calibration_of_which_half_is_not_trusted_is_in_doubt(end_s: float, told: int) -> None:
    samples = calibrate(HELD, AnalysisSettings(calibration_windows_s=((2.0, 12.0),)))
    elevation = estimate_elevation(samples)
    elevation.segments[0].valid[: round(100.0 * end_s)] = False

    flags = flag_untrusted_pose(samples.calibration, elevation)

    assert [(flag.code, flag.first_s, flag.last_s) for flag in flags] == [("W-POSE-DOUBT", 2.0, 12.0)] * told


def test_published_tells_how_far_the_offset_went_from_the_one_it_takes() -> None:
    bias = GyroBias(np.array([0.0, 60.0]), np.array([[1.0, 0.0, 0.0], [1.0, 0.3, 0.4]]))

    (flag,) = flag_published(bias, np.array([1.0, 0.0, 0.0]))

    assert flag.facts == {"dps": 0.5}


@pytest.mark.parametrize(("method", "told"), [("published", 1), ("smoothed", 0), ("live", 0)])
def test_only_published_warns_of_its_weaknesses(method: MethodName, told: int) -> None:
    assert len(find(analyse_asked((2.0, 12.0), method=method), "W-PUBLISHED")) == told
