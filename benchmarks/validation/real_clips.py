"""Upper-arm motion from recorded clips, joined to a shift of any length.

Clips are from CMU Graphics Lab (subjects 01 to 03, free for any use) or, as BVH files, from the motion
dataset 1 of Bandai Namco Research (acted styles, CC BY-NC 4.0), one style per subject.

Directions and accelerations within a clip are real, low-passed at 7 Hz. Order and length of the tasks, turns
between clips, pauses and poses are invented. The sensor is fixed to a rigid arm unless a clip has a plate
(``skin_clips``), which moves on the arm with the skin. World: z up. Arm: z from the elbow to the shoulder, so
that it points to the zenith when the arm hangs.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BPoly, CubicSpline
from scipy.signal import butter, sosfiltfilt
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

from acromion.fusion.recording import STANDARD_GRAVITY, Float64Array
from acromion.fusion.simulation.body import ArmState
from benchmarks.validation.bvh import ArmMotion, read_bvh

Side = Literal["r", "l"]

CLIP_HZ = 120.0
LOW_PASS_HZ = 7.0
LEVER_M = np.array([0.05, 0.0, -0.22])
SWAY_DEG = 0.3
SWAY_HZ = (0.15, 0.5)
TURN_S, STRIDE_TURN_S, HOLD_TURN_S = 0.5, 0.1, 1.0
TURN_DPS, TURN_MPS2 = 100.0, 3.0
"""Limits of speed and acceleration of a turn; they determine its duration."""
SHORTEST_STRIDE_S = 0.9
CANDIDATES = 4
PAUSE_S, PAUSE_SD_DEG = (6.0, 20.0), 5.0
Z_UP = Rotation.from_rotvec([np.pi / 2.0, 0.0, 0.0])


@dataclass(frozen=True, slots=True, eq=False)
class Plate:
    """A plate on the skin: ``turn`` (n,), its frame to the arm's, and its ``place_m`` (n, 3).

    The place is relative to the shoulder, in the arm's frame.
    """

    turn: Rotation
    place_m: Float64Array


@dataclass(frozen=True, slots=True, eq=False)
class Clip:
    """Motion at 120 Hz: ``turn`` (n,), arm's frame to world, and the shoulder's ``velocity_mps`` (n, 3).

    Without a ``plate`` the sensor is fixed to the arm at ``LEVER_M``.
    """

    turn: Rotation
    velocity_mps: Float64Array
    plate: Plate | None = None

    def face(self, turn: Rotation) -> "Clip":
        """Return the clip rotated about the vertical so that it starts as near to ``turn`` as possible."""
        between = (turn * self.turn[0].inv()).as_matrix()
        angle = np.arctan2(between[1, 0] - between[0, 1], between[0, 0] + between[1, 1])
        heading = Rotation.from_rotvec([0.0, 0.0, angle])
        return Clip(heading * self.turn, heading.apply(self.velocity_mps), self.plate)


@dataclass(frozen=True, slots=True, eq=False)
class Library:
    """The clips of one arm: ``work`` by subject, and ``strides`` that can be repeated, by subject."""

    work: dict[str, list[Clip]]
    strides: dict[str, list[Clip]]


PLAIN_WALKING = ("02_01", "02_02", "03_01", "03_02")
UNEVEN_GROUND = ("03_03", "03_04")
WALK_STYLE, WORK_STYLES, EVERYBODY = "walk", ("bow", "bye", "byebye", "guide", "respond"), ("call", "slash")
"""Contents of the acted styles: walking, contents that every style has, and contents common to all."""


def load_library(folder: Path, side: Side) -> Library:
    """Read all clips of one arm: CMU's arrays, or BVH files named ``dataset-1_CONTENT_STYLE_NUMBER``.

    Raises
    ------
    OSError
        A file that cannot be read.
    """
    library = Library({}, {})
    for path in sorted(folder.glob("cmu_*.npz")):
        name = path.stem.removeprefix("cmu_")
        clip = load_clip(path, side)
        if name in PLAIN_WALKING:
            library.strides.setdefault(name[:2], []).append(cut_stride(clip))
        elif name in UNEVEN_GROUND:
            library.strides.setdefault(name[:2], []).append(clip)
        else:
            library.work.setdefault(name[:2], []).append(clip)
    for path in sorted(folder.glob("*.bvh")):
        _, content, style, _ = path.stem.split("_")
        if content == WALK_STYLE:
            library.strides.setdefault(style, []).append(cut_stride(load_clip(path, side)))
        elif content in WORK_STYLES or content in EVERYBODY:
            library.work.setdefault(style, []).append(load_clip(path, side))
    return library


def load_clip(path: Path, side: Side) -> Clip:
    """Read one arm of a trial: low-passed, z up, the arm's z exactly along elbow to shoulder."""
    if path.suffix == ".bvh":
        arm = read_bvh(path, side)
    else:
        with np.load(path) as trial:
            shoulder_m, elbow_m = (
                trial[f"{side}_{part}_m"].astype(np.float64) for part in ("shoulder", "elbow")
            )
            turn = Rotation.from_quat(trial[f"{side}_humerus_quat_xyzw"].astype(np.float64))
        arm = ArmMotion(CLIP_HZ, shoulder_m, elbow_m, turn)
    along = arm.turn.inv().apply(arm.shoulder_m - arm.elbow_m).mean(axis=0)
    to_segment, _ = Rotation.align_vectors(along[None], np.array([[0.0, 0.0, 1.0]]))
    segment = Rotation.from_quat(resample(make_continuous(arm.turn.as_quat()), arm.rate_hz))
    velocity = np.gradient(resample(Z_UP.apply(arm.shoulder_m), arm.rate_hz), 1.0 / CLIP_HZ, axis=0)
    return Clip(Z_UP * segment * to_segment, velocity)


def make_continuous(quaternion: Float64Array) -> Float64Array:
    """Return the same rotations, with the sign of each quaternion chosen to match the previous one."""
    flips = np.sign((quaternion[1:] * quaternion[:-1]).sum(axis=1))
    return np.asarray(quaternion * np.concatenate([[1.0], np.cumprod(flips)])[:, None])


def resample(values: Float64Array, rate_hz: float) -> Float64Array:
    """Return the values at 120 Hz, low-passed."""
    frames_s = np.arange(len(values)) / rate_hz
    time_s = np.arange(int(frames_s[-1] * CLIP_HZ) + 1) / CLIP_HZ
    low_pass = butter(2, LOW_PASS_HZ, fs=CLIP_HZ, output="sos")
    return np.asarray(sosfiltfilt(low_pass, CubicSpline(frames_s, values)(time_s), axis=0))


def cut_stride(clip: Clip) -> Clip:
    """Return the stretch of a walk whose end is most like its start, so that it can be repeated."""
    up = clip.turn.inv().apply([0.0, 0.0, 1.0])
    rate = np.gradient(up, 1.0 / CLIP_HZ, axis=0)
    features = np.hstack([up, 0.1 * rate, 0.1 * clip.turn.inv().apply(clip.velocity_mps)])
    apart = cdist(features, features)
    apart[np.tril_indices(len(up), round(SHORTEST_STRIDE_S * CLIP_HZ))] = np.inf
    first, last = np.unravel_index(int(np.argmin(apart)), apart.shape)
    return Clip(clip.turn[first:last], clip.velocity_mps[first:last])


@dataclass(slots=True, eq=False)
class Track:
    """Clips joined one after the other by minimum-jerk turns.

    ``strap`` returns the plate for clips and held postures that have none. Without it, no clip may have one.
    """

    chance: np.random.Generator
    strap: Callable[[Rotation], Plate] | None = None
    _clips: list[Clip] = field(default_factory=list)
    _count: int = 0

    @property
    def length_s(self) -> float:
        """Current duration."""
        return self._count / CLIP_HZ

    def append(self, clip: Clip, least_s: float = TURN_S) -> None:
        """Turn to the start of a clip, then append it."""
        if self.strap and clip.plate is None:
            clip = replace(clip, plate=self.strap(clip.turn))
        if self._clips:
            clip = clip.face(self.now)
            self._add(_bridge(self._clips[-1], clip, least_s))
        self._add(clip)

    def append_nearest(self, clips: Sequence[Clip]) -> None:
        """Draw a few clips at random, and append the clip that starts most like the current posture."""
        drawn = [clips[k] for k in self.chance.choice(len(clips), min(CANDIDATES, len(clips)), replace=False)]
        self.append(min(drawn, key=self._find_turn))

    @property
    def now(self) -> Rotation:
        """The current posture."""
        return self._clips[-1].turn[-1]

    def hold(self, turn: Rotation, seconds: float, sway_deg: float = SWAY_DEG) -> tuple[float, float]:
        """Hold a posture with a little sway; return its start and end, s."""
        count = round(seconds * CLIP_HZ)
        time_s = np.arange(count) / CLIP_HZ
        phases, rates_hz = (
            self.chance.uniform(0.0, 2.0 * np.pi, (2, 3)),
            self.chance.uniform(*SWAY_HZ, (2, 3)),
        )
        waves = np.sin(2.0 * np.pi * rates_hz * time_s[:, None, None] + phases).sum(axis=1)
        sway = Rotation.from_rotvec(np.radians(sway_deg) / np.sqrt(3.0) * waves)
        self.append(Clip(turn * sway, np.zeros((count, 3))), least_s=HOLD_TURN_S)
        return self.length_s - seconds, self.length_s

    def pause(self) -> None:
        """Hold a random posture near the current one."""
        spread = np.radians(PAUSE_SD_DEG) * self.chance.standard_normal(2)
        self.hold(Rotation.from_rotvec([*spread, 0.0]) * self.now, float(self.chance.uniform(*PAUSE_S)))

    def join(self) -> Clip:
        """Return all clips joined."""
        turn = Rotation.concatenate([clip.turn for clip in self._clips])
        velocity_mps = np.concatenate([clip.velocity_mps for clip in self._clips])
        plates = [clip.plate for clip in self._clips if clip.plate]
        if not plates:
            return Clip(turn, velocity_mps)
        turns = Rotation.concatenate([plate.turn for plate in plates])
        return Clip(turn, velocity_mps, Plate(turns, np.concatenate([plate.place_m for plate in plates])))

    def _find_turn(self, clip: Clip) -> float:
        return float((self.now.inv() * clip.face(self.now).turn[0]).magnitude())

    def _add(self, clip: Clip) -> None:
        self._clips.append(clip)
        self._count += len(clip.velocity_mps)


def _bridge(before: Clip, after: Clip, least_s: float) -> Clip:
    """Return a quintic turn from one clip to the next, matching rates and accelerations at both ends."""
    last, tail, head = _find_ends(before.turn, after.turn)
    change_mps = float(np.linalg.norm(after.velocity_mps[0] - before.velocity_mps[-1]))
    turned_deg = np.degrees(np.linalg.norm(head[0]))
    length_s = max(least_s, float(turned_deg) / TURN_DPS, change_mps / TURN_MPS2)
    count = max(2, round(length_s * CLIP_HZ))
    time_s = np.arange(1, count) / CLIP_HZ
    ends_s = [0.0, count / CLIP_HZ]

    def ease(tail: Float64Array, head: Float64Array, orders: int = 3) -> Float64Array:
        ends = [_derive(tail[::-1], -1.0)[:orders], _derive(head, 1.0)[:orders]]
        return np.asarray(BPoly.from_derivatives(ends_s, ends)(time_s))

    turn = last * Rotation.from_rotvec(ease(tail, head))
    velocity_mps = ease(before.velocity_mps[-3:], after.velocity_mps[:3], orders=2)
    if before.plate is None or after.plate is None:
        return Clip(turn, velocity_mps)
    last, tail, head = _find_ends(before.plate.turn, after.plate.turn)
    place_m = ease(before.plate.place_m[-3:], after.plate.place_m[:3])
    return Clip(turn, velocity_mps, Plate(last * Rotation.from_rotvec(ease(tail, head)), place_m))


def _find_ends(before: Rotation, after: Rotation) -> tuple[Rotation, Float64Array, Float64Array]:
    """Return the last rotation.

    Also return the last three rotations and the three after them, as rotation vectors relative to it.
    """
    last = before[-1]
    return last, (last.inv() * before[-3:]).as_rotvec(), (last.inv() * after[:3]).as_rotvec()


def _derive(values: Float64Array, sign: float) -> list[Float64Array]:
    """Return value, rate and acceleration at the first of three samples; ``sign`` -1 for reversed time."""
    rate = sign * CLIP_HZ * (-1.5 * values[0] + 2.0 * values[1] - 0.5 * values[2])
    return [values[0], rate, CLIP_HZ**2 * (values[0] - 2.0 * values[1] + values[2])]


def compute_readings(clip: Clip, rate_hz: float) -> ArmState:
    """Return the readings of an ideal sensor on the arm, or on its plate, and the exact elevation of the arm.

    The angular rate is the rotation from half a sample before to half a sample after.
    """
    frames_s = np.arange(len(clip.velocity_mps)) / CLIP_HZ
    arm_turns = CubicSpline(frames_s, make_continuous(clip.turn.as_quat()))
    sensor = clip.turn * clip.plate.turn if clip.plate else clip.turn
    turns = CubicSpline(frames_s, make_continuous(sensor.as_quat()))
    velocity = CubicSpline(frames_s, clip.velocity_mps)
    time_s = np.arange(int((frames_s[-1] - 1.0 / rate_hz) * rate_hz)) / rate_hz + 0.5 / rate_hz
    turn = Rotation.from_quat(turns(time_s))
    edges = Rotation.from_quat(turns(np.append(time_s - 0.5 / rate_hz, time_s[-1] + 0.5 / rate_hz)))
    rate = (edges[:-1].inv() * edges[1:]).as_rotvec() * rate_hz
    force = velocity(time_s, 1) + np.array([0.0, 0.0, STANDARD_GRAVITY])
    if clip.plate:
        lever = turn.inv().apply(CubicSpline(frames_s, clip.turn.apply(clip.plate.place_m))(time_s, 2))
    else:
        lever = np.cross(np.gradient(rate, 1.0 / rate_hz, axis=0), LEVER_M)
        lever += np.cross(rate, np.cross(rate, LEVER_M))
    acc_g = (turn.inv().apply(force) + lever) / STANDARD_GRAVITY
    elevation_deg = find_elevation_deg(Rotation.from_quat(arm_turns(time_s)))
    return ArmState(acc_g, np.degrees(rate), np.zeros_like(acc_g), elevation_deg)


def find_elevation_deg(turn: Rotation) -> NDArray[np.float64]:
    """Return the angle between the elbow-shoulder line and the vertical, (n,), deg."""
    up = turn.apply([0.0, 0.0, 1.0])
    return np.asarray(np.degrees(np.arctan2(np.hypot(up[:, 0], up[:, 1]), up[:, 2])))
