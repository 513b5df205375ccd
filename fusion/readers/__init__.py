"""From a file's bytes to a :class:`fusion.recording.Recording`: one format, one file."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import BinaryIO

from fusion.errors import EmptyFile
from fusion.physics import check_physics
from fusion.readers import actilife_csv, gt3x, lsm9ds1_csv, lsm9ds1_raw
from fusion.readers.contents import check_extension, explain_refusal
from fusion.readers.source import Source, hash_source, open_source
from fusion.recording import Recording


@dataclass(frozen=True, slots=True)
class Reader:
    """A format: what to call it, how to tell it by its bytes, how to read it."""

    name: str
    recognise: Callable[[Source], bool]
    read: Callable[[Source, float | None], Recording]


READERS = (
    Reader("ActiGraph GT9X Link .gt3x", gt3x.recognise, gt3x.read),
    Reader("ActiLife IMU CSV", actilife_csv.recognise, actilife_csv.read),
    Reader("LSM9DS1 registers, binary", lsm9ds1_raw.recognise_binary, lsm9ds1_raw.read_binary),
    Reader("LSM9DS1 registers, text", lsm9ds1_raw.recognise_text, lsm9ds1_raw.read_text),
    Reader("CSV with named columns", lsm9ds1_csv.recognise, lsm9ds1_csv.read),
)
"""In the order in which they are asked."""


def read_recording(file: BinaryIO, *, file_name: str = "", rate_hz: float | None = None) -> Recording:
    """Read a recording, whatever its format, and check it against physics.

    Parameters
    ----------
    file
        Binary and seekable.
    file_name
        Used only to notice a wrong extension; by default the file object's own name.
    rate_hz
        What the person says about layouts that hold no time; ignored where the file tells.

    Raises
    ------
    fusion.errors.FusionError
        No recording can be given; code and facts say why.
    """
    source = open_source(file, file_name)
    if source.size_bytes == 0:
        raise EmptyFile
    reader = next((reader for reader in READERS if reader.recognise(source)), None)
    if reader is None:
        raise explain_refusal(source)
    recording = reader.read(source, rate_hz)
    check_extension(source, is_archive=reader is READERS[0])
    return check_physics(replace(recording, sha256=hash_source(source)))
