"""Why no number can be given.

An error means that no number can be given; a flag (:class:`fusion.recording.QualityFlag`) means a number
with a caveat; anything else that is raised is a bug. An error carries a fixed code and facts, never a
sentence: the sentences live in the wording files of ``app/report/words``.

    FusionError
      UnreadableFile
        UnknownFormat   what the bytes are is not a recording (wrong type, wrong name, epochs, no gyroscope)
        DamagedFile     it was a recording once (cut, corrupt, unsafe archive)
      UnusableRecording it can be read, but no angle can be trusted (too short, dead axis, wrong scale)
      UnusableDiary     the list of periods that came with it cannot be followed
"""

from typing import ClassVar

Fact = str | int | float


class FusionError(Exception):
    """No number can be given; ``code`` says why and ``facts`` fill the sentence.

    The facts ``line``, ``byte`` and ``clock``, where present, are the place in the file.
    """

    code: ClassVar[str]

    def __init__(self, **facts: Fact) -> None:
        super().__init__(self.code, facts)
        self.facts = facts


class UnreadableFile(FusionError):
    """The bytes do not give samples."""

    code = "E-UNREADABLE"


class UnknownFormat(UnreadableFile):
    """The bytes are something other than a recording with acceleration and angular rate."""

    code = "E-TYPE"


class EmptyFile(UnknownFormat):
    """The file has no byte."""

    code = "E-EMPTY"


class WrongExtension(UnknownFormat):
    """The name says one format, the content another. Facts: ext, kind, right."""

    code = "E-EXT"


class OldDevice(UnknownFormat):
    """A GT3X of the generation without a gyroscope."""

    code = "E-GT3X-OLD"


class NoGyroscope(UnknownFormat):
    """Acceleration only: elevation in motion cannot be told from acceleration. Facts: cure (the device)."""

    code = "E-NO-GYRO"


class EpochFile(UnknownFormat):
    """Counts or epochs instead of raw samples. Facts: sec."""

    code = "E-EPOCH"


class UnknownColumns(UnknownFormat):
    """A table whose columns are not recognised. Facts: list."""

    code = "E-COLS"


class AmbiguousDecimal(UnknownFormat):
    """The comma is both separator and decimal mark. Facts: line."""

    code = "E-DECIMAL"


class DamagedFile(UnreadableFile):
    """It was a recording once."""

    code = "E-CORRUPT"


class BlankFile(DamagedFile):
    """Every byte is zero: room was kept, nothing was written. Facts: n (bytes)."""

    code = "E-BLANK"


class TruncatedArchive(DamagedFile):
    """The archive has lost its index. Facts: n (bytes)."""

    code = "E-ZIP-TRUNC"


class CorruptArchive(DamagedFile):
    """A member fails its integrity check. Facts: member."""

    code = "E-ZIP-CRC"


class UnsafeArchive(DamagedFile):
    """The archive is refused before it can do harm. Facts: reason."""

    code = "E-ZIP-UNSAFE"


class MissingMember(DamagedFile):
    """A part of the archive is missing. Facts: member."""

    code = "E-GT3X-PART"


class RefusedXml(DamagedFile):
    """XML with entities or a document type, cut off, or no MVNX. Facts: reason."""

    code = "E-XML"


class MissingSegment(UnreadableFile):
    """A motion capture without what the angle is taken from. Facts: segment."""

    code = "E-SEGMENT"


class UnreadableRows(DamagedFile):
    """More than 5 % of the lines cannot be read. Facts: k, line."""

    code = "E-ROW"


class CutByExcel(DamagedFile):
    """Exactly as many rows as Excel can hold."""

    code = "E-EXCEL-CUT"


class UnusableRecording(FusionError):
    """Samples, but none whose angle could be trusted."""

    code = "E-UNUSABLE"


class UnknownRate(UnusableRecording):
    """The sampling rate cannot be determined. Facts: m (measured), cure; unit (of the header's times), and
    other_unit with other_hz, the rate that it would give.
    """

    code = "E-RATE"


class UnusableTime(UnusableRecording):
    """No usable time. Facts: why."""

    code = "E-TIME"


class WrongScale(UnusableRecording):
    """At rest no 1 g (facts: g; or low_g, high_g), or a rate that no part can read (dps)."""

    code = "E-SCALE"


class MixedColumns(UnusableRecording):
    """Gravity does not turn as the gyroscope says. Facts: percent (unexplained), turns; or lag_ms."""

    code = "E-MIXED"


class ExchangedSensors(UnusableRecording):
    """The columns of the acceleration read like a gyroscope, and those of the angular rate like gravity."""

    code = "E-SWAPPED"


class TooShort(UnusableRecording):
    """Less than 10 s could be analysed. Facts: s; left_out (what left out most), left_out_s, cure."""

    code = "E-SHORT"


class TooLong(UnusableRecording):
    """More rows than any device records. Facts: rows, most (millions)."""

    code = "E-LONG"


class DeadSensor(UnusableRecording):
    """A channel never changes its value, or stops at one row in ten. Facts: sensor, axis."""

    code = "E-DEAD"


class UnusableCalibration(UnusableRecording):
    """The calibration window asked for is not usable. Facts: why, start_s, end_s."""

    code = "E-CALIBRATION"


class WrongAngle(UnusableRecording):
    """An elevation outside 0 to 180 deg. Facts: value, line."""

    code = "E-ANGLE"


class UnusableDiary(FusionError):
    """Rows of the diary cannot be used. Facts: line, why, cure, value, text; other (a second line). Those of
    the second row that cannot be used end in ``_2``, and so on; ``more`` counts what is not told.
    """

    code = "E-DIARY"


class UnusableJoin(UnusableRecording):
    """Files that are not one shift of one device. Facts: why."""

    code = "E-JOIN"


class UnknownAxis(UnusableRecording):
    """An orientation of which nothing says how the arm lies in it."""

    code = "E-AXIS"


class UnusableComparison(FusionError):
    """Two measurements that cannot be set beside each other."""

    code = "E-COMPARISON"


class NotAligned(UnusableComparison):
    """No shift of the clocks surely fits. Facts: r, least; or motion_s, least_s; or best, rival."""

    code = "E-ALIGN"


class NothingInCommon(UnusableComparison):
    """Under this shift of the clocks the two have no time in common. Facts: s."""

    code = "E-OVERLAP"


class NoReference(UnusableComparison):
    """A recording of a study with nothing beside it to compare it with."""

    code = "E-REFERENCE"


class UnusableTasks(FusionError):
    """A list of tasks that cannot be used. Facts: line, why."""

    code = "E-TASKS"


class UnusableStudy(FusionError):
    """A study folder in which nothing can be compared. Facts: why."""

    code = "E-STUDY"


class UnusableProfile(FusionError):
    """A column profile that says nothing usable. Facts: why, name."""

    code = "E-PROFILE"
