"""Samples put right, in place, and how that is said: a shift is too large to be held twice."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fusion.recording import QualityFlag, Recording

Matrix = NDArray[np.float64]
Facts = Mapping[str, str | int | float]
BLOCK_ROWS = 1 << 16
"""Rows that change places in one step."""
MIRROR = np.array([-1.0, 1.0, 1.0])


def flag_correction(recording: Recording, what: str, evidence: str, facts: Facts) -> Recording:
    """Say what was put right, and by what evidence (W-UNITS)."""
    flag = QualityFlag("W-UNITS", facts={"what": what, "evidence": evidence, **facts})
    return replace(recording, flags=(*recording.flags, flag))


def multiply_acceleration(recording: Recording, factors: Matrix | Sequence[float] | float) -> None:
    """Multiply the acceleration, all axes alike or each by its own factor, in place."""
    for segment in recording.segments:
        segment.acc_g[:] *= np.asarray(factors, np.float32)


def multiply_rates(recording: Recording, factors: Matrix | Sequence[float] | float) -> None:
    """Multiply the angular rate in the same way."""
    for segment in recording.segments:
        segment.gyr_dps[:] *= np.asarray(factors, np.float32)


def is_mirrored(turn: Matrix) -> bool:
    """Whether all three rates are the other way about, as in a left-handed frame."""
    return bool(np.all(turn == -np.eye(3)))


def turn_axes(recording: Recording, turn: Matrix) -> Recording:
    """Put the rates in the order and signs of ``turn`` (3, 3), in place, and say which were not.

    Row i of ``turn`` says which reading, with which sign, is the rate about axis i. Where all are the other
    way about, x of both sensors is turned instead: the frame was left-handed.
    """
    if np.all(turn == np.eye(3)):
        return recording
    if is_mirrored(turn):
        multiply_acceleration(recording, MIRROR)
        multiply_rates(recording, MIRROR)
        return flag_correction(recording, "left-handed", "motion", {"turned": "x"})
    order, signs = np.abs(turn).argmax(axis=1), turn.sum(axis=1)
    for segment in recording.segments:
        reorder_columns(segment.gyr_dps, order)
    multiply_rates(recording, signs)
    if np.all(order == np.arange(3)):
        turned = ", ".join(axis for axis, sign in zip("xyz", signs, strict=True) if sign < 0)
        return flag_correction(recording, "signs", "motion", {"turned": turned, "order": name_axes(turn)})
    return flag_correction(recording, "axes", "motion", {"order": name_axes(turn)})


def reorder_columns(values: NDArray[np.float32], order: NDArray[np.intp]) -> None:
    """Let the columns of (n, 3) change places, in place."""
    for first in range(0, len(values), BLOCK_ROWS):
        values[first : first + BLOCK_ROWS] = values[first : first + BLOCK_ROWS, order]


def name_axes(turn: Matrix) -> str:
    """Which readings, with which signs, are the rates about x, y and z: "+x +y +z" as it should be."""
    return " ".join(f"{'-' if row.sum() < 0 else '+'}{'xyz'[int(np.abs(row).argmax())]}" for row in turn)


def name_factors(axes: Matrix) -> dict[str, float]:
    """Factors of x, y and z as facts."""
    return {f"factor_{axis}": round(float(k), 3) for axis, k in zip("xyz", axes, strict=True)}
