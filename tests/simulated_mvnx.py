"""Write an angle as Xsens MVN would export it: MVNX version 4, the upper arm and forearm of one side."""

from pathlib import Path

import numpy as np

from acromion.fusion.recording import Float64Array

FRAME = (
    '<frame time="{ms}" index="{index}" tc="00:00:00:00" ms="{epoch}" type="{kind}">'
    "<orientation>{orientation}</orientation></frame>\n"
)
START_MS = 1_772_434_800_000
ARM_M = 0.28


def write_mvnx(path: Path, elevation_deg: Float64Array, frame_rate_hz: float, side: str = "right") -> Path:
    """Write one frame for each angle, shape (n,); the arm is raised sideways, the heading turns slowly.

    The segment's frame is MVN's: x forward, y to the left, z up when the arm is held level to the side.
    """
    sign = 1.0 if side == "right" else -1.0
    with path.open("w", encoding="ascii") as file:
        file.write(_write_head(frame_rate_hz, side, sign))
        file.write(_write_frame(0, 0.0, "tpose", (1.0, 0.0, 0.0, 0.0)))
        for index, angle_deg in enumerate(elevation_deg.tolist()):
            file.write(_write_frame(index, frame_rate_hz, "normal", _turn(angle_deg, index, sign)))
        file.write("</frames></subject></mvnx>\n")
    return path


def _turn(angle_deg: float, index: int, sign: float) -> tuple[float, float, float, float]:
    """Roll the level arm (90 deg) down or up, then turn it about the vertical."""
    roll, yaw = sign * np.radians(90.0 - angle_deg) / 2.0, 0.0001 * index
    w, x = np.cos(roll), np.sin(roll)
    return float(np.cos(yaw) * w), float(np.cos(yaw) * x), float(np.sin(yaw) * x), float(np.sin(yaw) * w)


def _write_frame(index: int, rate_hz: float, kind: str, wxyz: tuple[float, float, float, float]) -> str:
    ms = round(1000.0 * index / rate_hz) if rate_hz else 0
    orientation = " ".join(f"{value:.6f}" for value in (*wxyz, *wxyz))
    return FRAME.format(ms=ms, index=index, epoch=START_MS + ms, kind=kind, orientation=orientation)


def _write_head(frame_rate_hz: float, side: str, sign: float) -> str:
    name = side.capitalize()
    elbow = f"0.000000 {-sign * ARM_M:.6f} 0.000000"
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<mvnx version="4"><mvn version="2022.0.0"/>\n'
        f'<subject label="simulated" frameRate="{frame_rate_hz:g}" segmentCount="2"><segments>\n'
        f'<segment label="{name}UpperArm" id="1"><points>'
        f'<point label="j{name}Shoulder"><pos_b>0.000000 0.000000 0.000000</pos_b></point>'
        f'<point label="j{name}Elbow"><pos_b>{elbow}</pos_b></point></points></segment>\n'
        f'<segment label="{name}ForeArm" id="2"><points></points></segment></segments>\n'
        '<frames segmentCount="2">\n'
    )
