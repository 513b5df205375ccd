"""Compile the kernels of an analysis once after an installation: ``python -m acromion.fusion.prepare``.

The first analysis compiles each kernel when it reaches it, from reading to counting. This module compiles on
a synthetic recording in the opposite order. With two cores they meet in the middle, and the first analysis
takes half the time. The results do not depend on which process compiled a kernel.
"""

from datetime import UTC, datetime

import numpy as np

from acromion.fusion.conventions import MethodName
from acromion.fusion.elevation import Elevation, ElevationSegment, describe_method
from acromion.fusion.exposure.summary import summarise_exposure
from acromion.fusion.numba_kernels import mark_prepared
from acromion.fusion.pipeline import analyse, fuse_recording
from acromion.fusion.recording import MICROSECONDS, Recording, Segment
from acromion.fusion.settings import AnalysisSettings

RATE_HZ = 100.0
DURATION_S = 1200
STILL_S = 20
SWING_S = 4.0
START = datetime(2026, 3, 2, 8, tzinfo=UTC)
METHODS: tuple[MethodName, ...] = ("smoothed", "published", "live")


def prepare() -> None:
    """Compile everything an analysis needs after the reading, the last step first; then mark it as done."""
    recording = make_recording()
    summarise_exposure(make_elevation(recording), START, recording, np.zeros(3), bias_sigma_deg=5.0)
    fuse_recording(recording, AnalysisSettings())
    for method in METHODS:
        analyse(recording, AnalysisSettings(method))
    mark_prepared()


def make_elevation(recording: Recording) -> Elevation:
    """Return the angle of a swinging arm, as the fusion would."""
    (segment,) = recording.segments
    up = segment.acc_g / np.linalg.norm(segment.acc_g, axis=1, keepdims=True)
    angle_deg = np.degrees(np.arccos(np.clip(up[:, 1], -1.0, 1.0)))
    run = ElevationSegment(0, RATE_HZ, angle_deg, np.ones(len(segment), bool), up)
    return Elevation((run,), describe_method("smoothed"), 1.0)


def make_recording() -> Recording:
    """Return twenty minutes of an arm that is held still and then swings, with small sensor errors."""
    time_s = np.arange(int(DURATION_S * RATE_HZ)) / RATE_HZ
    phase = 2.0 * np.pi * np.maximum(time_s - STILL_S, 0.0) / SWING_S
    angle_rad = np.radians(50.0) * (1.0 - np.cos(phase))
    rate_dps = np.where(time_s < STILL_S, 0.0, 50.0 * np.sin(phase) * 2.0 * np.pi / SWING_S)
    noise = np.random.default_rng(1)
    acc_g = np.stack([np.sin(angle_rad), np.cos(angle_rad), np.zeros_like(time_s)], axis=1)
    gyr_dps = np.stack([np.zeros_like(time_s), np.zeros_like(time_s), rate_dps], axis=1)
    acc_g += noise.normal(0.0, 0.003, acc_g.shape)
    gyr_dps += noise.normal(0.0, 0.1, gyr_dps.shape)
    segment = Segment(0, RATE_HZ, acc_g.astype(np.float32), gyr_dps.astype(np.float32))
    return Recording("other", "", START, None, DURATION_S * MICROSECONDS, (segment,))


if __name__ == "__main__":
    prepare()
