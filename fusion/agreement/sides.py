"""The two sides of a comparison: a recording that we fused, or a file that holds its angle already."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from fusion.agreement.clocks import Alignment
from fusion.agreement.runs import Runs, measure_path, take_paths, take_runs
from fusion.angle_files import AngleFile, calibrate_file, lay_file
from fusion.errors import UnknownAxis
from fusion.pipeline import FusedRecording
from fusion.recording import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Side:
    """One measurement of the arm, in its own clock.

    ``runs`` is the elevation, empty as long as the arm's axis is not known; ``paths`` the way of the
    vertical, empty where only angles are known. ``calibration_s`` is when the arm hung still, for the other
    side to use.
    """

    device: str
    sha256: str
    duration_s: float
    runs: Runs
    paths: Runs = ()
    calibration_s: tuple[float, float] | None = None
    understood: Mapping[str, str] = field(default_factory=dict)


def take_recording(fused: FusedRecording) -> Side:
    """Take a recording of ours; its clock counts from its first sample."""
    recording, still = fused.samples.recording, fused.samples.calibration.still
    return Side(
        recording.device,
        recording.sha256,
        recording.duration_us / 1e6,
        take_runs(fused.elevation),
        take_paths(fused.elevation),
        (still.start_s, still.start_s + still.duration_s),
        recording.understood,
    )


def take_angle_file(file: AngleFile, calibration_s: tuple[float, float] | None = None) -> Side:
    """Take a file with its angle, or with an orientation only; its clock is its own."""
    return Side(
        file.device,
        file.sha256,
        file.last_s - file.first_s,
        _lay(file, file.elevation_deg),
        _lay(file, None if file.up is None else measure_path(file.up)),
        calibration_s,
        file.understood,
    )


def _lay(file: AngleFile, values: FloatArray | None) -> Runs:
    return () if values is None else take_runs(lay_file(file, values)[1], file.first_s)


def share_calibration(file: AngleFile, ours: Side, rough: Alignment) -> AngleFile:
    """Calibrate the reference at the moment at which our side was calibrated.

    Raises
    ------
    UnknownAxis
        Our side has no such moment, or the reference did not hang still then.
    """
    if ours.calibration_s is None:
        raise UnknownAxis
    start_s, end_s = rough.to_reference(np.array(ours.calibration_s))
    return calibrate_file(file, (float(start_s), float(end_s)))
