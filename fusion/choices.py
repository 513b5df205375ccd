"""What a person may choose. Kept apart from what it does, so that asking costs nothing."""

from typing import Literal

MethodName = Literal["smoothed", "published", "live"]
Pose = Literal["n-pose", "side-lean", "two-point"]
Side = Literal["left", "right"]
