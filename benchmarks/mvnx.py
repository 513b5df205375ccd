"""A large MVNX: how much memory and time reading it takes.

    python -m benchmarks.mvnx DIR [megabytes]

Frames as MVN writes them: 23 segments, orientations and positions, about 2.6 kB each. The peak is that of a
process of its own, less what the same process uses before it reads.
"""

import subprocess
import sys
from pathlib import Path

import numpy as np

SEGMENTS = [
    "Pelvis",
    "L5",
    "L3",
    "T12",
    "T8",
    "Neck",
    "Head",
    "RightShoulder",
    "RightUpperArm",
    "RightForeArm",
    "RightHand",
    "LeftShoulder",
    "LeftUpperArm",
    "LeftForeArm",
    "LeftHand",
    "RightUpperLeg",
    "RightLowerLeg",
    "RightFoot",
    "RightToe",
    "LeftUpperLeg",
    "LeftLowerLeg",
    "LeftFoot",
    "LeftToe",
]
GOAL_MIB = 300

READ = """
import resource, sys, time
from fusion.angle_files import read_angle_file
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
start_s = time.process_time()
with open(sys.argv[1], "rb") as file:
    angles = read_angle_file(file)
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
print(len(angles.time_s), (peak - before) / 1024, peak / 1024, time.process_time() - start_s)
"""


def write_large(path: Path, megabytes: int) -> None:
    """Write distinct frames, 200 of them over and over with their own number and time."""
    chance = np.random.default_rng(1)
    labels = "".join(f'<segment label="{name}" id="{k + 1}"/>' for k, name in enumerate(SEGMENTS))
    bodies = [_write_body(chance) for _ in range(200)]
    with path.open("w", encoding="ascii") as file:
        file.write(f'<mvnx version="4"><subject frameRate="240"><segments>{labels}</segments><frames>\n')
        index, size = 0, 0
        while size < megabytes * 1_000_000:
            frame = f'<frame time="{round(index / 0.24)}" index="{index}" type="normal">{bodies[index % 200]}'
            file.write(frame)
            size, index = size + len(frame), index + 1
        file.write("</frames></subject></mvnx>\n")


def _write_body(chance: np.random.Generator) -> str:
    quaternions = chance.normal(size=(len(SEGMENTS), 4))
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    orientation = " ".join(f"{value:.6f}" for value in quaternions.ravel())
    position, speed, turn, push = (
        " ".join(f"{value:.6f}" for value in chance.normal(size=3 * len(SEGMENTS))) for _ in range(4)
    )
    return (
        f"<orientation>{orientation}</orientation><position>{position}</position><velocity>{speed}</velocity>"
        f"<angularVelocity>{turn}</angularVelocity><acceleration>{push}</acceleration></frame>\n"
    )


def main(folder: Path, megabytes: int = 1000) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "large.mvnx"
    write_large(path, megabytes)
    command = [sys.executable, "-c", READ, str(path)]
    told = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    path.unlink()
    frames, above_mib, peak_mib, cpu_s = int(told[0]), *(float(word) for word in told[1:])
    print(
        "| MVNX | frames | peak above start, MiB | whole process, MiB | CPU s | goal, MiB |",
        "|---|---|---|---|---|---|",
        sep="\n",
    )
    print(f"| {megabytes} MB | {frames} | {above_mib:.0f} | {peak_mib:.0f} | {cpu_s:.1f} | {GOAL_MIB} |")


if __name__ == "__main__":
    main(Path(sys.argv[1]), *map(int, sys.argv[2:]))
