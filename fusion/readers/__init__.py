"""From a file's bytes to a :class:`acromion.fusion.recording.Recording`: one format, one file."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import EntryPoint
from os import PathLike
from pathlib import Path
from typing import BinaryIO, TypeVar

import numpy as np

from acromion.fusion.caveats import Caveat
from acromion.fusion.checks.faults import (
    exclude_faults,
    exclude_stuck,
    leave_out_held,
    leave_out_zeros,
    refuse_dead,
)
from acromion.fusion.checks.physics import add_flags, are_units_stated, check_physics, refuse_impossible_rates
from acromion.fusion.checks.summary import flag_resolution, forget_summaries
from acromion.fusion.clocks import ShiftWindow
from acromion.fusion.devices import UNREAD_FORMATS
from acromion.fusion.documents import MAGIC, find_document
from acromion.fusion.errors import (
    BlankFile,
    EmptyFile,
    FailedReader,
    FusionError,
    NoGyroscope,
    NoPair,
    NoSamples,
    RefusedXml,
    SeparateLines,
    UnknownColumns,
    UnknownFormat,
    UnsafeArchive,
    UnsupportedFormat,
    UnusableProfile,
    WrongExtension,
)
from acromion.fusion.plugins import find_entry_points, find_version
from acromion.fusion.readers import cwa, gt3x
from acromion.fusion.readers.archive import is_in_zip, unpack
from acromion.fusion.readers.source import Source, hash_source, open_source, read_chunks
from acromion.fusion.readers.tables import actilife as actilife_csv
from acromion.fusion.readers.tables import csv as lsm9ds1_csv
from acromion.fusion.readers.tables import pair, parquet
from acromion.fusion.readers.tables.columns import (
    GYROSCOPE,
    name_missing,
    parse_column_name,
    read_axis,
    read_named_axis,
)
from acromion.fusion.readers.tables.layout import (
    DELIMITERS,
    MIN_COLUMNS,
    NUMBER,
    SNIFFED_LINES,
    ArrivalWriter,
    TextLayout,
    decode_head,
    find_form,
    find_layout,
    read_labels,
    split_fields,
)
from acromion.fusion.readers.tables.profile import (
    ColumnProfile,
    ProfileProposal,
    check_profile,
    identify_header,
    parse_profile,
    propose_profile,
)
from acromion.fusion.readers.time.clock import flag_days
from acromion.fusion.readers.time.joining import join_recordings
from acromion.fusion.readers.time.window import cut_recording
from acromion.fusion.recording import ACC_UNITS_G, Extent, QualityFlag, Recording, measure_samples

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
    "measure_extent",
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
"""Formats with a signature. Plug-ins are tried next, before the readers that go by the names of columns."""
TABLE_READERS = (
    Reader("Parquet", parquet.recognise, parquet.read),
    Reader("LSM9DS1 registers, binary", lsm9ds1_csv.recognise_binary, lsm9ds1_csv.read_binary),
    Reader("LSM9DS1 registers, text", lsm9ds1_csv.recognise_text, lsm9ds1_csv.read_text),
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
    window: ShiftWindow | None = None,
) -> Recording:
    """Read a recording of any known format and check it against physics.

    Parameters
    ----------
    file
        A path, or a binary file that can be rewound.
    file_name
        Used only to notice a wrong extension; by default the file object's own name.
    rate_hz
        Sampling rate in Hz that a person gives, for layouts without time; ignored if the file states it.
    sha256
        The digest of the bytes, hexadecimal, if the caller already has it; else it is computed here.
    profile
        What the columns of a table mean, or which of its sensors is on the arm, for tables whose header does
        not tell, which other formats ignore; and when the pose was held.
    window
        The shift to read, of a recording of several days.

    Returns
    -------
    Recording
        Segments in g and deg/s, with the caveats of reading and of the checks.

    Raises
    ------
    acromion.fusion.errors.FusionError
        The file cannot be read as a recording; code and facts give the reason.
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
                window=window,
            )
    source = open_source(file, file_name, is_hashed=not sha256)
    if source.size_bytes == 0:
        raise EmptyFile
    content = replace(unpack(source, profile.sensor if profile else ""), window=window)
    refuse_blank(content)
    if profile is not None and content.is_chosen:
        profile = replace(profile, sensor="")
    if content.pair is not None:
        recording = pair.read(content, rate_hz, profile.date_order if profile else None)
    elif profile is not None and _is_read_by_profile(content, profile):
        recording = lsm9ds1_csv.read_profiled(content, profile, rate_hz)
    elif profile is not None and profile.sensor:
        raise UnusableProfile(why="one sensor, unnamed", name="sensor")
    else:
        recording = _read_recognised(content, rate_hz)
    if content.left_aside:
        left_aside = f"{content.left_aside}: {', '.join(content.beside)}".removesuffix(": ")
        understood = {**recording.understood, "left_aside": left_aside}
        recording = replace(recording, understood=understood)
    held = profile.pose_held if profile else None
    hashed = replace(recording, sha256=sha256 or hash_source(source), pose_held=held or recording.pose_held)
    checked = _check_readings(hashed)
    return cut_recording(checked, window) if window else checked


def read_thigh(file: BinaryIO, file_name: str = "") -> Recording:
    """Read a recording of the thigh; it needs no gyroscope.

    Without a gyroscope it may be an Axivity AX3 .cwa, ActiLife's raw CSV, or a table with named columns.

    Raises as :func:`read_recording`.
    """
    try:
        return read_recording(file, file_name=file_name)
    except NoGyroscope as refusal:
        source = replace(unpack(open_source(file, file_name)), is_thigh=True)
        if source.extension == ".gt3x" or source.pair is not None:
            raise
        readers = (cwa, actilife_csv)
        read = next((one.read for one in readers if one.recognise(source)), lsm9ds1_csv.read)
        try:
            return read(source, None)
        except UnknownColumns:
            raise refusal from None


def measure_extent(
    file: BinaryIO, *, file_name: str = "", rate_hz: float | None = None, profile: ColumnProfile | None = None
) -> Extent:
    """Return when a recording has samples. A .gt3x is not decoded for it.

    Raises as :func:`read_recording`.
    """
    source = open_source(file, file_name)
    if source.extension == ".gt3x" and gt3x.recognise(source):
        return replace(gt3x.measure_extent(source), sha256=hash_source(source))
    return measure_samples(read_recording(file, file_name=file_name, rate_hz=rate_hz, profile=profile))


def _is_read_by_profile(content: Source, profile: ColumnProfile) -> bool:
    """Return whether the profile decides how a table is read; for ActiLife's, an order of dates does not."""
    if identify_content(content.head) not in ("text", "JSON"):  # each line may be an object
        return False
    return profile.names_columns or (profile.date_order is not None and not actilife_csv.recognise(content))


def _check_readings(recording: Recording) -> Recording:
    """Exclude unmeasured samples, then check units, axes and faults of the rest.

    Finding a stuck channel needs movement in g and deg/s: if a file states no units, they are found first.
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

    A header of column names proves nothing, except the header of our form.
    """
    source = open_source(file, is_hashed=False)
    file.seek(0)
    is_ours = lsm9ds1_csv.CANONICAL_HEADER.encode() in source.head
    return is_ours or any(one.recognise(source) for one in (gt3x, cwa, actilife_csv))


def _read_recognised(content: Source, rate_hz: float | None) -> Recording:
    """Try the readers in order, plug-ins between them; a plug-in that fails does not stop the others."""
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
    acromion.fusion.errors.FusionError
        As :func:`read_recording`, and :class:`acromion.fusion.errors.UnusableJoin`.
    """
    return join_recordings([read_recording(file, rate_hz=rate_hz, profile=profile) for file in files])


# What the content of a file is, so that a refusal can name it.

_COMMENT = re.compile(rb"<!--.*?(?:-->|\Z)", re.DOTALL)
TEXT_EXTENSIONS = (".csv", ".txt", ".tsv", ".dat", ".log")
DEVICE_EXTENSIONS = (".gt3x", ".cwa")


def identify_content(head: bytes) -> str:
    """Return a short name of the content, the same in every language."""
    if document := find_document(head):
        return document
    for magic, name in MAGIC:
        if head.startswith(magic):
            return name
    start = head[:1024].lstrip(b"\xef\xbb\xbf \t\r\n").lower()
    if start.startswith((b"<!doctype html", b"<html")):
        return "HTML"
    if start.startswith(b"<"):
        return "XML"
    if start.startswith((b"{", b"[")):
        return "JSON"
    return "binary" if b"\0" in head and not find_form(head).encoding else "text"


def refuse_blank(source: Source) -> None:
    """Refuse a file of zeros: a logger reserves room on its card before it writes; raises BlankFile."""
    if any(source.head):
        return
    n_bytes = 0
    for chunk in read_chunks(source):
        if chunk.count(0) < len(chunk):
            return
        n_bytes += len(chunk)
    raise BlankFile(n=n_bytes)


def explain_refusal(source: Source) -> FusionError:
    """The error for bytes that no reader recognised."""
    kind = identify_content(source.head)
    if kind == "gzip":
        return UnsafeArchive(reason="nested")
    if kind == "text":
        return _explain_text(source)
    if kind == "XML" and b"<!doctype" in _COMMENT.sub(b"", source.head).lower():
        return RefusedXml(reason="forbidden")
    if kind in ("binary", "HDF5 (.h5)") and source.extension in UNREAD_FORMATS:
        device, export = UNREAD_FORMATS[source.extension]
        return UnsupportedFormat(device=device, export=export)
    return UnknownFormat(kind=kind)


def _explain_text(source: Source) -> FusionError:
    if source.extension == ".gt3x":
        return WrongExtension(ext=".gt3x", kind="text", right=".csv")
    head = decode_head(source)
    layout, lines = find_layout(head), head.split("\n")
    if layout is not None:
        why = "no header, stamped" if isinstance(layout.writer, ArrivalWriter) else "no header"
        return _name_header(lines, layout) or UnknownColumns(why=why, line=layout.first_line + 1)
    for line in lines[:SNIFFED_LINES]:
        for mark in DELIMITERS:
            names = [parse_column_name(field) for field in split_fields(line, mark)]
            if sum(column.channel in ("acc", "gyr") for column in names) >= MIN_COLUMNS:
                if _holds_records(lines, mark):
                    return UnknownColumns(why="kinds of lines", list=line.strip()[:200])
                return NoSamples()  # a table without rows
    refusal = _explain_one_sensor(lines, is_in_zip=is_in_zip(source)) or _explain_labels(lines)
    return refusal or UnknownFormat(kind="text")


def _explain_labels(lines: Sequence[str]) -> FusionError | None:
    """Return the error for lines that name one axis or one sensor each, as sketches print them."""
    named = [line for line in lines[:SNIFFED_LINES] if any(map(read_named_axis, read_labels(line)[0]))]
    return SeparateLines(list=named[0].strip()[:200]) if len(named) >= MIN_COLUMNS else None


def _holds_records(lines: Sequence[str], mark: str) -> bool:
    """Return whether rows of numbers begin with a word, as logs of several kinds of lines do."""
    fields = (split_fields(line, mark) for line in lines[:SNIFFED_LINES])
    counts = (sum(bool(NUMBER.fullmatch(field)) for field in row[1:]) for row in fields)
    return sum(count >= MIN_COLUMNS for count in counts) >= MIN_COLUMNS


def _name_header(lines: Sequence[str], layout: TextLayout) -> FusionError | None:
    """The error that shows the line above the rows, where it names every column by unknown names."""
    above = lines[: layout.first_line][-1:]
    fields = [field.strip() for line in above for field in split_fields(line, layout.delimiter)]
    if not above or len(fields) != len(layout.sample_rows[0]):
        return None
    if not all(any(letter.isalpha() for letter in field) for field in fields):
        return None
    columns = [parse_column_name(field) for field in fields]
    return UnknownColumns(list=above[0].strip()[:200], **name_missing(columns))


def _explain_one_sensor(lines: Sequence[str], *, is_in_zip: bool) -> FusionError | None:
    """Return the error for a table of one sensor, or of rows of one sensor each; None for any other."""
    for line in lines[:SNIFFED_LINES]:
        for mark in DELIMITERS[:-1]:
            fields = split_fields(line, mark)
            columns = [parse_column_name(field) for field in fields]
            axes = dict(found for field in fields if (found := read_axis(field)))
            channels = {column.channel for column in columns} & {"acc", "linear", "gyr"}
            is_of_one = len(axes) == len("xyz") and any(one.channel == "time" for one in columns)
            if (channels or is_of_one) and "gyr" not in channels and any(map(_names_gyroscope, lines)):
                return SeparateLines(list=line.strip()[:200])
            if channels and "gyr" not in channels:
                return NoGyroscope()
            if channels == {"gyr"} or (len(axes) == len("xyz") and columns[0].channel == "time"):
                if any(unit in ACC_UNITS_G for unit in axes.values()):
                    return NoGyroscope(cure="both in the zip" if is_in_zip else "two tables")
                return NoPair(why="one sensor", list=line.strip()[:200])
    return None


def _names_gyroscope(line: str) -> bool:
    return GYROSCOPE.search(line) is not None


def check_extension(source: Source, own: str | None) -> None:
    """Refuse a name that contradicts the content; ``own``: the ending of a device's own format.

    Raises WrongExtension.
    """
    named = source.extension
    if own is not None and named != own and named in (*TEXT_EXTENSIONS, *DEVICE_EXTENSIONS):
        raise WrongExtension(ext=named, kind=own, right=own)
    if own is None and named in DEVICE_EXTENSIONS:
        raise WrongExtension(ext=named, kind="text", right=".csv")


# Readers of other packages. A plug-in that fails is named and does not stop the others.

LONGEST_CAUSE = 200
PLAIN_NAME = re.compile(r"\w[\w +\-./()]{0,59}")
"""A device's name is printed in reports, tables and Markdown."""
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class PlugIn:
    """A reader of another package: ``entry`` names a module or an object with ``recognise`` and ``read``."""

    entry: EntryPoint

    @property
    def name(self) -> str:
        """Name of the entry point."""
        return self.entry.name

    def recognise(self, source: Source) -> bool:
        """Whether the file is the plug-in's.

        Raises FailedReader: it cannot be loaded, or fails.
        """
        return self._ask(lambda: bool(self.entry.load().recognise(source)))

    def read(self, source: Source, rate_hz: float | None) -> Recording:
        """Read the file; the recording names the plug-in and its version.

        Raises
        ------
        FailedReader
            The plug-in fails, or returns something other than a recording.
        acromion.fusion.errors.FusionError
            As the plug-in refuses the file.
        """
        recording = self._ask(lambda: self.entry.load().read(source, rate_hz))
        fault = self._ask(lambda: find_fault(recording))
        if fault:
            raise self._fail(fault)
        named: Recording = replace(recording, reader=(self.name, find_version(self.entry)))
        return named

    def _ask(self, work: Callable[[], T]) -> T:
        """Call the plug-in; every exception except a refusal is its failure."""
        try:
            return work()
        except MemoryError:
            raise
        except (Exception, SystemExit) as error:
            if isinstance(error, FusionError) and type(error).__module__ == FusionError.__module__:
                raise
            raise self._fail(f"{type(error).__name__}: {error}") from error

    def _fail(self, cause: str) -> FailedReader:
        return FailedReader(reader=self.name, version=find_version(self.entry), cause=cause[:LONGEST_CAUSE])


def find_plugins() -> tuple[PlugIn, ...]:
    """Return the readers that are installed, without loading them."""
    return tuple(PlugIn(entry) for entry in find_entry_points())


def find_fault(recording: object) -> str:
    """Return what a plug-in's recording lacks; "" if nothing does."""
    if not isinstance(recording, Recording):
        return f"read gave {type(recording).__name__}, not a Recording"
    if not PLAIN_NAME.fullmatch(recording.device):
        return "device is not a plain name of 1 to 60 letters, digits, spaces and any of + - . / ( )"
    end_us = 0
    for segment in recording.segments:
        if not segment.rate_hz > 0:
            return "a segment without a rate"
        for name, values in (("acc_g", segment.acc_g), ("gyr_dps", segment.gyr_dps)):
            is_fit = values.dtype == np.float32 and values.shape == (len(segment), 3)
            if not is_fit or not np.isfinite(values).all():
                return f"{name} is not float32 of shape (n, 3), all finite"
        if segment.start_us < end_us:
            return "segments overlap, or are not in the order of time"
        end_us = segment.end_us
    is_whole = bool(recording.segments) and end_us <= recording.duration_us + 1
    return "" if is_whole else "no segment, or no duration"
