"""The known devices as data: how each is recognised, and what its files do not state.

A table of a known device is recognised by its header line or by the lines above it. A statement in the file
takes precedence over the entry here. The entry counts as stated by the header, and the checks of motion do
not override it.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

Form = Literal["binary", "table", "zip", "capture"]


@dataclass(frozen=True, slots=True)
class KnownDevice:
    """A device, or a program that exports its recordings.

    ``device``: the value of :attr:`acromion.fusion.recording.Recording.device`.
    ``name``: the maker's name for it; the same in every language.
    ``form``: "binary", "table", "zip" of two tables, or "capture" of precomputed angles.
    ``header``, ``above``: patterns of the header line and of the lines above it, ignoring case; one match is
    enough.
    ``acc_unit``, ``gyr_unit``, ``time_unit``: units of columns whose names have none; "" if unknown.
    ``frame``: "right": right-handed, and statements of the header are never overruled; "either": motion
    decides.
    ``left_gyr_factor``: factor for the rates if the frame proves left-handed; corrects an error of the
    device's library.
    ``rate``, ``axes``, ``clock``: text for the formats page.
    ``source``: the real file that was read, or "from documentation".
    """

    device: str
    name: str
    form: Form
    header: str = ""
    above: str = ""
    acc_unit: str = ""
    gyr_unit: str = ""
    time_unit: str = ""
    frame: Literal["right", "either"] = "right"
    left_gyr_factor: float = 1.0
    rate: str = "of the time column"
    axes: str = "right-handed"
    clock: str = "none"
    source: str = "from documentation"

    def matches(self, header: str, above: Sequence[str]) -> bool:
        """Return whether a header line, or a line above it, matches this device."""
        if self.header and re.search(self.header, header.strip(), re.IGNORECASE):
            return True
        return bool(self.above) and any(re.search(self.above, line, re.IGNORECASE) for line in above)


KNOWN_DEVICES = (
    KnownDevice(
        "gt9x",
        "ActiGraph GT9X Link",
        "binary",
        rate="100 Hz, measured by seconds",
        clock="local, or UTC of CentrePoint",
        source="shared: GT9X Link, 179 s",
    ),
    KnownDevice(
        "gt9x",
        "ActiGraph GT9X Link, ActiLife IMU CSV",
        "table",
        above=r"data (table )?file created by actigraph",
        acc_unit="g",
        gyr_unit="deg/s",
        rate="100 Hz, in the first line",
        clock="local",
        source="shared: the same 179 s",
    ),
    KnownDevice(
        "ax6",
        "Axivity AX6",
        "binary",
        rate="measured by blocks",
        clock="local",
        source="scikit-digital-health (MIT)",
    ),
    KnownDevice(
        "ax6",
        "Axivity AX6, CSV of OmGui",
        "table",
        header=r"^time,accel-x \(g\),.*gyro-x \((d|deg/s)\)",
        acc_unit="g",
        gyr_unit="deg/s",
        clock="local",
    ),
    KnownDevice(
        "mtw",
        "Xsens MT Manager",
        "table",
        header=r"packetcounter\W+sampletimefine\W+(year|utc)"
        r"|^(?>.*?acc_x\W)(?>.*?gyr_x\W).*?(mat\[1\]\[1\]|quat_q0|roll\W+pitch)",
        above=r"^//.*(update rate|sample rate|mt manager|deviceid|start time)",
        acc_unit="m/s2",
        gyr_unit="rad/s",
        time_unit="100us",
        rate="in the lines above, or entered",
        source="opensim-core (Apache-2.0)",
    ),
    KnownDevice(
        "dot",
        "Movella DOT",
        "table",
        above=r"^devicetag:",
        acc_unit="m/s2",
        gyr_unit="deg/s",
        time_unit="us",
        source="SportKight (MIT), angles only",
    ),
    KnownDevice("mvn", "Xsens MVN", "capture", rate="in the file", source="test_mocap (GPL-3.0)"),
    KnownDevice(
        "shimmer",
        "Shimmer Consensys",
        "table",
        header=r"shimmer\w{0,40}_(accel|gyro)_|(wide range|low noise) accelerometer x",
        acc_unit="m/s2",
        gyr_unit="deg/s",
        time_unit="ms",
        clock="time since 1970",
        source="machine-learning-pipeline-IMU-data (MIT)",
    ),
    KnownDevice(
        "opal",
        "APDM Opal, Mobility Lab",
        "table",
        above=r"\b(apdm|mobility lab|opal)\b|^format=\d+,",
        acc_unit="m/s2",
        gyr_unit="rad/s",
        time_unit="us",
        clock="time since 1970",
    ),
    KnownDevice(
        "ngimu",
        "x-io NGIMU",
        "table",
        header=r"^time \(s\),gyroscope x \(deg/s\),.*accelerometer z \(g\),magnetometer",
        source="Fusion (MIT)",
    ),
    KnownDevice(
        "x-imu3",
        "x-io x-IMU3",
        "table",
        header=r"^timestamp \(us\),gyroscope x \(deg/s\)",
        source="scikit-kinematics (BSD-2-Clause)",
    ),
    KnownDevice(
        "x-imu",
        "x-io x-IMU",
        "table",
        header=r"^packet number,gyroscope x \(deg/s\)",
        rate="entered: 256 Hz by default",
        source="Gait-Tracking-With-x-IMU",
    ),
    KnownDevice(
        "witmotion",
        "WitMotion",
        "table",
        header=r"^(?>.*?\bax\(g\)\W+ay\(g\)).*?\bwx\((deg|°)/s\)"
        r"|^(?>.*?acceleration x\(g\)).*?angular velocity x\(",
        acc_unit="g",
        gyr_unit="deg/s",
        clock="local",
    ),
    KnownDevice(
        "metawear", "MbientLab MetaWear", "zip", header=r"^epoch? ?\(ms\),time", clock="time since 1970"
    ),
    KnownDevice(
        "phyphox",
        "phyphox",
        "zip",
        header=r'^"?time \(s\)"?[,;\t]"?(x|(acceleration|gyroscope|accel_)\s*x) \((m/s\^2|rad/s)\)',
        source="DFB_Lab04_GaitAnalysis",
    ),
    KnownDevice(
        "sensorlogger",
        "Sensor Logger, motion of a watch",
        "table",
        header=r"^time,seconds_elapsed,.*gravity[xyz]\b",
        gyr_unit="rad/s",
        clock="time since 1970",
    ),
    KnownDevice(
        "sensorlogger",
        "Sensor Logger",
        "zip",
        header=r"^time,seconds_elapsed,",
        acc_unit="m/s2",
        gyr_unit="rad/s",
        clock="time since 1970",
        source="imu_data (MIT)",
    ),
    KnownDevice(
        "androsensor",
        "AndroSensor",
        "table",
        header=r"^(?>.*?accelerometer x \(m/s²\)).*?time since start in ms",
        source="ActivityDetection",
    ),
    KnownDevice(
        "picoquake",
        "PicoQuake",
        "table",
        above=r"\bpicoquake\b",
        acc_unit="g",
        gyr_unit="deg/s",
        rate="in the lines above",
        clock="local",
        source="PicoQuake",
    ),
    KnownDevice(
        "racebox",
        "RaceBox",
        "table",
        header=r"^record,time,latitude,longitude,(?>.*?gforcex,).*?gyrox",
        acc_unit="g",
        gyr_unit="deg/s",
        time_unit="s",
        source="imu-data (AGPL-3.0)",
    ),
    KnownDevice(
        "lsm9ds1",
        "ST LSM9DS1, the form of docs/formats.md",
        "table",
        header=r"^time_us,acc_x_g,acc_y_g,acc_z_g,gyr_x_dps,gyr_y_dps,gyr_z_dps$",
        above=r"device:\s{0,9}\S{0,60}lsm9ds1",
        frame="either",
        axes="either; left-handed is converted",
        clock="of the lines above",
        source="simulated",
    ),
    KnownDevice(
        "lsm9ds1",
        "ST LSM9DS1, registers",
        "binary",
        rate="of the timestamps",
        axes="left-handed: x is reversed",
        clock="time since 1970",
        source="rpi_lsm9ds1 (Apache-2.0)",
    ),
    KnownDevice(
        "nano33",
        "Arduino Nano 33 BLE, IMU_Capture",
        "table",
        header=r'^"?ax"?,"?ay"?,"?az"?,"?gx"?,"?gy"?,"?gz"?\s*$',
        acc_unit="g",
        gyr_unit="deg/s",
        frame="either",
        left_gyr_factor=0.07 * 32768.0 / 2000.0,
        rate="119 Hz, by bursts of 119 rows; otherwise entered",
        axes="left-handed: an LSM9DS1, whose library prints 61.04 mdps for 70",
        source="Arduino-Nano-33-BLE",
    ),
)
"""In the order of comparison. Loggers with an LSM6, MPU-6050 or BNO055 have no typical header; their units
come from the column names or from motion.
"""


UNREAD_FORMATS = {
    ".mtb": ("Xsens MT", "CSV or text from MT Manager"),
    ".mvn": ("Xsens MVN", "MVNX from MVN Analyze"),
    ".ximu3": ("x-io x-IMU3", "CSV from the x-IMU3 GUI"),
    ".xio": ("x-io NGIMU", "CSV from the NGIMU SD Card File Converter"),
    ".h5": ("APDM Opal", "CSV from Mobility Lab or Motion Studio"),
    ".apdm": ("APDM Opal", "CSV from Mobility Lab or Motion Studio"),
    ".hpf": ("Delsys Trigno", "CSV from the Delsys File Utility"),
    ".shpf": ("Delsys Trigno", "CSV from the Delsys File Utility"),
}
"""Binary formats of devices with a gyroscope, by extension: the device, and what to export instead."""


def find_known_device(header: str, above: Sequence[str] = ()) -> KnownDevice | None:
    """Return the device of a table by its header line and the lines above it; None if unknown."""
    return next((one for one in KNOWN_DEVICES if one.matches(header, above)), None)


def find_device_name(device: str) -> str | None:
    """Return the name of a kind of device; None if it is not in the table."""
    names = (one.name.partition(",")[0] for one in KNOWN_DEVICES if one.device == device)
    return next(names, None)
