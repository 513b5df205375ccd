"""ActiLife exports, and the registers of an LSM9DS1."""

from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from fusion.errors import NoSamples
from fusion.readers import read_recording
from tests.fusion.readers.tables.table_builder import read_text

SharedData = Callable[[str], Path]
START = datetime(2019, 2, 14, 8, 58, tzinfo=UTC).replace(tzinfo=None)

ACTILIFE = (
    "------------ Data File Created By ActiGraph Link IMU 9DOF Sensor ActiLife v6.13.3 Firmware v1.7.2 "
    "date format d/M/yyyy at 100 Hz  -----------\nSerial Number: TAS1E00000001\nStart Time 08:58:00\n"
    "Start Date 14/2/2019\nEpoch Period (hh:mm:ss) 00:00:00\nDownload Time 09:03:03\n"
    "Download Date 14/2/2019\n"
    "Current Memory Address: 0\nCurrent Battery Voltage: 4.15     Mode = 12\n"
    "--------------------------------------------------\n"
)
IMU_COLUMNS = (
    "Accelerometer X,Accelerometer Y,Accelerometer Z,Temperature,Gyroscope X,Gyroscope Y,Gyroscope Z,"
    "Magnetometer X,Magnetometer Y,Magnetometer Z\n"
)


def actilife_row(k: int) -> str:
    twitch = int(k % 7 == 3)
    acc = f"{0.001 * (k % 3):.6f},0.00{twitch},1.00{twitch}"
    return f"{acc},54.7,{k % 50}.500000,0.1{twitch},0.2{twitch},1,2,3\n"


def test_an_actilife_export_with_timestamps_is_read() -> None:
    rows = "".join(
        f"2019-02-14T08:{58 + k // 6000:02d}:{k // 100 % 60:02d}.{k % 100:02d}00000,{actilife_row(k)}"
        for k in range(7000)
    )

    recording = read_text(ACTILIFE + "Timestamp," + IMU_COLUMNS + rows)

    assert recording.device == "gt9x"
    assert recording.start == START
    assert recording.duration_us == 70_000_000
    assert recording.segments[0].gyr_dps[7, 0] == 7.5
    assert recording.flags == ()


@pytest.mark.parametrize("stated_hz", [0, 30])
def test_a_rate_in_the_header_that_the_rows_contradict_is_said_and_not_believed(stated_hz: int) -> None:
    header = ACTILIFE.replace("at 100 Hz", f"at {stated_hz} Hz") + "Timestamp," + IMU_COLUMNS
    rows = (f"2019-02-14T08:58:{k // 100:02d}.{k % 100:02d}00000,{actilife_row(k)}" for k in range(2000))

    recording = read_text(header + "".join(rows))

    (flag,) = recording.flags
    assert (flag.code, flag.facts) == ("W-DRIFT", {"nominal_hz": float(stated_hz), "rate_hz": 100.0})


def test_without_timestamps_the_header_tells_start_and_rate() -> None:
    recording = read_text(ACTILIFE + IMU_COLUMNS + "".join(actilife_row(k) for k in range(2000)))

    assert recording.start == START
    assert recording.duration_us == 20_000_000
    assert recording.rate_hz == 100.0


def test_a_date_that_contradicts_its_format_gives_no_start() -> None:
    header = ACTILIFE.replace("14/2/2019", "2/14/2019")

    recording = read_text(header + IMU_COLUMNS + "".join(actilife_row(k) for k in range(2000)))

    assert recording.start is None


def test_an_export_without_rows_has_no_samples() -> None:
    with pytest.raises(NoSamples):
        read_text(ACTILIFE + IMU_COLUMNS)


@pytest.mark.real_recordings
def test_the_left_handed_registers_come_out_right_handed(shared_data: SharedData) -> None:
    recording = read_recording(shared_data("lsm9ds1/calib1.dat"))

    slopes = [
        (np.gradient(s.acc_g, 1 / s.rate_hz, axis=0), np.cross(s.acc_g, np.radians(s.gyr_dps)))
        for s in recording.segments
        if len(s) > 2
    ]
    seen, expected = (np.concatenate([pair[k].ravel() for pair in slopes]) for k in (0, 1))
    assert np.corrcoef(seen, expected)[0, 1] > 0.7
