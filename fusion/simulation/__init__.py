"""Simulate a working day, the arm's exact elevation, and the files of an imperfect sensor."""

from acromion.fusion.simulation.files import write_recordings, write_shift
from acromion.fusion.simulation.shift import SimulatedShift, simulate_shift

__all__ = ["SimulatedShift", "simulate_shift", "write_recordings", "write_shift"]
