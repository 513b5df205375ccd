"""Which columns of a table hold an orientation, by the names that Xsens and others give them.

A matrix before a quaternion before Euler angles, where an export holds several: they say the same.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from fusion.angle_files.tables import Layout, read_columns
from fusion.angle_files.types import Vector
from fusion.angle_files.vertical import Up, take_up_of_euler, take_up_of_quaternion, take_up_of_row
from fusion.readers.source import Source

MATRIX_ROW = (("mat31", "mat32", "mat33"),)
QUATERNIONS = (
    ("quat_q0", "quat_q1", "quat_q2", "quat_q3"),
    ("quat_w", "quat_x", "quat_y", "quat_z"),
    ("quatw", "quatx", "quaty", "quatz"),
    ("qw", "qx", "qy", "qz"),
    ("q_w", "q_x", "q_y", "q_z"),
    ("q0", "q1", "q2", "q3"),
    ("q_0", "q_1", "q_2", "q_3"),
    ("quaternion_w", "quaternion_x", "quaternion_y", "quaternion_z"),
    ("w", "x", "y", "z"),
)
EULER = (("roll", "pitch"), ("euler_x", "euler_y"))

Kind = str
FORMS: Sequence[tuple[Kind, Sequence[tuple[str, ...]]]] = (
    ("matrix", MATRIX_ROW),
    ("quaternion", QUATERNIONS),
    ("euler", EULER),
)


def find_orientation(names: Sequence[str]) -> tuple[Kind, tuple[str, ...]] | None:
    """Find the columns that give the vertical, and in which form."""
    for kind, choices in FORMS:
        for columns in choices:
            if set(columns) <= set(names):
                return kind, columns
    return None


def read_up(
    source: Source, layout: Layout, orientation: tuple[Kind, tuple[str, ...]], others: Sequence[str]
) -> tuple[Up, Mapping[str, Vector]]:
    """Read the zenith in the sensor's frame (n, 3), and other columns beside it."""
    kind, columns = orientation
    values = read_columns(source, layout, [*columns, *others])
    numbers = [values[name] for name in columns]
    if kind == "euler":
        return take_up_of_euler(numbers[0], numbers[1]), values
    stacked = np.stack(numbers, axis=1)
    return (take_up_of_row if kind == "matrix" else take_up_of_quaternion)(stacked), values
