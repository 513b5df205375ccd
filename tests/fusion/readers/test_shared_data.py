"""Every file of the shared data: read, or refused for the right reason."""

from collections.abc import Callable
from pathlib import Path

import pytest

from acromion.fusion.errors import FusionError
from acromion.fusion.readers import read_recording

SharedData = Callable[[str], Path]
READ = {
    "gt9x/link_imu_100hz_179s.gt3x": ("gt9x", 100.09, 179.0, 17_916),
    "gt9x/link_imu_100hz_179s_actilife.csv": ("gt9x", 100.0, 179.0, 17_900),
    "gt9x/link_imu_23s_excel_resaved.csv": ("gt9x", 100.0, 23.0, 2_300),
    "lsm9ds1/arduino_nano_hori.csv": ("lsm9ds1", 119.0, 98.0, 11_662),
    "lsm9ds1/calib1.dat": ("lsm9ds1", 14.54, 245.0, 3_556),
    "xsens/MT_012005D6_031-000_00B421AF.txt": ("mtw", 100.0, 33.69, 3_369),
    "other_layouts/xio3_microseconds.csv": ("x-imu3", 49.91, 10.0, 500),
    "other_layouts/xio_seconds_dps_g.csv": ("ngimu", 100.0, 135.3, 13_534),
}
"""Device, rate in Hz, seconds, rows (in the last file 20 of them bridged)."""
REFUSED = {
    "calibration/example_ferraris_session.csv": "E-RATE",
    "lsm9ds1/abc.dat": "E-UNIT",
    "lsm9ds1/noise1.dat": "E-UNIT",
    "lsm9ds1/stationary1.dat": "E-UNIT",
    "lsm9ds1/stroke1.dat": "E-SHORT",
    "other_layouts/pololu_raw_ms.txt": "E-COLS",
    "refuse/actilife_1s_counts.csv": "E-EPOCH",
    "refuse/actilife_raw_accelerometer_only.csv": "E-NO-GYRO",
    "upper_arm/full_body_example_data.mat": "E-TYPE",
    "xsens/MT2022_ACC_00B42D4B.txt": "E-NO-GYRO",
    "xsens/MT2022_ACC_GYRO_ROT_MAT_SPACE_00B42D4B.txt": "E-RATE",
    "xsens/dot_pelvis.csv": "E-COLS",
    "xsens/test_mocap.mvnx": "E-TYPE",
}


def refuse(path: Path) -> FusionError:
    with pytest.raises(FusionError) as refusal:
        read_recording(path)
    return refusal.value


@pytest.mark.real_recordings
@pytest.mark.parametrize("name", READ)
def test_a_recording_is_read(name: str, shared_data: SharedData) -> None:
    recording = read_recording(shared_data(name))

    device, rate_hz, recorded_s, rows = READ[name]
    assert (recording.device, sum(map(len, recording.segments))) == (device, rows)
    assert recording.rate_hz == pytest.approx(rate_hz, abs=0.01)
    assert recording.duration_us / 1e6 == pytest.approx(recorded_s, abs=0.06)


@pytest.mark.real_recordings
@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_recording_is_refused_for_its_reason(name: str, shared_data: SharedData) -> None:
    assert refuse(shared_data(name)).code == REFUSED[name]


@pytest.mark.real_recordings
@pytest.mark.parametrize(
    "form", ["ALL_TAB_NAN_00B42D4B", "EULER_TAB_00B42D4F", "MAT_COMMA_00B42D4B", "MAT_SEMICOLON_00B42D4B"]
)
def test_packets_of_mt_manager_without_a_rate_want_one(form: str, shared_data: SharedData) -> None:
    path = shared_data(f"xsens/MT2022_ACC_GYRO_ROT_{form}.txt")

    assert refuse(path).code == "E-RATE"
    assert read_recording(path, rate_hz=100.0).understood["angular_rate_unit"] == "rad/s"


@pytest.mark.real_recordings
@pytest.mark.parametrize(("files", "kind"), [("broad/*.npz", "NumPy (.npz)"), ("*/LICENSE*.txt", "text")])
def test_numpy_archives_and_licences_are_called_what_they_are(
    files: str, kind: str, shared_data: SharedData
) -> None:
    folder = shared_data("gt9x").parent

    refusals = [refuse(path) for path in sorted(folder.glob(files))]

    assert {(refusal.code, refusal.facts["kind"]) for refusal in refusals} == {("E-TYPE", kind)}
