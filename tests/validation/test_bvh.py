"""Upper arms out of BVH files."""

from pathlib import Path

import pytest

from benchmarks.validation.bvh import read_bvh

ARM = """\
HIERARCHY
ROOT Hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT UpperArm_R
  {
    OFFSET -20 50 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    JOINT LowerArm_R
    {
      OFFSET -30 0 0
      CHANNELS 3 Zrotation Xrotation Yrotation
      End Site
      {
        OFFSET -25 0 0
      }
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.025
0 100 0 0 0 0 0 0 0 0 0 0
0 100 0 0 0 0 90 0 0 45 0 0
"""


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    path = tmp_path / "dataset-1_walk_normal_001.bvh"
    path.write_text(ARM, "utf-8")
    return path


def test_shoulder_and_elbow_are_placed_by_the_joints_above_them_in_metres(arm: Path) -> None:
    read = read_bvh(arm, "r")

    assert read.rate_hz == pytest.approx(40.0)
    assert read.shoulder_m[0] == pytest.approx([-0.2, 1.5, 0.0])
    assert read.elbow_m[0] == pytest.approx([-0.5, 1.5, 0.0])
    assert read.elbow_m[1] == pytest.approx([-0.2, 1.2, 0.0])  # turned with the upper arm, not the forearm
    with pytest.raises(StopIteration):
        read_bvh(arm, "l")
