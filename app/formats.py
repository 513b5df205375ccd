"""Supported file formats, in words; :data:`acromion.fusion.readers.READERS` has the readers."""

from dataclasses import dataclass

from acromion.fusion.plugins import find_entry_points, find_version


@dataclass(frozen=True, slots=True)
class Format:
    """A file format: the reader's name, the file name extensions, and the content."""

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
        "one table for the accelerometer and one for the gyroscope, as phone apps write them",
    ),
    Format("LSM9DS1 registers, binary", (".bin", ".dat"), "sensor registers, with a known scale"),
    Format("LSM9DS1 registers, text", (".csv", ".txt", ".csv.gz"), "sensor registers, whole numbers"),
    Format(
        "CSV with named columns",
        (".csv", ".txt", ".csv.gz", ".zip"),
        "time, ax, ay, az, gx, gy, gz with their units in the header",
    ),
)


def find_added_formats() -> tuple[Format, ...]:
    """Return the formats of reader plug-ins; their file name extensions are unknown."""
    entries = find_entry_points()
    return tuple(Format(one.name, (), f"read by a plug-in, version {find_version(one)}") for one in entries)


REFERENCES = (".mvnx",)
"""Also supported: as a recording of the posture and as the reference of a comparison."""
ENDINGS = tuple(dict.fromkeys([*(ending for kind in FORMATS for ending in kind.extensions), *REFERENCES]))
"""File name extensions to look for in a folder."""
