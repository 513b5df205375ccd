"""Files whose angle needs no fusion of ours: motion capture, orientations, ready angles.

They serve as the reference of a comparison and, those of motion capture, as recordings of their own.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import BinaryIO

from fusion.angle_files import elevation_parquet, mvnx, tables
from fusion.angle_files.angle_series import (
    AngleFile,
    AngleFileOptions,
    calibrate_alone,
    calibrate_file,
    resample_file,
)
from fusion.errors import EmptyFile
from fusion.readers import explain_refusal
from fusion.readers.source import Source, open_source

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
    """A format: how it is recognised by its bytes, how it is read."""

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
"""In the order in which they are asked."""

SAMPLES = (
    *(frozenset({"acc_x"}), frozenset({"acc_y"}), frozenset({"acc_z"})),
    *(frozenset({"gyr_x"}), frozenset({"gyr_y"}), frozenset({"gyr_z"})),
)
NO_OPTIONS = AngleFileOptions()


def read_angle_file(file: BinaryIO, file_name: str = "", options: AngleFileOptions = NO_OPTIONS) -> AngleFile:
    """Read an angle or an orientation, whatever its format.

    ``file``: binary; can be rewound.
    ``file_name``: used only to recognise an extension; by default the file object's own name.
    ``options``: what the person says about the file.

    Returns
    -------
    AngleFile
        Its rows, in the file's own clock.

    Raises
    ------
    fusion.errors.FusionError
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
    """Name the format of a file by its first bytes; "" for none of them. The file is rewound."""
    reader = _find_reader(open_source(file, file_name, is_hashed=False))
    file.seek(0)
    return reader.layout if reader else ""


def holds_samples(file: BinaryIO) -> bool:
    """Whether a table also names acceleration and angular rate, and so is to be fused. It is rewound."""
    source = open_source(file, is_hashed=False)
    file.seek(0)
    return tables.find_layout(source, SAMPLES) is not None


def _find_reader(source: Source) -> AngleReader | None:
    return next((reader for reader in ANGLE_READERS if reader.recognise(source)), None)
