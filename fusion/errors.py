"""Reasons why no result can be reported.

An error means that there is no result. A caveat (:mod:`acromion.fusion.caveats`) qualifies a result. Any
other exception is a bug. An error has a fixed code and facts but no sentence: ``app/report/words`` has the
sentences by code. The table in ``docs/reference/codes.md`` is generated from this module.

    FusionError
      UnreadableFile
        UnknownFormat   the file is not a recording (wrong type, wrong name, epochs, no gyroscope)
        DamagedFile     the file was a recording (cut, corrupt, unsafe archive)
      UnusableRecording readable, but no angle can be trusted (too short, dead axis, wrong scale)
      UnusableDiary     the diary of the recording cannot be used
"""

from collections.abc import Mapping, Sequence
from typing import ClassVar

from acromion.fusion.caveats import TERM, name_facts

Fact = str | int | float
PLACE = name_facts(
    line="line of the file",
    byte="byte of the file",
    clock="time in the recording",
    header="identity of the header of a table",
)
"""The place in the file; any error may include it."""


DOUBLE_RECORDING = "E-DOUBLE"
"""The code of a recording whose bytes or samples are those of another; it has not failed."""
MOST_ROWS_NAMED = 20


def join_facts(rows: Sequence[Mapping[str, Fact]]) -> dict[str, Fact]:
    """Merge the facts of several rows for one error: the names of the second row end in ``_2``, and so on.

    Beyond twenty rows, ``more`` counts the rest, earlier merges included.
    """
    left_out = sum(int(row.get("more", 0)) for row in rows)
    rows = [{name: value for name, value in row.items() if name != "more"} for row in rows]
    facts = dict(rows[0])
    for number, row in enumerate(rows[1:MOST_ROWS_NAMED], 2):
        facts |= {f"{name}_{number}": value for name, value in row.items()}
    more = left_out + max(len(rows) - MOST_ROWS_NAMED, 0)
    return facts | ({"more": more} if more else {})


def split_facts(facts: Mapping[str, Fact]) -> list[dict[str, Fact]]:
    """Return the facts of each row: the reverse of :func:`join_facts`."""
    rows: dict[int, dict[str, Fact]] = {1: {}}
    for name, value in facts.items():
        stem, _, number = name.rpartition("_")
        if stem and number.isdigit() and "why_2" in facts:
            rows.setdefault(int(number), {})[stem] = value
        else:
            rows[1][name] = value
    return [rows[number] for number in sorted(rows)]


class FusionError(Exception):
    """No result; ``code`` says why and ``facts`` fill the sentence.

    A subclass declares in its class statement its code and the facts that it may have (otherwise those of its
    parent), each with its unit or meaning.

    ``fact_meanings``: the names allowed in ``facts``, each with its unit or meaning, in addition to those of
    :data:`PLACE`.
    """

    code: ClassVar[str]
    fact_meanings: ClassVar[Mapping[str, str]] = name_facts()

    def __init_subclass__(cls, *, code: str = "", **facts: str) -> None:
        if code:
            cls.code = code
        if facts:
            cls.fact_meanings = name_facts(**facts)

    def __init__(self, **facts: Fact) -> None:
        super().__init__(self.code, facts)
        self.facts = facts

    def __reduce__(self) -> tuple[object, tuple[object, ...]]:
        """Copy the error to another process with its facts."""
        return _restore, (type(self), self.facts)


def _restore(kind: type[FusionError], facts: Mapping[str, Fact]) -> FusionError:
    error = kind.__new__(kind)
    FusionError.__init__(error, **facts)
    return error


class UnreadableFile(FusionError, code="E-UNREADABLE"):
    """The bytes contain no samples."""


class FailedReader(
    UnreadableFile,
    code="E-READER",
    reader="name",
    version="of its package",
    cause="what went wrong, in English",
):
    """A reader of another package cannot be loaded, or fails."""


class UnknownFormat(UnreadableFile, code="E-TYPE", kind="what the bytes are"):
    """The file is not a recording with acceleration and angular rate."""


class UnsupportedFormat(
    UnknownFormat, code="E-FORMAT", device="name", export="what to export, and from which program"
):
    """A device's own format that is not read; its program exports a table."""


class EmptyFile(UnknownFormat, code="E-EMPTY"):
    """The file has 0 bytes."""


class WrongExtension(
    UnknownFormat,
    code="E-EXT",
    ext="extension of the name",
    kind="what the bytes are",
    right="extension that fits",
):
    """The file name indicates one format, the content another."""


class OldDevice(UnknownFormat, code="E-GT3X-OLD"):
    """A GT3X file of the generation without a gyroscope."""


class NoGyroscope(UnknownFormat, code="E-NO-GYRO", cure="device"):
    """Acceleration only; it cannot show elevation during motion."""


class NoGravity(UnknownFormat, code="E-NO-GRAVITY"):
    """Gravity was removed from the acceleration, so the angle has no reference."""


class SeveralSensors(
    UnknownFormat, code="E-SENSORS", n="sensors", list="names of the sensors", wanted="name that none has"
):
    """A table of several sensors, and the one on the arm was not named, or no sensor has that name."""


class NoPair(
    UnknownFormat,
    code="E-TABLES",
    why=TERM,
    cure=TERM,
    list="names of the tables, or the header line of the only one",
):
    """No two tables are the acceleration and the angular rate of one device, at the same time.

    The cure goes by the same term as the reason.
    """

    def __init__(self, why: str, **facts: Fact) -> None:
        super().__init__(why=why, cure=why, **facts)


class SeparateLines(UnknownFormat, code="E-LINES", list="a line of the file"):
    """Each line contains one sensor or one axis, and the lines cannot be grouped into samples."""


class EpochFile(UnknownFormat, code="E-EPOCH", sec="s of an epoch"):
    """Counts or epochs instead of raw samples."""


class UnknownColumns(
    UnknownFormat,
    code="E-COLS",
    list="the header line, or names of columns",
    missing="of ax ay az gx gy gz",
    doubled="of the same, there more than once",
    why=TERM,
):
    """The columns of the table are not recognised."""


class AmbiguousDecimal(UnknownFormat, code="E-DECIMAL"):
    """The comma is both separator and decimal mark."""


class DamagedFile(UnreadableFile, code="E-CORRUPT", p="% damaged"):
    """The file was a recording but is damaged."""


class BlankFile(DamagedFile, code="E-BLANK", n="bytes"):
    """Every byte is zero: space was reserved but nothing was written."""


class TruncatedArchive(DamagedFile, code="E-ZIP-TRUNC", n="bytes"):
    """The archive has lost its index."""


class CorruptArchive(DamagedFile, code="E-ZIP-CRC", member="name in the archive"):
    """A member fails its integrity check."""


class UnsafeArchive(
    DamagedFile, code="E-ZIP-UNSAFE", reason=TERM, limit="bytes, members or ratio, at most", count="members"
):
    """The archive is rejected because it may do harm."""


class MissingMember(DamagedFile, code="E-GT3X-PART", member="name in the archive"):
    """A part of the archive is missing."""


class RefusedXml(DamagedFile, code="E-XML", reason=TERM):
    """XML with entities or a document type, cut off, or not MVNX."""


class MissingSegment(UnreadableFile, code="E-SEGMENT", segment="name of the body segment"):
    """A motion capture without the body segment that the angle needs."""


class NoSamples(DamagedFile, code="E-NO-SAMPLES"):
    """A header without a sample after it."""


class UnusableShift(
    UnreadableFile,
    code="E-SHIFT",
    why=TERM,
    cure=TERM,
    window="interval, ISO 8601",
    value="clock time of the shift",
):
    """The recording has no clock or no sample in the shift, or its clock has an end of it twice or never."""


class UnreadableRows(DamagedFile, code="E-ROW", k="lines"):
    """More than 5 % of the lines cannot be read."""


class CutByExcel(DamagedFile, code="E-EXCEL-CUT"):
    """Exactly as many rows as Excel can store."""


class UnusableRecording(FusionError, code="E-UNUSABLE"):
    """Samples were read, but no angle can be trusted."""


class UnknownRate(
    UnusableRecording,
    code="E-RATE",
    m="Hz, measured",
    cure=TERM,
    unit="of the header's times",
    other_unit="of those times, instead",
    other_hz="Hz, by that unit",
):
    """The sampling rate cannot be determined."""


class UnusableTime(UnusableRecording, code="E-TIME", why=TERM, column="whose values advance like a time"):
    """The times cannot be used."""


class WrongScale(
    UnusableRecording,
    code="E-SCALE",
    g="g at rest",
    low_g="g at rest, least",
    high_g="g at rest, most",
    dps="deg/s, largest",
):
    """The reading at rest is not 1 g (facts: g; or low_g, high_g), or no sensor has such a rate (dps)."""


class UnknownUnit(
    UnusableRecording, code="E-UNIT", sensor=TERM, mixed=TERM, units="of x, y and z, in the header"
):
    """Neither the header nor rest and motion show the unit of a sensor, or the header states several."""


class MixedColumns(
    UnusableRecording,
    code="E-MIXED",
    percent="% unexplained",
    turns="stretches",
    factor="times, that would fit; negative: left-handed",
):
    """Gravity does not turn as the gyroscope indicates."""


class ExchangedSensors(UnusableRecording, code="E-SWAPPED"):
    """The acceleration columns look like a gyroscope, and the angular rate columns like gravity."""


class TooShort(UnusableRecording, code="E-SHORT", s="s analysed", left_out=TERM, left_out_s="s", cure=TERM):
    """Less than 10 s could be analysed."""


class TooLong(UnusableRecording, code="E-LONG", rows="millions of rows", most="millions of rows"):
    """More rows than any device records."""


class DeadSensor(UnusableRecording, code="E-DEAD", sensor=TERM, axis="x, y or z"):
    """A channel never changes its value."""


class UnusableCalibration(UnusableRecording, code="E-CALIBRATION", why=TERM, start_s="s", end_s="s"):
    """The requested calibration window cannot be used."""


class WrongAngle(UnusableRecording, code="E-ANGLE", value="deg"):
    """An elevation outside 0 to 180 deg."""


_OF_ROWS = {
    "why": TERM,
    "cure": TERM,
    "value": "as written",
    "text": "as written",
    "other": "line of a second row",
    "diary": "name of the file",
    "sheet": "name of the sheet",
    "more": "rows not listed",
}


class UnusableDiary(FusionError, code="E-DIARY", **_OF_ROWS):
    """Rows of the diary cannot be used.

    The facts of the second such row end in ``_2``, and so on.
    """


class UnusablePostures(UnusableDiary, code="E-POSTURE", **_OF_ROWS):
    """Rows of a file of postures, or the recording of the thigh that they come from, cannot be used."""


class UnusableClock(
    UnusableRecording, code="E-CLOCK", why=TERM, cure=TERM, value="start of the recording", zone="name"
):
    """The stated time zone or correction of the clock does not fit the start of the recording."""


class UnusableJoin(UnusableRecording, code="E-JOIN", why=TERM):
    """The files are not one shift of one device."""


class UnknownAxis(UnusableRecording, code="E-AXIS"):
    """An orientation without information on how the arm is oriented in it."""


class UnusableComparison(FusionError, code="E-COMPARISON"):
    """Two measurements cannot be compared."""


class NotAligned(
    UnusableComparison,
    code="E-ALIGN",
    r="correlation",
    least="correlation",
    motion_s="s",
    least_s="s",
    best="score of the best shift",
    rival="of another",
    margin_s="s",
    most_s="s",
):
    """No clock shift is a clear match."""


class NothingInCommon(UnusableComparison, code="E-OVERLAP", s="s in common"):
    """With this clock shift the two measurements have no time in common."""


class NoReference(UnusableComparison, code="E-REFERENCE"):
    """A recording of a study without a reference to compare it with."""


class UnusableTasks(FusionError, code="E-TASKS", why=TERM):
    """The task list cannot be used."""


class UnusableStudy(FusionError, code="E-STUDY", why=TERM):
    """The study folder contains nothing to compare."""


class UnusableProfile(FusionError, code="E-PROFILE", why=TERM, name="field of the profile"):
    """The column profile cannot be used."""


class UnusableArrays(
    UnusableRecording,
    ValueError,
    code="E-ARRAYS",
    why=TERM,
    acc="shape",
    gyr="shape",
    axis="as given",
    g="g, median length",
    rate_hz="Hz",
    value="as given",
    allowed="what can be",
):
    """The arrays cannot be fused."""
