"""Which files are a device's own, so that they are no motion capture."""

from pathlib import Path

import pytest

from fusion.readers import holds_device_format
from fusion.simulation import write_recordings


def make_table(folder: Path, header: str) -> Path:
    path = folder / "table.csv"
    path.write_text(header + "\n" + 2000 * ("1" + 8 * ",0" + "\n"), "utf-8")
    return path


@pytest.mark.parametrize(
    ("first_lines", "expected"),
    [
        ("time_us,acc_x_g,acc_y_g,acc_z_g,gyr_x_dps,gyr_y_dps,gyr_z_dps", True),
        ("time_s,ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps", False),
        ("PacketCounter,SampleTimeFine,Quat_W,Quat_X,Quat_Y,Quat_Z", False),
        ('<?xml version="1.0"?>\n<mvnx version="4">', False),
    ],
)
def test_tables_whose_header_only_names_columns_may_hold_anything(
    tmp_path: Path, first_lines: str, expected: bool
) -> None:
    with make_table(tmp_path, first_lines).open("rb") as file:
        assert holds_device_format(file) is expected
        assert file.tell() == 0


def test_both_files_of_the_link_are_a_devices_own(tmp_path: Path) -> None:
    for path in write_recordings(tmp_path, "gt9x", 0.05, 1)[:2]:
        with path.open("rb") as file:
            assert holds_device_format(file)
