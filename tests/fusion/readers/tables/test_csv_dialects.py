"""Every way of writing the same table is read alike; units and columns are found."""

from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from acromion.fusion.errors import FusionError, NoSamples
from acromion.fusion.readers import read_recording
from acromion.fusion.readers.tables.columns import choose_vector
from acromion.fusion.readers.tables.layout import find_layout
from tests.fusion.readers.tables.table_builder import CANON, HEADER, line, read_text


@pytest.mark.parametrize(
    "header",
    [
        "t,ax,ay,az,gx,gy,gz",
        "Time,aX,aY,aZ,gX,gY,gZ",
        "timestamp,acc_x,acc_y,acc_z,gyro_x,gyro_y,gyro_z",
        "millis,AccX,AccY,AccZ,GyroX,GyroY,GyroZ",
        "Time [ms],Accelerometer X,Accelerometer Y,Accelerometer Z,Gyroscope X,Gyroscope Y,Gyroscope Z",
        '"ts","accel.x","accel.y","accel.z","gyr.x","gyr.y","gyr.z"',
        "time_ms,imu_acc_x_g,imu_acc_y_g,imu_acc_z_g,imu_gyr_x_dps,imu_gyr_y_dps,imu_gyr_z_dps",
    ],
)
def test_column_names_of_the_wild_are_understood(header: str) -> None:
    layout = find_layout(header + "\n" + "".join(f"{10 * k},{line(k)}\n" for k in range(900)))

    assert layout is not None
    assert layout.columns[0].channel == "time"
    assert choose_vector(layout.columns, "acc") == (1, 2, 3)
    assert choose_vector(layout.columns, "gyr") == (4, 5, 6)


FRENCH = "Accéléromètre X (g);Accéléromètre Y (g);Accéléromètre Z (g)"


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252"])
@pytest.mark.parametrize(
    "header",
    [
        f"Horodatage (ms);{FRENCH};Gyroscope X (°/s);Gyroscope Y (°/s);Gyroscope Z (°/s)",
        f"Temps [millisecondes];{FRENCH};Gyromètre X (°/s);Gyromètre Y (°/s);Gyromètre Z (°/s)",
        "Temps (ms);Accél. X (g);Accél. Y (g);Accél. Z (g);"
        + ";".join(f"Vitesse angulaire axe {axis} (degrés/s)" for axis in "XYZ"),
    ],
)
def test_french_names_with_accents_and_units_are_understood(header: str, encoding: str) -> None:
    rows = "".join(f"{10 * k};{line(k).replace(',', ';').replace('.', ',')}\n" for k in range(900))

    recording = read_text((header + "\n" + rows).encode(encoding))

    units = (recording.understood["acceleration_unit"], recording.understood["angular_rate_unit"])
    assert recording.segments[0].gyr_dps[7].tolist() == [0.5, -0.25, 7.5]
    assert recording.duration_us == 9_000_000
    assert units in {("g", "deg/s"), ("g", "degres/s")}


def test_columns_in_another_order_with_strangers_between_are_found() -> None:
    header = "temp_c,gyr_z_dps,gyr_y_dps,gyr_x_dps,mag_x,acc_z_g,acc_y_g,acc_x_g,time_ms"
    text = header + "\n" + "".join(f"21.5,3,2,1,99,1,0.02,0.01,{10 * k}\n" for k in range(900))

    recording = read_text(text)

    assert recording.segments[0].acc_g[0] == pytest.approx([0.01, 0.02, 1.0])
    assert recording.segments[0].gyr_dps[0].tolist() == [1.0, 2.0, 3.0]
    assert recording.understood["ignored"] == "temp_c, mag_x"


@pytest.mark.parametrize(
    ("acc_unit", "gyr_unit", "acc_factor", "gyr_factor"),
    [
        ("m/s^2", "rad/s", 9.80665, np.pi / 180),
        ("m/s²", "°/s", 9.80665, 1.0),
        ("mg", "mdps", 1000.0, 1000.0),
        ("cm/s^2", "dps", 980.665, 1.0),
        ("m_per_s2", "deg_per_s", 9.80665, 1.0),
    ],
)
def test_stated_units_are_converted(
    acc_unit: str, gyr_unit: str, acc_factor: float, gyr_factor: float
) -> None:
    names = [f"acc {a} ({acc_unit})" for a in "xyz"] + [f"gyr {a} ({gyr_unit})" for a in "xyz"]
    row = f"0,0,{acc_factor:.6f},{90 * gyr_factor:.6f},0,0"
    text = ",".join(["time (s)", *names]) + "\n" + "".join(f"{k / 100:.2f},{row}\n" for k in range(900))

    recording = read_text(text)

    assert recording.segments[0].acc_g[0, 2] == pytest.approx(1.0, abs=1e-5)
    assert recording.segments[0].gyr_dps[0, 0] == pytest.approx(90.0, abs=1e-3)


DRESSES = {
    "padded": CANON.replace(",", ", "),
    "spaces": CANON.replace(",", " "),
    "empty ends": CANON.replace("\n", ",,,\n"),
    "quoted": "".join(",".join(f'"{f}"' for f in row.split(",")) + "\n" for row in CANON.split("\n")[:-1]),
    "no last newline": CANON.rstrip("\n"),
}


@pytest.mark.parametrize("dress", DRESSES)
def test_every_dress_of_the_same_table_gives_the_same_samples(dress: str) -> None:
    expected = read_text(CANON).segments[0]

    (segment,) = read_text(DRESSES[dress]).segments

    assert np.array_equal(segment.acc_g, expected.acc_g)
    assert np.array_equal(segment.gyr_dps, expected.gyr_dps)


def test_seconds_and_microseconds_in_two_columns_cost_no_time() -> None:
    header = "sec,usec," + HEADER.split(",", 1)[1]
    rows = [f"{183 + k // 100},{k % 100 * 10_000},{line(k)}" for k in range(900)]

    recording = read_text("\n".join([header, *rows, ""]))

    assert (recording.duration_us, len(recording.segments)) == (9_000_000, 1)


def test_a_head_of_single_spaces_without_a_whole_row_is_not_understood() -> None:
    """Found by the fuzz: the only row is none once its spaces are tabs."""
    names = "PacketCounter SampleTimeFine Acc_X Acc_Y Acc_Z Gyr_X Gyr_Y Gyr_Z"
    text = f"Update Rate: 100.0Hz\n{names}\n6\r500  0.1 0.9 0.1 0.9 -1.9 3.0\n"

    with pytest.raises(FusionError):
        read_text(text)


# ActiLife exports, and the registers of an LSM9DS1.

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


@pytest.mark.parametrize(
    ("date", "start"), [("14/2/2019", START), ("2/14/2019", None)], ids=["right", "contradicts its format"]
)
def test_without_timestamps_the_header_tells_start_and_rate(date: str, start: datetime | None) -> None:
    recording = read_text(
        ACTILIFE.replace("14/2/2019", date) + IMU_COLUMNS + "".join(actilife_row(k) for k in range(2000))
    )

    assert recording.start == start
    assert recording.duration_us == 20_000_000
    assert recording.rate_hz == 100.0


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
