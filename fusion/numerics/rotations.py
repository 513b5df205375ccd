"""Angles between directions, and the turn of one into another."""

import numpy as np

from fusion.recording import Float64Array


def cos_deg(angle_deg: float) -> float:
    """Return the cosine of an angle in degrees."""
    return float(np.cos(np.radians(angle_deg)))


def find_angle_deg(first: Float64Array, second: Float64Array) -> float:
    """Return the angle between two vectors (3,), whatever their lengths."""
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(first, second)), first @ second)))


def scale_to_unit(vector: Float64Array) -> Float64Array:
    """Return the same direction at length 1."""
    return np.asarray(vector / np.linalg.norm(vector))


def find_turn(before: Float64Array, after: Float64Array) -> Float64Array:
    """Return the smallest rotation, (3, 3), of one unit vector into another."""
    cross, cosine = np.cross(before, after), float(before @ after)
    skew = np.array([[0.0, -cross[2], cross[1]], [cross[2], 0.0, -cross[0]], [-cross[1], cross[0], 0.0]])
    return np.asarray(np.eye(3) + skew + skew @ skew / max(1.0 + cosine, 1e-9))
