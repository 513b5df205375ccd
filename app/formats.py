"""The kinds of file that are taken, in words; :data:`fusion.readers.READERS` is what reads them."""

from dataclasses import dataclass

from fusion.plugins import find_entry_points, find_version


@dataclass(frozen=True, slots=True)
class Format:
    """A kind of file: the reader's name for it, how its name ends, what it holds."""

    name: str
    extensions: tuple[str, ...]
    holds: str


FORMATS = (
    Format(
        "ActiGraph GT9X Link .gt3x",
        (".gt3x",),
        "acceleration and angular velocity of the Link's IMU at 100 Hz, device clock",
    ),
    Format(
        "Axivity AX6 .cwa",
        (".cwa", ".cwa.gz"),
        "acceleration and angular velocity at the rate of the setting, device clock",
    ),
    Format(
        "Parquet",
        (".parquet",),
        "named columns: time, acceleration in three axes, angular velocity in three axes",
    ),
    Format("ActiLife IMU CSV", (".csv", ".csv.gz"), "the IMU export of ActiLife, raw samples"),
    Format(
        "Two tables in a zip",
        (".zip",),
        "one table of the accelerometer and one of the gyroscope, as apps of phones write them",
    ),
    Format("LSM9DS1 registers, binary", (".bin", ".dat"), "registers of the sensor, with the scale known"),
    Format("LSM9DS1 registers, text", (".csv", ".txt", ".csv.gz"), "registers of the sensor, whole numbers"),
    Format(
        "CSV with named columns",
        (".csv", ".txt", ".csv.gz", ".zip"),
        "time, ax, ay, az, gx, gy, gz with their units in the header",
    ),
)


def find_added_formats() -> tuple[Format, ...]:
    """Name what the readers of other packages add; how their files end only they know."""
    entries = find_entry_points()
    return tuple(Format(one.name, (), f"read by a plug-in, version {find_version(one)}") for one in entries)


REFERENCES = (".mvnx",)
"""Read too, as a recording of the posture and as the reference of a comparison."""
ENDINGS = tuple(dict.fromkeys([*(ending for kind in FORMATS for ending in kind.extensions), *REFERENCES]))
"""How the names of files end that are looked for in a folder."""
