"""Recordings and frames for the tests of live sessions."""

from dataclasses import replace

import numpy as np

from acromion.app.settings import Settings
from acromion.app.store.folder import format_recording_name, open_storage
from acromion.fusion.live import Frames, replay_frames
from acromion.fusion.recording import Recording
from tests.factories import hold

FIRST_POSE = (0.0, 12.0)


def make_worn(*poses: tuple[float, float]) -> Recording:
    """Hold each (elevation_deg, seconds) with the noise of a worn sensor."""
    made = hold(*poses).recording
    chance = np.random.default_rng(0)
    segment = made.segments[0]
    shape = segment.acc_g.shape
    noisy = replace(
        segment,
        acc_g=segment.acc_g + chance.normal(0.0, 0.003, shape).astype(np.float32),
        gyr_dps=segment.gyr_dps + chance.normal(0.0, 0.1, shape).astype(np.float32),
    )
    return replace(made, segments=(noisy,))


def make_frames(*poses: tuple[float, float]) -> Frames:
    """The same as one chunk of frames."""
    (frames,) = replay_frames(make_worn(*poses), 1e6)
    return frames


def count_stored_rows(settings: Settings, recording_id: str) -> int:
    """Count the rows of a stored recording."""
    storage = open_storage(settings)
    found = storage.fetch(format_recording_name(recording_id))
    try:
        return sum(line[:1].isdigit() for line in found.path.read_text().splitlines())
    finally:
        storage.release(found.path)
