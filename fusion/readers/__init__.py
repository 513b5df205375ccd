"""From a file's bytes to a :class:`fusion.recording.Recording`: one format, one file."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import BinaryIO

from fusion.caveats import Caveat
from fusion.checks.faults import (
    exclude_faults,
    exclude_stuck,
    leave_out_held,
    leave_out_zeros,
    refuse_dead,
)
from fusion.checks.physics import add_flags, are_units_stated, check_physics, refuse_impossible_rates
from fusion.checks.summary import flag_resolution, forget_summaries
from fusion.errors import EmptyFile, FailedReader
from fusion.readers import cwa, gt3x
from fusion.readers.archives import unpack
from fusion.readers.plugins import PlugIn, find_plugins
from fusion.readers.recognise import check_extension, explain_refusal, identify_content, refuse_blank
from fusion.readers.source import Source, hash_source, open_source
from fusion.readers.tables import actilife as actilife_csv
from fusion.readers.tables import csv as lsm9ds1_csv
from fusion.readers.tables import pair, parquet
from fusion.readers.tables import registers as lsm9ds1_raw
from fusion.readers.tables.profile import (
    ColumnProfile,
    ProfileProposal,
    check_profile,
    identify_header,
    parse_profile,
    propose_profile,
)
from fusion.readers.timebase.clock import flag_days
from fusion.readers.timebase.joining import join_recordings
from fusion.recording import QualityFlag, Recording

__all__ = [
    "READERS",
    "ColumnProfile",
    "ProfileProposal",
    "Reader",
    "RecordingFile",
    "check_profile",
    "holds_device_format",
    "identify_header",
    "join_recordings",
    "parse_profile",
    "propose_profile",
    "read_recording",
    "read_recordings",
]

RecordingFile = str | PathLike[str] | BinaryIO
"""A path, or a binary file that can be rewound."""


@dataclass(frozen=True, slots=True)
class Reader:
    """A format: what to call it, how to tell it by its bytes, how to read it."""

    name: str
    recognise: Callable[[Source], bool]
    read: Callable[[Source, float | None], Recording]


DEVICE_READERS = (
    Reader("Two tables in a zip", pair.recognise, pair.read),
    Reader("ActiGraph GT9X Link .gt3x", gt3x.recognise, gt3x.read),
    Reader("Axivity AX6 .cwa", cwa.recognise, cwa.read),
    Reader("ActiLife IMU CSV", actilife_csv.recognise, actilife_csv.read),
)
"""A signature tells these files. Plug-ins are asked next, before whatever goes by the names of columns."""
TABLE_READERS = (
    Reader("Parquet", parquet.recognise, parquet.read),
    Reader("LSM9DS1 registers, binary", lsm9ds1_raw.recognise_binary, lsm9ds1_raw.read_binary),
    Reader("LSM9DS1 registers, text", lsm9ds1_raw.recognise_text, lsm9ds1_raw.read_text),
    Reader("CSV with named columns", lsm9ds1_csv.recognise, lsm9ds1_csv.read),
)
READERS = (*DEVICE_READERS, *TABLE_READERS)
OWN_EXTENSIONS = {"ActiGraph GT9X Link .gt3x": ".gt3x", "Axivity AX6 .cwa": ".cwa"}
"""Extensions of a device's own formats: content and extension must agree."""


def read_recording(
    file: RecordingFile,
    *,
    file_name: str = "",
    rate_hz: float | None = None,
    sha256: str = "",
    profile: ColumnProfile | None = None,
) -> Recording:
    """Read a recording, whatever its format, and check it against physics.

    Parameters
    ----------
    file
        A path, or a binary file that can be rewound.
    file_name
        Used only to notice a wrong extension; by default the file object's own name.
    rate_hz
        Sampling rate in Hz that a person gives, for layouts without time; ignored where the file states it.
    sha256
        The digest of the bytes, hexadecimal, where the caller has it already; else it is computed here.
    profile
        What the columns of a table mean, or which of its sensors is on the arm, for tables whose header does
        not tell, which other formats ignore; and when the pose was held.

    Returns
    -------
    Recording
        Segments in g and deg/s, with the caveats of reading and of the checks.

    Raises
    ------
    fusion.errors.FusionError
        No recording can be given; code and facts say why.
    OSError
        A path that cannot be opened.
    """
    if isinstance(file, str | PathLike):
        with Path(file).open("rb") as opened:
            return read_recording(
                opened,
                file_name=file_name,
                rate_hz=rate_hz,
                sha256=sha256,
                profile=profile,
            )
    source = open_source(file, file_name, is_hashed=not sha256)
    if source.size_bytes == 0:
        raise EmptyFile
    content = unpack(source)
    refuse_blank(content)
    if profile is not None and profile.names_columns and identify_content(content.head) == "text":
        recording = lsm9ds1_csv.read_profiled(content, profile, rate_hz)
    else:
        recording = _read_recognised(content, rate_hz)
    held = profile.pose_held if profile else None
    hashed = replace(recording, sha256=sha256 or hash_source(source), pose_held=held or recording.pose_held)
    return _check_readings(hashed)


def _check_readings(recording: Recording) -> Recording:
    """Leave out first what was not measured, so that the rest can be judged; then units, axes and faults.

    A channel that stuck is told by movement in g and deg/s: if a file states no units, the search follows
    their settling.
    """
    alive = leave_out_held(refuse_dead(leave_out_zeros(recording)))
    is_stated = are_units_stated(alive)
    measured = exclude_stuck(alive) if is_stated else alive
    checked = check_physics(measured)
    found = exclude_faults(checked, measured if is_stated else None)
    judged = flag_days(refuse_impossible_rates(add_flags(found, *flag_resolution(checked))))
    forget_summaries(judged)
    return judged


def holds_device_format(file: BinaryIO) -> bool:
    """Whether the first bytes are those of a device's own format of samples; leaves the file rewound.

    A table whose header only names columns may hold anything, unless the names are those of our own form.
    """
    source = open_source(file, is_hashed=False)
    file.seek(0)
    is_ours = lsm9ds1_csv.CANONICAL_HEADER.encode() in source.head
    return is_ours or any(one.recognise(source) for one in (gt3x, cwa, actilife_csv))


def _read_recognised(content: Source, rate_hz: float | None) -> Recording:
    """Ask the readers in order, plug-ins in their turn; one of those that fails does not stop the others."""
    failures: list[FailedReader] = []

    def recognises(one: Reader | PlugIn) -> bool:
        try:
            return one.recognise(content)
        except FailedReader as failure:
            failures.append(failure)
            return False

    reader: Reader | PlugIn | None = next(filter(recognises, DEVICE_READERS), None)
    reader = reader or next(filter(recognises, find_plugins()), None)
    reader = reader or next(filter(recognises, TABLE_READERS), None)
    if reader is None:
        raise failures[0] if failures else explain_refusal(content)
    recording = reader.read(content, rate_hz)
    check_extension(content, OWN_EXTENSIONS.get(reader.name))
    failed = tuple(QualityFlag(Caveat.READER, facts=failure.facts) for failure in failures)
    return replace(recording, flags=(*failed, *recording.flags)) if failed else recording


def read_recordings(
    files: Sequence[RecordingFile], *, rate_hz: float | None = None, profile: ColumnProfile | None = None
) -> Recording:
    """Read the files of one shift and join them by the device's clock.

    Parameters
    ----------
    files
        In any order.
    rate_hz, profile
        As in :func:`read_recording`, for every file.

    Returns
    -------
    Recording
        From the first sample of the earliest file; the time between two files is missing.

    Raises
    ------
    fusion.errors.FusionError
        As :func:`read_recording`, and :class:`fusion.errors.UnusableJoin`.
    """
    return join_recordings([read_recording(file, rate_hz=rate_hz, profile=profile) for file in files])
