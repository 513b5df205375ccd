"""Upper-arm motion with a sensor on the skin: daily tasks of four seated persons, five minutes in total.

Optical motion capture (UE_ADLdatabase, MIT License). A plate strapped to the upper arm like a sensor was
measured together with the humerus. The axial rotation of the humerus comes from that plate. Relative to the
arm, the plate therefore moves in elevation and plane, but hardly about the arm axis.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from acromion.fusion.recording import Float64Array
from benchmarks.validation.real_clips import (
    CLIP_HZ,
    Clip,
    Plate,
    find_elevation_deg,
    make_continuous,
    resample,
)

LOW_DEG = 25.0
"""Below this elevation the plate's mean orientation defines the mounting: it counts as that of the arm."""


def load_skin_library(folder: Path, *, is_rigid: bool) -> dict[str, list[Clip]]:
    """Return all trials by person; ``is_rigid``: the plate stays at its mean position at low elevation.

    Raises
    ------
    OSError
        A file that cannot be read.
    """
    library = {}
    for path in sorted(folder.glob("adl*.npz")):
        with np.load(path) as stored:
            arm = {name: stored[name].astype(np.float64) for name in stored.files}
        count = sum(name.startswith("humerus_quat") for name in arm)
        clips = [_load_trial(arm, k) for k in range(count)]
        library[path.stem] = _mount(clips, is_rigid=is_rigid)
    return library


def _load_trial(arm: dict[str, Float64Array], trial: int) -> Clip:
    rate_hz = float(arm["rate_hz"])

    def read(name: str) -> Float64Array:
        values = arm[f"{name}_{trial}"]
        return resample(make_continuous(values) if "quat" in name else values, rate_hz)

    turn = Rotation.from_quat(read("humerus_quat_xyzw"))
    velocity_mps = np.cumsum(read("shoulder_acc_mps2"), axis=0) / CLIP_HZ
    plate = Plate(Rotation.from_quat(read("sensor_quat_in_humerus_xyzw")), read("sensor_from_shoulder_m"))
    return Clip(turn, velocity_mps, plate)


def _mount(clips: list[Clip], *, is_rigid: bool) -> list[Clip]:
    """Return the clips with the plate's frame aligned with the arm's, on average, at low elevation."""
    plates = [clip.plate for clip in clips if clip.plate]
    is_low = np.concatenate([find_elevation_deg(clip.turn) < LOW_DEG for clip in clips])
    to_sensor = Rotation.concatenate([plate.turn for plate in plates])[is_low].mean().inv()
    place_m = np.concatenate([plate.place_m for plate in plates])[is_low].mean(axis=0)
    mounted = []
    for clip, plate in zip(clips, plates, strict=True):
        worn = Plate(plate.turn * to_sensor, plate.place_m)
        if is_rigid:
            count = len(plate.place_m)
            worn = Plate(Rotation.identity(count), np.tile(place_m, (count, 1)))
        mounted.append(Clip(clip.turn, clip.velocity_mps, worn))
    return mounted


class Strap:
    """The plate of one person in any posture, as a linear function of the vertical in the arm's frame.

    Fitted to the person's clips by least squares. ``Track`` uses it for held postures, because no plate was
    measured in them.
    """

    def __init__(self, clips: Sequence[Clip]) -> None:
        plates = [clip.plate for clip in clips if clip.plate]
        measured = [np.hstack([plate.turn.as_rotvec(), plate.place_m]) for plate in plates]
        postures = np.vstack([_describe(clip.turn) for clip in clips])
        self._slopes = np.linalg.lstsq(postures, np.vstack(measured), rcond=None)[0]

    def __call__(self, turn: Rotation) -> Plate:
        """Return the plate for an orientation of the arm."""
        fitted = _describe(turn) @ self._slopes
        return Plate(Rotation.from_rotvec(fitted[:, :3]), fitted[:, 3:])


def _describe(turn: Rotation) -> Float64Array:
    up = turn.inv().apply([0.0, 0.0, 1.0])
    return np.column_stack([np.ones(len(up)), up])
