"""Everything that the recording says about its own sensor, found in one go.

Order: still moments, clipped samples bridged, nodes (the samples are read no more after that), gyroscope
bias, accelerometer (from the moving arm, too, where it was still in few directions), gyroscope scale; then
the nodes once more with all of it applied.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from fusion.recording import FloatArray
from fusion.sensor_errors.accelerometer import (
    AccelerometerCorrection,
    calibrate_accelerometer,
    sees_few_directions,
)
from fusion.sensor_errors.bias_track import GyroBias
from fusion.sensor_errors.gyro_bias import follow_gyro_bias, reduce_about_start
from fusion.sensor_errors.gyro_scale import GyroScale, estimate_gyro_scale
from fusion.sensor_errors.moving_gravity import read_while_moving
from fusion.sensor_errors.nodes import Nodes, correct_nodes, reduce_to_nodes
from fusion.sensor_errors.runs import SensorRun
from fusion.sensor_errors.saturation import bridge_saturation
from fusion.sensor_errors.stillness import QuarterSeconds, QuietTable, reduce_run


@dataclass(frozen=True, slots=True, eq=False)
class SensorCalibration:
    """What is taken off the samples, the same for all segments of a recording."""

    bias: GyroBias
    accelerometer: AccelerometerCorrection
    gyro_scale: GyroScale


@dataclass(frozen=True, slots=True, eq=False)
class CalibratedRun:
    """One run with its clipped samples bridged, and its nodes with the calibration applied.

    ``source`` is the array of angular rates that it was made from.
    """

    run: SensorRun
    nodes: Nodes
    source: FloatArray


def calibrate_sensor(
    runs: Sequence[SensorRun],
    blocks: Sequence[QuarterSeconds],
    stills: QuietTable,
    acc_range_g: float | None = None,
    gyr_range_dps: float | None = None,
) -> tuple[SensorCalibration, tuple[CalibratedRun, ...]]:
    """Find bias, accelerometer correction and gyroscope scale, and apply them."""
    bridged = bridge_saturation(runs, blocks, acc_range_g, gyr_range_dps)
    rough = reduce_about_start(bridged, stills)
    bias = follow_gyro_bias(rough, stills)
    moving = None
    if sees_few_directions(stills):
        moving = read_while_moving([correct_nodes(nodes, bias) for nodes in rough])
    accelerometer = calibrate_accelerometer(stills, moving=moving)
    gyro_scale = estimate_gyro_scale(rough, stills, bias, accelerometer)
    calibration = SensorCalibration(bias, accelerometer, gyro_scale)
    return calibration, tuple(
        CalibratedRun(run, _apply(nodes, calibration), source.gyr_dps)
        for source, run, nodes in zip(runs, bridged, rough, strict=True)
    )


def apply_calibration(
    run: SensorRun,
    calibration: SensorCalibration,
    acc_range_g: float | None = None,
    gyr_range_dps: float | None = None,
) -> CalibratedRun:
    """Take a run with a calibration found elsewhere (in the whole of which it is a part)."""
    (bridged,) = bridge_saturation([run], [reduce_run(run)], acc_range_g, gyr_range_dps)
    return CalibratedRun(
        bridged, _apply(reduce_to_nodes(bridged, calibration.bias), calibration), run.gyr_dps
    )


def _apply(nodes: Nodes, calibration: SensorCalibration) -> Nodes:
    return correct_nodes(nodes, calibration.bias, calibration.gyro_scale.gain, calibration.accelerometer)
