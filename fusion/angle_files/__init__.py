"""Files with an angle or an orientation that need no sensor fusion: motion capture and precomputed angles.

They are the reference in a comparison. Motion capture files can also be analysed as recordings.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import BinaryIO

from acromion.fusion.angle_files import elevation_parquet, mvnx, tables
from acromion.fusion.angle_files.angle_series import (
    AngleFile,
    AngleFileOptions,
    calibrate_alone,
    calibrate_file,
    resample_file,
)
from acromion.fusion.errors import EmptyFile
from acromion.fusion.readers import explain_refusal
from acromion.fusion.readers.source import Source, open_source

__all__ = [
    "AngleFile",
    "AngleFileOptions",
    "calibrate_alone",
    "calibrate_file",
    "holds_samples",
    "read_angle_file",
    "recognise_layout",
    "resample_file",
]


@dataclass(frozen=True, slots=True)
class AngleReader:
    """A file format: how to recognise it by its bytes, and how to read it."""

    layout: str
    recognise: Callable[[Source], bool]
    read: Callable[[Source, AngleFileOptions], AngleFile]


ANGLE_READERS = (
    AngleReader("mvnx", mvnx.recognise, mvnx.read),
    AngleReader("parquet", elevation_parquet.recognise, elevation_parquet.read),
    AngleReader("mt-manager", tables.recognise_mt_manager, tables.read_mt_manager),
    AngleReader("dot", tables.recognise_dot, tables.read_dot),
    AngleReader("csv", tables.recognise_named, tables.read_named),
)
"""In the order in which they are tried."""

SAMPLES = (
    *(frozenset({"acc_x"}), frozenset({"acc_y"}), frozenset({"acc_z"})),
    *(frozenset({"gyr_x"}), frozenset({"gyr_y"}), frozenset({"gyr_z"})),
)
NO_OPTIONS = AngleFileOptions()


def read_angle_file(file: BinaryIO, file_name: str = "", options: AngleFileOptions = NO_OPTIONS) -> AngleFile:
    """Read an angle or an orientation from a file of any supported format.

    ``file``: binary; can be rewound.
    ``file_name``: used only for its extension; by default the file object's own name.
    ``options``: what the person states about the file.

    Returns
    -------
    AngleFile
        Its rows, in the file's own clock.

    Raises
    ------
    acromion.fusion.errors.FusionError
        No angle can be read; code and facts say why.
    """
    source = open_source(file, file_name)
    if source.size_bytes == 0:
        raise EmptyFile
    reader = _find_reader(source)
    if reader is None:
        raise explain_refusal(source)
    return reader.read(source, options)


def recognise_layout(file: BinaryIO, file_name: str = "") -> str:
    """Return the format of a file from its first bytes; "" if unknown. The file is rewound."""
    reader = _find_reader(open_source(file, file_name, is_hashed=False))
    file.seek(0)
    return reader.layout if reader else ""


def holds_samples(file: BinaryIO) -> bool:
    """Return whether a table also has acceleration and angular rate, and is therefore fused; rewinds it."""
    source = open_source(file, is_hashed=False)
    file.seek(0)
    return tables.find_layout(source, SAMPLES) is not None


def _find_reader(source: Source) -> AngleReader | None:
    return next((reader for reader in ANGLE_READERS if reader.recognise(source)), None)
