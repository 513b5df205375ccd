"""Files whose angle needs no fusion of ours: formats, the arm's axis, and what is refused."""

import io
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from acromion.fusion.angle_files import (
    AngleFile,
    AngleFileOptions,
    calibrate_alone,
    calibrate_file,
    holds_samples,
    read_angle_file,
)
from acromion.fusion.errors import (
    FusionError,
    MissingSegment,
    RefusedXml,
    UnknownAxis,
    UnknownRate,
    UnusableTime,
    WrongAngle,
)
from acromion.fusion.readers import read_recording
from tests.factories import hold
from tests.simulated_mvnx import write_mvnx

FRAMES = '<frame type="normal" time="0" index="0"><position>0 0 1.4 {elbow}</position></frame>'


def read(text: str | bytes, **options: object) -> AngleFile:
    body = text.encode() if isinstance(text, str) else text
    return read_angle_file(io.BytesIO(body), options=AngleFileOptions(**options))  # type: ignore[arg-type]


def mvnx(frames: str, head: str = "") -> str:
    segments = '<segment label="RightUpperArm"/><segment label="RightForeArm"/>'
    subject = f'<subject frameRate="60"><segments>{segments}</segments><frames>{frames}</frames></subject>'
    return f"{head}<mvnx>{subject}</mvnx>"


@pytest.mark.parametrize("side", ["left", "right"])
def test_what_is_written_as_mvnx_is_read_again(tmp_path: Path, side: str) -> None:
    angles = np.array([0.0, 30.0, 90.0, 135.0, 180.0])
    path = write_mvnx(tmp_path / "arm.mvnx", angles, 60.0, side)

    with path.open("rb") as file:
        read_back = read_angle_file(file, options=AngleFileOptions(side))

    assert read_back.elevation_deg == pytest.approx(angles, abs=1e-3)


def test_frames_of_mvnx_are_timed_by_their_number() -> None:
    orientation = "<orientation>1 0 0 0 1 0 0 0</orientation>"
    frames = "".join(
        f'<frame type="normal" time="{t}" index="{k}">{orientation}</frame>' for k, t in ((3, 50), (6, 100))
    )

    assert read(mvnx(frames)).time_s.tolist() == [0.0, 0.05]


@pytest.mark.parametrize(("elbow", "angle_deg"), [("0.2 0 1.2", 45.0), ("0 0 1.1", 0.0)])
def test_without_orientation_the_joints_tell_the_angle_of_an_assumed_arm(
    elbow: str, angle_deg: float
) -> None:
    file = read(mvnx(FRAMES.format(elbow=elbow)))

    assert file.elevation_deg == pytest.approx([angle_deg], abs=1e-3)
    assert [flag.code for flag in file.flags] == ["W-SIDE-ASSUMED"]


def test_an_mvnx_without_upper_arm_is_refused_by_name() -> None:
    with pytest.raises(MissingSegment) as refusal:
        read(mvnx('<frame type="normal" time="0" index="0"/>').replace("RightUpperArm", "Pelvis"))

    assert refusal.value.facts == {"segment": "RightUpperArm"}


@pytest.mark.parametrize(
    ("head", "cut", "reason"),
    [
        ("<!DOCTYPE mvnx>", None, "forbidden"),
        ('<!DOCTYPE mvnx [<!ENTITY a "b">]>', None, "forbidden"),
        ('<!DOCTYPE mvnx SYSTEM "http://127.0.0.1:9/x.dtd">', None, "forbidden"),
        ('<!DOCTYPE mvnx [<!ENTITY a SYSTEM "file:///etc/passwd">]>', None, "forbidden"),
        ("", -20, "broken"),
    ],
    ids=["document type", "internal entity", "external DTD", "external entity", "cut"],
)
def test_a_document_type_and_a_cut_mvnx_are_refused(head: str, cut: int | None, reason: str) -> None:
    with pytest.raises(RefusedXml) as refusal:
        read(mvnx(FRAMES.format(elbow="0 0 1"), head)[:cut])

    assert refusal.value.facts == {"reason": reason}


def test_a_csv_of_angles_keeps_its_own_clock_and_its_holes() -> None:
    file = read("time_s,elevation_deg\n5.0,10\n5.1,\n5.2,30\n")

    assert (file.time_s.tolist(), file.first_s) == ([5.0, 5.2], 5.0)


@pytest.mark.parametrize(
    "text", ["Temps;Angle\n0,0;10,5\n0,1;11,5\n", "time_ms,angle\n0,10.5\n100,11.5\n"], ids=["commas", "ms"]
)
def test_decimal_commas_and_milliseconds_are_read(text: str) -> None:
    file = read(text)

    assert file.time_s.tolist() == [0.0, 0.1]
    assert file.elevation_deg == pytest.approx([10.5, 11.5])


# Hanging, then turned by 60 deg about x: half angles 0 and 30 deg.
TURNED = "time,qw,qx,qy,qz\n0,1,0,0,0\n1,0.8660254,0.5,0,0\n"


def test_a_quaternion_needs_a_pose() -> None:
    file = read(TURNED)

    assert file.elevation_deg is None
    assert calibrate_file(file, (0.0, 0.5)).elevation_deg == pytest.approx([0.0, 60.0], abs=1e-4)


def test_a_pose_in_which_the_sensor_turned_is_refused() -> None:
    with pytest.raises(UnknownAxis):
        calibrate_file(read(TURNED), (0.0, 1.0))


@pytest.mark.parametrize(
    ("text", "refusal"),
    [
        ("time,angle\n0,1\n1,200\n", WrongAngle),
        ("time,angle\n1,1\n0,2\n", UnusableTime),
        ("// MT Manager version: 2022.2.0\nPacketCounter\tRoll\tPitch\n1\t0\t0\n2\t0\t0\n", UnknownRate),
    ],
)
def test_an_impossible_angle_or_time_and_an_unknown_rate_are_refused(
    text: str, refusal: type[FusionError]
) -> None:
    with pytest.raises(refusal):
        read(text)


def test_our_own_parquet_loses_what_is_not_valid() -> None:
    body = io.BytesIO()
    columns = {"time_s": [0.0, 0.1, 0.2], "elevation_deg": [1.0, 2.0, 3.0], "valid": [True, False, True]}
    pq.write_table(pa.table(columns), body)

    assert read(body.getvalue()).time_s.tolist() == [0.0, 0.2]


def test_a_counter_of_16_bits_may_start_over() -> None:
    rows = "65534\t0\t0\n65535\t0\t0\n0\t0\t0\n"
    file = read(f"// Update Rate: 100.0Hz\nPacketCounter\tRoll\tPitch\n{rows}")

    assert file.time_s == pytest.approx([0.0, 0.01, 0.02])


@pytest.mark.real_recordings
@pytest.mark.parametrize(
    "name", ["MAT_COMMA_00B42D4B", "MAT_SEMICOLON_00B42D4B", "MAT_SPACE_00B42D4B", "ALL_TAB_NAN_00B42D4B"]
)
def test_mt_manager_is_read_with_every_separator(name: str, shared_data: Callable[[str], Path]) -> None:
    with shared_data(f"xsens/MT2022_ACC_GYRO_ROT_{name}.txt").open("rb") as file:
        read_file = read_angle_file(file, options=AngleFileOptions(rate_hz=100.0))

    assert read_file.up is not None
    # At rest the sensor's z axis points up; the file's own third row of the matrix.
    assert read_file.up[0].tolist() == pytest.approx([0.010301, -0.000639, 0.999947], abs=2e-6)


@pytest.mark.real_recordings
def test_matrix_quaternion_and_euler_angles_of_one_row_agree(shared_data: Callable[[str], Path]) -> None:
    whole = shared_data("xsens/MT2022_ACC_GYRO_ROT_ALL_TAB_NAN_00B42D4B.txt").read_text()
    hidden = [whole, whole.replace("Mat[3]", "X"), whole.replace("Mat[3]", "X").replace("Quat", "Y")]

    ups = [read(text, rate_hz=100.0).up for text in hidden]

    assert ups[1] == pytest.approx(ups[0], abs=1e-5)
    assert ups[2] == pytest.approx(ups[0], abs=1e-5)


@pytest.mark.real_recordings
def test_mt_manager_4_tells_its_rate(shared_data: Callable[[str], Path]) -> None:
    with shared_data("xsens/MT_012005D6_031-000_00B421AF.txt").open("rb") as file:
        read_file = read_angle_file(file)

    # Counters 3583 to 6951 at 100 Hz.
    assert len(read_file.time_s) == 3369
    assert read_file.last_s == pytest.approx(33.68)


@pytest.mark.real_recordings
def test_dot_is_read_with_its_clock(shared_data: Callable[[str], Path]) -> None:
    with shared_data("xsens/dot_pelvis.csv").open("rb") as file:
        read_file = read_angle_file(file)

    assert read_file.last_s == pytest.approx((3349778012 - 3343427885) / 1e6)
    assert read_file.start is not None
    assert read_file.start.isoformat() == "2021-08-20T20:21:13.835000+08:00"


@pytest.mark.real_recordings
@pytest.mark.parametrize("side", ["left", "right"])
def test_a_real_mvnx_is_level_in_its_t_pose_and_orientation_and_joint_positions_agree(
    side: str, shared_data: Callable[[str], Path]
) -> None:
    text = shared_data("xsens/test_mocap.mvnx").read_text()
    only_positions = text.replace("<orientation>", "<left_out>").replace("</orientation>", "</left_out>")

    by_orientation, by_position = read(text, side=side), read(only_positions, side=side)

    assert float(by_orientation.understood["t_pose_elevation_deg"]) == pytest.approx(90.0, abs=1.0)
    assert by_position.elevation_deg == pytest.approx(by_orientation.elevation_deg, abs=0.1)


def test_an_orientation_alone_is_calibrated_where_it_first_holds_still() -> None:
    rows = "".join(
        f"{k / 10},{np.cos(a)},{np.sin(a)},0,0\n" for k in range(60) for a in (max(0, k - 30) * 0.01,)
    )

    calibrated = calibrate_alone(read(f"time,qw,qx,qy,qz\n{rows}"), ())

    # The last row is turned by 2 * 0.29 rad.
    assert calibrated.elevation_deg is not None
    assert calibrated.elevation_deg[-1] == pytest.approx(np.degrees(0.58), abs=0.01)


def write_dot(columns: str, rows: str) -> bytes:
    return f"sep=,\nDeviceTag:,one\nOutputRate:,60Hz\n\n{columns}\n{rows}".encode()


@pytest.mark.parametrize("samples", ["Acc_X,Acc_Y,Acc_Z,Gyr_X,Gyr_Y,Gyr_Z", ""])
def test_a_dot_file_is_to_be_fused_if_it_has_samples(samples: str) -> None:
    columns = f"PacketCounter,SampleTimeFine,Quat_W,Quat_X,Quat_Y,Quat_Z,{samples}".rstrip(",")

    assert holds_samples(io.BytesIO(write_dot(columns, ""))) is bool(samples)


def test_a_dot_recording_is_named_as_one() -> None:
    made = hold((0, 10), (60, 10), rate_hz=60).recording.segments[0]
    noise = np.random.default_rng(1).normal(0, 0.02, (len(made), 6))
    samples = np.hstack([made.acc_g * 9.80665, made.gyr_dps]) + noise
    rows = "".join(f"{k},{k * 16667}," + ",".join(map(str, row)) + "\n" for k, row in enumerate(samples))
    columns = "PacketCounter,SampleTimeFine,Acc_X,Acc_Y,Acc_Z,Gyr_X,Gyr_Y,Gyr_Z"

    recording = read_recording(io.BytesIO(write_dot(columns, rows)))

    assert (recording.device, round(recording.rate_hz)) == ("dot", 60)
