"""A recording of the thigh without a gyroscope gives sitting and standing; on the arm it is refused."""

import io
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from acromion.app.batch.inputs import read_postures
from acromion.fusion.errors import NoGyroscope, UnusableDiary
from acromion.fusion.readers import read_recording
from acromion.fusion.readers.thigh import find_postures
from tests.fusion.readers.cwa.cwa_builder import AX3, PACKED, START_US, THREE_AXES, block, header

RATE_HZ = 50
SIT_S, WALK_S, STAND_S = 120, 90, 60
ACTILIFE = (
    "------------ Data File Created By ActiGraph GT3X+ ActiLife v6.13.4 Firmware v3.2.1 date format M/d/yyyy"
    " at 50 Hz  Filter Normal -----------\nSerial Number: TAS1\nStart Time 08:00:00\nStart Date 3/2/2026\n"
    "Epoch Period (hh:mm:ss) 00:00:00\nDownload Time 16:00:00\nDownload Date 3/2/2026\n"
    "Current Memory Address: 0\nCurrent Battery Voltage: 4.2     Mode = 12\n"
    "--------------------------------------------------\nAccelerometer X,Accelerometer Y,Accelerometer Z\n"
)


def simulate_thigh(sit_deg: float = 80.0, stand_deg: float = 15.0) -> NDArray[np.float64]:
    """Return g of a thigh that sits 120 s, walks 90 s (2 Hz) and stands 60 s; x is along the thigh."""
    lengths = SIT_S * RATE_HZ, WALK_S * RATE_HZ, STAND_S * RATE_HZ
    angle = np.radians(np.repeat([sit_deg, stand_deg, stand_deg], lengths))
    step_g = np.repeat([0.0, 0.3, 0.0], lengths) * np.sin(2 * np.pi * 2 * np.arange(sum(lengths)) / RATE_HZ)
    return np.stack([np.cos(angle) + step_g, np.zeros_like(angle), -np.sin(angle)], axis=1)


def write_table(acc: NDArray[np.float64], header: str = "time,acc_x,acc_y,acc_z") -> bytes:
    start = np.datetime64("2026-03-02T08:00:00.000", "ms")
    times = start + (np.arange(len(acc)) * (1000 // RATE_HZ)).astype("timedelta64[ms]")
    rows = (f"{time},{x:.4f},{y:.4f},{z:.4f}" for time, (x, y, z) in zip(times.astype(str), acc, strict=True))
    return "\n".join((header, *rows, "")).encode()


def describe(content: bytes, name: str = "thigh.csv") -> list[tuple[str, str, str]]:
    rows = find_postures(io.BytesIO(content), name)
    return [(str(row.start)[11:19], str(row.end)[11:19], row.label) for row in rows]


def is_as_simulated(found: list[tuple[str, str, str]]) -> bool:
    """Whether there are the two bouts, their change within two seconds: the rule looks at two seconds."""
    (start, change, first), (again, end, second) = found
    return (start, end, first, second) == ("08:00:00", "08:04:30", "seated", "upright") and (
        change == again and change in {"08:01:58", "08:01:59", "08:02:00", "08:02:01", "08:02:02"}
    )


def test_sitting_walking_and_standing_are_found_in_a_table_without_a_gyroscope() -> None:
    assert is_as_simulated(describe(write_table(simulate_thigh())))


def test_the_unit_and_the_direction_of_the_axis_do_not_matter() -> None:
    assert is_as_simulated(describe(write_table(-9.81 * simulate_thigh())))


def test_a_thigh_is_seated_beyond_45_degrees() -> None:
    assert [row[2] for row in describe(write_table(simulate_thigh(sit_deg=43.0)))] == ["upright"]
    assert [row[2] for row in describe(write_table(simulate_thigh(sit_deg=47.0)))] == ["seated", "upright"]


def test_actilife_exports_of_an_activity_monitor() -> None:
    rows = "".join(f"{x:.3f},{y:.3f},{z:.3f}\n" for x, y, z in simulate_thigh())

    assert is_as_simulated(describe((ACTILIFE + rows).encode()))


@pytest.mark.parametrize("axes", [THREE_AXES, PACKED], ids=["words", "packed"])
def test_an_ax3_on_the_thigh(axes: int) -> None:
    counts = np.round(256 * simulate_thigh()).astype(np.int64)
    if axes == PACKED:  # 10 bits each, exponent 0, little-endian
        word = (counts[:, 0] & 1023) | (counts[:, 1] & 1023) << 10 | (counts[:, 2] & 1023) << 20
        rows = word.astype("<u4").view("<i2").reshape(-1, 2)
    else:
        rows = counts.astype(np.int16)
    blocks = (
        block(k, START_US + k * 40 * 20_000, rows[40 * k : 40 * k + 40], axes=axes, scales=0, rate=0x49)
        for k in range(len(rows) // 40)
    )
    content = header(AX3) + b"".join(blocks)

    found = describe(content, "thigh.cwa")
    assert [row[2] for row in found] == ["seated", "upright"]
    assert found[0][1] in {"08:01:58", "08:01:59", "08:02:00", "08:02:01"}


def test_on_the_arm_the_same_files_are_refused() -> None:
    with pytest.raises(NoGyroscope) as refusal:
        read_recording(io.BytesIO(write_table(simulate_thigh())), file_name="arm.csv")
    assert refusal.value.code == "E-NO-GYRO"


def test_an_axis_across_the_thigh_is_refused() -> None:
    with pytest.raises(UnusableDiary) as refusal:
        describe(write_table(simulate_thigh()[:, [1, 0, 2]]))
    assert refusal.value.facts["why"] == "thigh axis"


def test_a_recording_without_a_clock_is_refused() -> None:
    rows = "".join(
        f"{k / RATE_HZ:.2f},{x:.4f},{y:.4f},{z:.4f}\n" for k, (x, y, z) in enumerate(simulate_thigh())
    )

    with pytest.raises(UnusableDiary) as refusal:
        describe(f"time_s,acc_x,acc_y,acc_z\n{rows}".encode())
    assert refusal.value.facts["why"] == "thigh clock"


def test_time_off_the_leg_has_no_posture() -> None:
    lying = np.tile([0.0, 0.0, 1.0], (91 * 60 * RATE_HZ, 1))

    found = describe(write_table(np.concatenate([simulate_thigh(), lying])))

    assert [row[2] for row in found] == ["seated", "upright"]
    assert found[-1][1] <= "08:04:35"


def test_the_file_of_postures_may_be_a_recording(tmp_path: Path) -> None:
    (tmp_path / "thigh.csv").write_bytes(write_table(simulate_thigh()))

    assert [row.label for row in read_postures(tmp_path / "thigh.csv")] == ["seated", "upright"]
