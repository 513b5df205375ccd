"""Why no number can be given.

An error means that no number can be given; a caveat (:mod:`fusion.caveats`) means a number with something to
know about it; anything else that is raised is a bug. An error carries a fixed code and facts, never a
sentence: the sentences stand under its code in ``app/report/words``, and the table in ``docs/codes.md`` is
generated from here.

    FusionError
      UnreadableFile
        UnknownFormat   what the bytes are is not a recording (wrong type, wrong name, epochs, no gyroscope)
        DamagedFile     it was a recording once (cut, corrupt, unsafe archive)
      UnusableRecording it can be read, but no angle can be trusted (too short, dead axis, wrong scale)
      UnusableDiary     the list of periods that came with it cannot be followed
"""

from collections.abc import Mapping, Sequence
from typing import ClassVar

from fusion.caveats import TERM, name_facts

Fact = str | int | float
PLACE = name_facts(
    line="line of the file",
    byte="byte of the file",
    clock="time in the recording",
    header="identity of the header of a table",
)
"""Where in the file it is, of any refusal that knows it."""


MOST_ROWS_NAMED = 20


def join_facts(rows: Sequence[Mapping[str, Fact]]) -> dict[str, Fact]:
    """Return the facts of several rows as those of one refusal: the second row's end in ``_2``, and so on.

    Beyond twenty rows, ``more`` counts the others.
    """
    facts = dict(rows[0])
    for number, row in enumerate(rows[1:MOST_ROWS_NAMED], 2):
        facts |= {f"{name}_{number}": value for name, value in row.items()}
    if len(rows) > MOST_ROWS_NAMED:
        facts["more"] = len(rows) - MOST_ROWS_NAMED
    return facts


class FusionError(Exception):
    """No number can be given; ``code`` says why and ``facts`` fill the sentence.

    Attributes
    ----------
    fact_meanings
        The names that ``facts`` may hold, each with its unit or meaning; those of :data:`PLACE` beside them.
    """

    code: ClassVar[str]
    fact_meanings = name_facts()

    def __init__(self, **facts: Fact) -> None:
        super().__init__(self.code, facts)
        self.facts = facts


class UnreadableFile(FusionError):
    """The bytes do not give samples."""

    code = "E-UNREADABLE"


class FailedReader(UnreadableFile):
    """A reader of another package cannot be loaded, or fails."""

    code = "E-READER"
    fact_meanings = name_facts(reader="name", version="of its package", cause="what went wrong, in English")


class UnknownFormat(UnreadableFile):
    """The bytes are something other than a recording with acceleration and angular rate."""

    code = "E-TYPE"
    fact_meanings = name_facts(kind="what the bytes are")


class EmptyFile(UnknownFormat):
    """The file has no byte."""

    code = "E-EMPTY"


class WrongExtension(UnknownFormat):
    """The name says one format, the content another."""

    code = "E-EXT"
    fact_meanings = name_facts(
        ext="extension of the name", kind="what the bytes are", right="extension that fits"
    )


class OldDevice(UnknownFormat):
    """A GT3X of the generation without a gyroscope."""

    code = "E-GT3X-OLD"


class NoGyroscope(UnknownFormat):
    """Acceleration only: elevation in motion cannot be told from acceleration."""

    code = "E-NO-GYRO"
    fact_meanings = name_facts(cure="device")


class NoGravity(UnknownFormat):
    """Gravity was taken out of the acceleration: nothing is left to measure an angle against."""

    code = "E-NO-GRAVITY"


class SeveralSensors(UnknownFormat):
    """A table of several sensors, and nobody said which one is on the arm, or none has that name."""

    code = "E-SENSORS"
    fact_meanings = name_facts(n="sensors", list="names of the sensors", wanted="name that none has")


class EpochFile(UnknownFormat):
    """Counts or epochs instead of raw samples."""

    code = "E-EPOCH"
    fact_meanings = name_facts(sec="s of an epoch")


class UnknownColumns(UnknownFormat):
    """A table whose columns are not recognised."""

    code = "E-COLS"
    fact_meanings = name_facts(
        list="the header line, or names of columns", missing="of ax ay az gx gy gz", why=TERM
    )


class AmbiguousDecimal(UnknownFormat):
    """The comma is both separator and decimal mark."""

    code = "E-DECIMAL"


class DamagedFile(UnreadableFile):
    """It was a recording once."""

    code = "E-CORRUPT"
    fact_meanings = name_facts(p="% damaged")


class BlankFile(DamagedFile):
    """Every byte is zero: room was kept, nothing was written."""

    code = "E-BLANK"
    fact_meanings = name_facts(n="bytes")


class TruncatedArchive(DamagedFile):
    """The archive has lost its index."""

    code = "E-ZIP-TRUNC"
    fact_meanings = name_facts(n="bytes")


class CorruptArchive(DamagedFile):
    """A member fails its integrity check."""

    code = "E-ZIP-CRC"
    fact_meanings = name_facts(member="name in the archive")


class UnsafeArchive(DamagedFile):
    """The archive is refused before it can do harm."""

    code = "E-ZIP-UNSAFE"
    fact_meanings = name_facts(reason=TERM, limit="bytes, members or ratio, at most", count="members")


class MissingMember(DamagedFile):
    """A part of the archive is missing."""

    code = "E-GT3X-PART"
    fact_meanings = name_facts(member="name in the archive")


class RefusedXml(DamagedFile):
    """XML with entities or a document type, cut off, or no MVNX."""

    code = "E-XML"
    fact_meanings = name_facts(reason=TERM)


class MissingSegment(UnreadableFile):
    """A motion capture without what the angle is taken from."""

    code = "E-SEGMENT"
    fact_meanings = name_facts(segment="name of the body segment")


class NoSamples(DamagedFile):
    """A header, and no sample after it."""

    code = "E-NO-SAMPLES"


class UnreadableRows(DamagedFile):
    """More than 5 % of the lines cannot be read."""

    code = "E-ROW"
    fact_meanings = name_facts(k="lines")


class CutByExcel(DamagedFile):
    """Exactly as many rows as Excel can hold."""

    code = "E-EXCEL-CUT"


class UnusableRecording(FusionError):
    """Samples, but none whose angle could be trusted."""

    code = "E-UNUSABLE"


class UnknownRate(UnusableRecording):
    """The sampling rate cannot be determined."""

    code = "E-RATE"
    fact_meanings = name_facts(
        m="Hz, measured",
        cure=TERM,
        unit="of the header's times",
        other_unit="of those times, instead",
        other_hz="Hz, by that unit",
    )


class UnusableTime(UnusableRecording):
    """No usable time."""

    code = "E-TIME"
    fact_meanings = name_facts(why=TERM)


class WrongScale(UnusableRecording):
    """At rest no 1 g (facts: g; or low_g, high_g), or a rate that no part can read (dps)."""

    code = "E-SCALE"
    fact_meanings = name_facts(
        g="g at rest", low_g="g at rest, least", high_g="g at rest, most", dps="deg/s, largest"
    )


class UnknownUnit(UnusableRecording):
    """Neither the header nor rest and motion settle the unit of a sensor."""

    code = "E-UNIT"
    fact_meanings = name_facts(sensor=TERM)


class MixedColumns(UnusableRecording):
    """Gravity does not turn as the gyroscope says."""

    code = "E-MIXED"
    fact_meanings = name_facts(
        percent="% unexplained", turns="stretches", factor="times, that would fit; negative: left-handed"
    )


class ExchangedSensors(UnusableRecording):
    """The columns of the acceleration read like a gyroscope, and those of the angular rate like gravity."""

    code = "E-SWAPPED"


class TooShort(UnusableRecording):
    """Less than 10 s could be analysed."""

    code = "E-SHORT"
    fact_meanings = name_facts(s="s analysed", left_out=TERM, left_out_s="s", cure=TERM)


class TooLong(UnusableRecording):
    """More rows than any device records."""

    code = "E-LONG"
    fact_meanings = name_facts(rows="millions of rows", most="millions of rows")


class DeadSensor(UnusableRecording):
    """A channel never changes its value."""

    code = "E-DEAD"
    fact_meanings = name_facts(sensor=TERM, axis="x, y or z")


class UnusableCalibration(UnusableRecording):
    """The calibration window asked for is not usable."""

    code = "E-CALIBRATION"
    fact_meanings = name_facts(why=TERM, start_s="s", end_s="s")


class WrongAngle(UnusableRecording):
    """An elevation outside 0 to 180 deg."""

    code = "E-ANGLE"
    fact_meanings = name_facts(value="deg")


class UnusableDiary(FusionError):
    """Rows of the diary cannot be used.

    The facts of the second row that cannot be used end in ``_2``, and so on.
    """

    code = "E-DIARY"
    fact_meanings = name_facts(
        why=TERM,
        cure=TERM,
        value="as written",
        text="as written",
        other="line of a second row",
        diary="name of the file",
        more="rows not told",
    )


class UnusableJoin(UnusableRecording):
    """Files that are not one shift of one device."""

    code = "E-JOIN"
    fact_meanings = name_facts(why=TERM)


class UnknownAxis(UnusableRecording):
    """An orientation of which nothing says how the arm lies in it."""

    code = "E-AXIS"


class UnusableComparison(FusionError):
    """Two measurements that cannot be set beside each other."""

    code = "E-COMPARISON"


class NotAligned(UnusableComparison):
    """No shift of the clocks surely fits."""

    code = "E-ALIGN"
    fact_meanings = name_facts(
        r="correlation",
        least="correlation",
        motion_s="s",
        least_s="s",
        best="worth of the best shift",
        rival="of another",
    )


class NothingInCommon(UnusableComparison):
    """Under this shift of the clocks the two have no time in common."""

    code = "E-OVERLAP"
    fact_meanings = name_facts(s="s in common")


class NoReference(UnusableComparison):
    """A recording of a study with nothing beside it to compare it with."""

    code = "E-REFERENCE"


class UnusableTasks(FusionError):
    """A list of tasks that cannot be used."""

    code = "E-TASKS"
    fact_meanings = name_facts(why=TERM)


class UnusableStudy(FusionError):
    """A study folder in which nothing can be compared."""

    code = "E-STUDY"
    fact_meanings = name_facts(why=TERM)


class UnusableProfile(FusionError):
    """A column profile that says nothing usable."""

    code = "E-PROFILE"
    fact_meanings = name_facts(why=TERM, name="field of the profile")
