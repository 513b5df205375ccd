"""Read shoulder, elbow and orientation of an upper arm from a BVH file of motion capture."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from acromion.fusion.recording import Float64Array

UPPER_ARMS = {"r": ("UpperArm_R", "RightArm"), "l": ("UpperArm_L", "LeftArm")}
FOREARMS = {"r": ("LowerArm_R", "RightForeArm"), "l": ("LowerArm_L", "LeftForeArm")}
CM = 0.01


@dataclass(slots=True, eq=False)
class Joint:
    """A joint of the hierarchy: its parent, its offset from it, and the columns of its channels."""

    name: str
    parent: "Joint | None"
    offset: Float64Array = field(default_factory=lambda: np.zeros(3))
    channels: dict[str, int] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class ArmMotion:
    """``shoulder_m``, ``elbow_m`` (n, 3), y up; ``turn`` (n,), upper arm to world."""

    rate_hz: float
    shoulder_m: Float64Array
    elbow_m: Float64Array
    turn: Rotation


def read_bvh(path: Path, side: str) -> ArmMotion:
    """Read one arm.

    Raises
    ------
    OSError, ValueError, StopIteration
        The file cannot be read, or has no upper arm.
    """
    head, _, tail = path.read_text("utf-8").partition("MOTION")
    joints = _read_hierarchy(head)
    _, frame_time, *lines = tail.strip().splitlines()
    values = np.array([line.split() for line in lines if line.strip()], dtype=np.float64)
    shoulder = next(joint for joint in joints if joint.name in UPPER_ARMS[side])
    elbow = next(joint for joint in joints if joint.name in FOREARMS[side])
    place, turn = _place(shoulder, values)
    return ArmMotion(1.0 / float(frame_time.split()[-1]), CM * place, CM * _place(elbow, values)[0], turn)


def _read_hierarchy(text: str) -> list[Joint]:
    joints: list[Joint] = []
    open_joints: list[Joint] = []
    columns = 0
    for line in text.splitlines():
        word, *rest = line.split() or [""]
        if word in {"ROOT", "JOINT", "End"}:
            joints.append(Joint(rest[0], open_joints[-1] if open_joints else None))
        elif word == "{":
            open_joints.append(joints[-1])
        elif word == "}":
            open_joints.pop()
        elif word == "OFFSET":
            joints[-1].offset = np.array(rest, dtype=np.float64)
        elif word == "CHANNELS":
            joints[-1].channels = {name: columns + k for k, name in enumerate(rest[1:])}
            columns += len(rest) - 1
    return joints


def _place(joint: Joint, values: Float64Array) -> tuple[Float64Array, Rotation]:
    """Return position and rotation of a joint at each frame; position channels replace the offset."""
    moved = np.tile(joint.offset, (len(values), 1))
    for k, axis in enumerate("XYZ"):
        if f"{axis}position" in joint.channels:
            moved[:, k] = values[:, joint.channels[f"{axis}position"]]
    turns = [name for name in joint.channels if name.endswith("rotation")]
    order = "".join(name[0] for name in turns) or "XYZ"
    angles = values[:, [joint.channels[name] for name in turns]] if turns else np.zeros((len(values), 3))
    turn = Rotation.from_euler(order, angles, degrees=True)
    if joint.parent is None:
        return moved, turn
    place, above = _place(joint.parent, values)
    return place + above.apply(moved), above * turn
