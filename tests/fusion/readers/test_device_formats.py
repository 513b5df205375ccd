"""Which files are a device's own, so that they are no motion capture."""

import io

import pytest

from acromion.fusion.readers import holds_device_format
from tests.badfiles.gt3x_files import LOG, pack
from tests.badfiles.table_files import actilife, canon
from tests.fusion.readers.cwa.cwa_builder import log_of


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (pack(LOG), True),
        (actilife().encode(), True),
        (log_of(range(50)), True),
        (canon().encode(), True),
        (b"time_s,ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps\n" + b"1,0,0,0,0,0,0\n" * 2000, False),
        (b"PacketCounter,SampleTimeFine,Quat_W,Quat_X,Quat_Y,Quat_Z\n" + b"1,0,0,0,0,0\n" * 2000, False),
        (b'<?xml version="1.0"?>\n<mvnx version="4">\n', False),
    ],
    ids=["gt3x", "ActiLife", "cwa", "our own table", "another table", "Xsens", "MVNX"],
)
def test_a_devices_own_format_is_told_from_a_table_that_may_hold_anything(
    content: bytes, expected: bool
) -> None:
    file = io.BytesIO(content)

    assert holds_device_format(file) is expected
    assert file.tell() == 0
