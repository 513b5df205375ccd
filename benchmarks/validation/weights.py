"""The slerp weight that the paper leaves open, and its high-pass, on the simulated sessions."""

from collections.abc import Mapping, Sequence

import numpy as np

from acromion.fusion.comparison.change import QUASI_STATIC, TABLE_1, TaskFigures
from acromion.fusion.elevation import measure_elevation
from acromion.fusion.orientation.published import PublishedParameters, estimate_published
from acromion.fusion.pose.calibrate import calibrate
from acromion.fusion.sensor.model import view_segment
from acromion.fusion.settings import AnalysisSettings
from acromion.fusion.simulation.sensor import Device
from benchmarks.validation.document import draw_table
from benchmarks.validation.worn import Worn, compare, find_rows
from tests.simulated_tasks import TITLES

TIME_CONSTANTS_S = (0.5, 1.0, 2.0, 5.0, 10.0)
VARIANTS: Mapping[str, PublishedParameters] = {
    **{
        f"{constant_s:g} s": PublishedParameters(time_constant_s=constant_s)
        for constant_s in TIME_CONSTANTS_S
    },
    "5 s, no high-pass": PublishedParameters(time_constant_s=5.0, highpass_gyr_hz=0.0),
}

PROSE = f"""\
The paper does not state the weight of its slerp. This table shows `published` on the GT9X sessions with other
time constants (a share of 1 - exp(-period / time constant) in each step; the default of the software is
{PublishedParameters().time_constant_s:g} s), and once without the 0.002 Hz high-pass: RMSE in degrees, r in
brackets. The last line is the root mean square, over the ten tasks, of the difference between this RMSE and
the paper's."""


def draw_sweep(sessions: Sequence[Worn], device: Device) -> str:
    """Return every variant on every task, mean over people, with the paper's figures."""
    found = {name: _average(sessions, how) for name, how in VARIANTS.items()}
    paper = TABLE_1[device]
    rows = [
        [f"{number} {TITLES[number]}", *(_draw(number, of[number]) for of in (*found.values(), paper))]
        for number in paper
    ]
    misses = [f"{_find_mismatch_deg(of, paper):.2f}" for of in found.values()]
    return draw_table(("task", *found, "Table 1"), [*rows, ["difference from Table 1", *misses, ""]])


def _average(sessions: Sequence[Worn], how: PublishedParameters) -> dict[int, TaskFigures]:
    people = [_measure(worn, how) for worn in sessions]
    return {number: TaskFigures.mean([person[number] for person in people]) for number in TITLES}


def _measure(worn: Worn, how: PublishedParameters) -> dict[int, TaskFigures]:
    samples = calibrate(worn.recording, AnalysisSettings(calibration_windows_s=(worn.shift.calibration_s,)))
    run, bias_dps = view_segment(worn.recording.segments[0]), samples.calibration.gyro_bias_dps
    up = estimate_published(run, bias_dps, how)
    found_deg = measure_elevation(up, samples.calibration.arm_axis).astype(np.float64)
    rows = {number: find_rows(worn, f"repetition {number}") for number in TITLES}
    return {number: compare(found_deg[at], worn.truth_deg[at]) for number, at in rows.items()}


def _draw(number: int, agreement: TaskFigures) -> str:
    r = "NA" if number in QUASI_STATIC else f"{agreement.r:.3f}"
    return f"{agreement.rmse_deg:.2f} ({r})"


def _find_mismatch_deg(ours: Mapping[int, TaskFigures], paper: Mapping[int, TaskFigures]) -> float:
    return float(np.sqrt(np.mean([(ours[n].rmse_deg - paper[n].rmse_deg) ** 2 for n in paper])))
