"""A simulated quarter of an hour of work, to try the live page without a sensor."""

import tempfile
from functools import cache
from pathlib import Path

from fusion.readers import read_recording
from fusion.recording import Recording
from fusion.simulation import simulate_shift, write_shift

DEMO_HOURS = 0.25


@cache
def make_demo() -> Recording:
    """Simulate it once for each server: a GT9X Link, 100 Hz, the pose held at the start."""
    with tempfile.TemporaryDirectory() as folder:
        shift = simulate_shift("gt9x", DEMO_HOURS, seed=1)
        return read_recording(write_shift(Path(folder), shift, actilife_csv=False)[0])
