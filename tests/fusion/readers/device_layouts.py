"""Layouts of known devices, made of one motion."""

import io
import zipfile
from collections.abc import Callable, Iterable
from datetime import UTC, datetime

import numpy as np

from acromion.fusion.recording import DEG_PER_RAD, STANDARD_GRAVITY
from tests.fusion.made_motion import tumble

RATE_HZ = 100.0
MOTION = tumble(30.0, RATE_HZ, seed=3)
NOISE = np.random.default_rng(5)
ACC_G = (MOTION.acc_g + NOISE.normal(0.0, 0.002, MOTION.acc_g.shape)).round(6)
GYR_DPS = (MOTION.gyr_dps + NOISE.normal(0.0, 0.1, MOTION.gyr_dps.shape)).round(5)
TIME_S = np.arange(len(ACC_G)) / RATE_HZ
START_S = 1_772_438_280
ACC_MS2, GYR_RAD = ACC_G * STANDARD_GRAVITY, GYR_DPS / DEG_PER_RAD


def rows(*columns: np.ndarray | Iterable[str], mark: str = ",", form: str = "%.8f") -> str:
    fields = [
        [form % value for value in column] if isinstance(column, np.ndarray) else list(column)
        for part in columns
        for column in (part.T if isinstance(part, np.ndarray) and part.ndim == 2 else [part])
    ]
    return "".join(mark.join(row) + "\n" for row in zip(*fields, strict=True))


def axes(form: str) -> list[str]:
    return [form.format(axis) for axis in "XYZ"]


def shimmer() -> str:
    names = ["Timestamp_Unix_CAL", *axes("Accel_WR_{}_CAL"), *axes("Gyro_{}_CAL")]
    header = "\t".join(f"Shimmer_8D4F_{name}" for name in names)
    units = "\t".join(["ms", *["m/(s^2)"] * 3, *["deg/s"] * 3])
    table = rows((START_S + TIME_S) * 1e3, ACC_MS2, GYR_DPS, mark="\t")
    return f'"sep=\t"\n{header}\t\n{units}\t\n{table}'


def shimmer_of_four_lines() -> str:
    sensor = "\t".join(["Arm_R"] * 7)
    names = "\t".join(["Timestamp", *axes("Gyroscope {}"), *axes("Wide Range Accelerometer {}")])
    units = "\t".join(["mSecs", *["deg/sec"] * 3, *["m/(sec^2)"] * 3])
    return (
        "\n".join([sensor, names, "\t".join(["CAL"] * 7), units])
        + "\n"
        + rows(TIME_S * 1e3, GYR_DPS, ACC_MS2, mark="\t")
    )


def witmotion() -> str:
    names = [
        *["time", "DeviceName"],
        *axes("Acceleration {}(g)"),
        *axes("Angular velocity {}(°/s)"),
        *axes("Angle {}(°)"),
    ]
    clock = [datetime.fromtimestamp(START_S + t, UTC).strftime("%Y-%m-%d %H:%M:%S.%f")[:-3] for t in TIME_S]
    return (
        "\t".join(names)
        + "\n"
        + rows(clock, ["WT901(f1)"] * len(TIME_S), ACC_G, GYR_DPS, np.ones((len(TIME_S), 3)), mark="\t")
    )


def serial_print() -> str:
    named = [f"t_ms: {1000 * t:.0f}" for t in TIME_S]
    parts = [
        [f"{name}: {value:.6f}" for value in values]
        for name, values in zip(
            ["ax (g)", "ay (g)", "az (g)", "gx (dps)", "gy (dps)", "gz (dps)"],
            (*ACC_G.T, *GYR_DPS.T),
            strict=True,
        )
    ]
    return rows(named, *parts, mark=" ")


def serial_monitor() -> str:
    clock = [f"07:58:{t:06.3f} ->" for t in TIME_S]
    parts = [
        [f"{name}:{value:.6f}" for value in values]
        for name, values in zip(["ax", "ay", "az", "gx", "gy", "gz"], (*ACC_MS2.T, *GYR_RAD.T), strict=True)
    ]
    return rows(clock, *parts, mark=" ")


def excel_days() -> str:
    days = 25_569 + (START_S + TIME_S) / 86_400
    names = ["Time", *axes("Accel_{} (g)"), *axes("Gyro_{} (deg/s)")]
    return ";".join(names) + "\n" + rows(days, ACC_G, GYR_DPS, mark=";", form="%.10f").replace(".", ",")


def picoquake() -> str:
    above = "# PLab PicoQuake Data\n# Config: data_rate = 100.0 Hz, filter = 42 Hz, acc_range = 4 g\n"
    count = [str(k) for k in range(len(TIME_S))]
    return above + "count,a_x,a_y,a_z,g_x,g_y,g_z\n" + rows(count, ACC_G, GYR_DPS)


def mt_manager() -> str:
    names = "\t".join(["PacketCounter", *axes("Acc_{}"), *axes("Gyr_{}"), "Roll", "Pitch", "Yaw"])
    counter = [f"{k:05d}" for k in range(len(TIME_S))]
    table = rows(counter, ACC_MS2, GYR_RAD, np.zeros((len(TIME_S), 3)), mark="\t")
    return f"// Start Time: Unknown\n// Update Rate: 100.0Hz\n{names}\n{table}"


def movella_dot() -> str:
    names = ",".join(["PacketCounter", "SampleTimeFine", *axes("Acc_{}"), *axes("Gyr_{}")])
    counter, fine = [str(k) for k in range(len(TIME_S))], [f"{1e6 * t:.0f}" for t in TIME_S]
    return f"sep=,\nDeviceTag:,Arm\nOutputRate:,100Hz\n\n{names}\n" + rows(counter, fine, ACC_MS2, GYR_DPS)


def pack(**members: str) -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in members.items():
            archive.writestr(name.replace("__", "/") + ".csv", text)
    return packed.getvalue()


def phyphox() -> bytes:
    def table(unit: str, values: np.ndarray) -> str:
        return (
            ",".join(f'"{name}"' for name in ["Time (s)", *(f"{a} ({unit})" for a in "XYZ")])
            + "\n"
            + rows(TIME_S, values, form="%.9E")
        )

    clock = f'"event","experiment time","system time","system time text"\n"START",0.0,{START_S}.0,"x"\n'
    return pack(
        Accelerometer=table("m/s^2", ACC_MS2),
        Gyroscope=table("rad/s", GYR_RAD),
        meta__time=clock,
        meta__device="a",
    )


def sensor_logger(names: tuple[str, ...] = ("TotalAcceleration", "Accelerometer", "Gravity")) -> bytes:
    gravity = np.tile([0.0, 0.0, STANDARD_GRAVITY], (len(TIME_S), 1))
    stamps = [f"{START_S * 10**9 + round(t * 1e9)}" for t in TIME_S]
    values = {"TotalAcceleration": ACC_MS2, "Accelerometer": ACC_MS2 - gravity, "Gravity": gravity}
    tables = {name: values[name] for name in names} | {"Gyroscope": GYR_RAD}
    return pack(
        **{
            name: "time,seconds_elapsed,z,y,x\n" + rows(stamps, TIME_S, table[:, ::-1])
            for name, table in tables.items()
        },
        Metadata="version,device name\n3,phone\n",
    )


def metawear() -> bytes:
    def table(unit: str, values: np.ndarray) -> str:
        epoch = [f"{1000 * (START_S + t):.0f}" for t in TIME_S]
        words = ["2026-03-02T07.58.00.000"] * len(TIME_S)
        names = ["epoc (ms)", "timestamp (+0100)", "elapsed (s)", *(f"{a}-axis ({unit})" for a in "xyz")]
        return ",".join(names) + "\n" + rows(epoch, words, TIME_S, values)

    return pack(
        arm_2026_C8A5_Accelerometer_100=table("g", ACC_G), arm_2026_C8A5_Gyroscope_100=table("deg/s", GYR_DPS)
    )


def open_log() -> str:
    """Write date and time in two columns, as OpenLog Artemis does."""
    clock = [datetime.fromtimestamp(START_S + 23 * 86_400 + t, UTC) for t in TIME_S]
    dates, times = ([f"{one:{form}}" for one in clock] for form in ("%m/%d/%Y", "%H:%M:%S.%f"))
    names = ["rtcDate", "rtcTime", *(f"{name}{unit}" for name, unit in NAMES_AND_UNITS)]
    return ",".join(names) + ",\n" + rows(dates, times, ACC_G, GYR_DPS)


NAMES_AND_UNITS = [*((f"a{axis}", " (g)") for axis in "XYZ"), *((f"g{axis}", " (dps)") for axis in "XYZ")]


def monitored_table() -> str:
    """Write a table with the time of a serial monitor before each line."""
    header = ",".join(f"{name}{unit}" for name, unit in NAMES_AND_UNITS)
    table = rows(ACC_G, GYR_DPS).splitlines()
    lines = (f"07:58:{t:06.3f} -> {row}\n" for t, row in zip(TIME_S, table, strict=True))
    return f"07:58:00.000 -> {header}\n" + "".join(lines)


def sensor_lines() -> str:
    """Write a line for each sensor, as SparkFun's sketch for the LSM9DS1 does."""
    acc, gyr = (rows(values).replace(",", ", ").splitlines() for values in (ACC_G, GYR_DPS))
    return "".join(
        f"[07:58:{t:06.3f}] A: {one} g\n[07:58:{t:06.3f}] G: {other} deg/s\n"
        for t, one, other in zip(TIME_S, acc, gyr, strict=True)
    )


def polar() -> bytes:
    def table(unit: str, values: np.ndarray) -> str:
        phone = ["2026-03-02T07:58:00.793"] * len(TIME_S)
        stamps = [f"{826_441_200_000_000_000 + round(t * 1e9)}" for t in TIME_S]
        names = ["Phone timestamp", "sensor timestamp [ns]", *(f"{axis} [{unit}]" for axis in "XYZ")]
        return ";".join(names) + "\n" + rows(phone, stamps, values, mark=";")

    return pack(Polar_Sense_1_ACC=table("mg", 1000 * ACC_G), Polar_Sense_1_GYRO=table("dps", GYR_DPS))


TABLES: dict[str, Callable[[], str | bytes]] = {
    "shimmer": shimmer,
    "shimmer of four lines": shimmer_of_four_lines,
    "witmotion": witmotion,
    "serial print": serial_print,
    "serial monitor": serial_monitor,
    "excel days": excel_days,
    "picoquake": picoquake,
    "mtw": mt_manager,
    "dot": movella_dot,
    "phyphox": phyphox,
    "sensorlogger": sensor_logger,
    "sensorlogger of an iPhone": lambda: sensor_logger(("Accelerometer", "Gravity")),
    "metawear": metawear,
    "openlog": open_log,
    "monitored table": monitored_table,
    "sensor lines": sensor_lines,
    "polar": polar,
}
