"""Data types of a recording: evenly sampled segments, units, gaps and the caveats of reading."""

import math
from bisect import bisect_right
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from acromion.fusion.caveats import Caveat
from acromion.fusion.conventions import ArmAxis, PoseHeld

LONGEST_BRIDGE_US = 50_000

MAX_SPANS = 100

FloatArray = NDArray[np.float32] | NDArray[np.float64]
Float64Array = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

MICROSECONDS = 1_000_000

UnitSource = Literal["", "header", "stated"]
"""The source of both units: a known device's header, or column names or a person; "" if none states them."""


@dataclass(frozen=True, slots=True)
class QualityFlag:
    """A caveat about the results: one line of the data-quality box.

    ``code``: a :class:`acromion.fusion.caveats.Caveat`; plain text from a reader plug-in, or from a stored
    report.
    ``count``: how many times it was found.
    ``seconds``: total duration.
    ``first_s``, ``last_s``: seconds from the first sample; None if the caveat has no place.
    ``facts``: values for its sentence, by the names that the caveat declares.
    ``spans_s``: the stretches (start, end) it concerns, if known; only the longest if there are many.
    """

    code: str
    count: int = 1
    seconds: float = 0.0
    first_s: float | None = None
    last_s: float | None = None
    facts: Mapping[str, str | int | float] = field(default_factory=dict)
    spans_s: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True, slots=True)
class Span:
    """A stretch of the recording, in integer microseconds, so that sums are exact.

    ``start_us``: from the recording's first sample.
    ``duration_us``: its length.
    ``reason``: why it was excluded, if it was.
    """

    start_us: int
    duration_us: int
    reason: str = ""

    @property
    def end_us(self) -> int:
        """First microsecond after the stretch."""
        return self.start_us + self.duration_us


JOINED_US = 60 * MICROSECONDS
"""A shorter gap is not listed in an extent."""


@dataclass(frozen=True, slots=True)
class Extent:
    """The clock at the first sample, the duration, the digest, and when there are samples.

    ``covered_us``: the stretches (start, end) with samples, microseconds from the first sample; gaps of up to
    a minute are ignored.
    """

    start: datetime | None
    duration_us: int
    sha256: str = ""
    covered_us: tuple[tuple[int, int], ...] = ()


@dataclass(frozen=True, slots=True)
class Stated:
    """Units and timing that a file states, for the checks of units and axes.

    ``acc_unit``, ``gyr_unit``: a key of :data:`ACC_UNITS_G` or :data:`GYR_UNITS_DPS`, "registers" for raw
    sensor counts, or any word without a scale.
    ``is_known``: a known device's format or header states units and axes; the checks do not override it.
    ``left_gyr_factor``: factor for the rates if the frame proves left-handed; corrects an error of the
    device's library.
    ``is_counted``: the rows have no times; their rate comes from a person or a header.
    ``units_from``: what states both units; "" if the samples have to show them.
    ``nominal_rate_hz``: the rate that the device was set to; None if the file does not state it.
    """

    acc_unit: str = "g"
    gyr_unit: str = "deg/s"
    is_known: bool = False
    left_gyr_factor: float = 1.0
    is_counted: bool = False
    units_from: UnitSource = ""
    nominal_rate_hz: float | None = None


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class Segment:
    """An unbroken, evenly sampled run.

    ``start_us``: time of the first sample, microseconds from the recording's first sample.
    ``rate_hz``: fitted to the timestamps (the nominal rate is used only if there are none).
    ``acc_g``, ``gyr_dps``: shape (n, 3), float32, one right-handed frame, g and deg/s.
    ``bridged``: row ranges [first, stop) that were added by linear interpolation over a gap of at most 50 ms.
    They exist for the filters only: their time counts as missing and they are not valid.
    """

    start_us: int
    rate_hz: float
    acc_g: NDArray[np.float32]
    gyr_dps: NDArray[np.float32]
    bridged: tuple[tuple[int, int], ...] = ()

    def __len__(self) -> int:
        return len(self.acc_g)

    def __repr__(self) -> str:
        return f"Segment({len(self)} samples at {self.rate_hz:g} Hz from {self.start_s:g} s)"

    @property
    def duration_us(self) -> int:
        """Number of rows times the sample period."""
        return round(len(self) * MICROSECONDS / self.rate_hz)

    @property
    def end_us(self) -> int:
        """One period after the last sample."""
        return self.start_us + self.duration_us

    @property
    def start_s(self) -> float:
        """Seconds from the recording's first sample."""
        return self.start_us / MICROSECONDS


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """The content of a file: segments in time order, and the known absences between them.

    ``device``: one of :data:`acromion.fusion.devices.KNOWN_DEVICES`, "angles", "other", or a plug-in's own
    name.
    ``sha256``: of the file's bytes, hexadecimal.
    ``start``: the device's clock at the first sample, converted only to a zone that a person states. Aware
    if the file states its offset from UTC, naive if it does not, None if there is no clock.
    ``time_zone``: as a person ("Europe/Paris") or the file ("UTC-05:00") states it, or None.
    ``duration_us``: from the first timestamp to the last plus one period.
    ``segments``: unbroken runs of samples, in time order.
    ``excluded``: time that the device itself reports as not measured on the arm (reason "docked" or
    "asleep").
    ``flags``: caveats found while reading.
    ``understood``: the reader's interpretation of the file, for people: layout, columns, units, nominal rate.
    ``stated``: units and timing that the file states, for the checks.
    ``jitter_us``: deviation of the timestamps from an even grid; None if the reader does not measure it.
    ``serial_hash``: hash of the device's serial number; None if the file does not state it.
    ``acc_range_g``, ``gyr_range_dps``: full scale, for the clipping check; None if the file does not state
    it.
    ``reader``: name and version of the plug-in that read the file; None for a built-in reader.
    ``pose_windows_s``, ``arm_axis``, ``pose_held``: as the file states them: when a person held the pose
    (start, end), from the first sample; the sensor axis that was strapped along the arm; "start" if the pose
    was held at the start of wear. The settings of an analysis take precedence.
    ``worn_before``: the sensor was worn before the first sample, because a shift was cut out of a recording.
    ``clock_offset_s``: the correction of the clock that a person states, which ``start`` includes.
    """

    device: str
    sha256: str
    start: datetime | None
    time_zone: str | None
    duration_us: int
    segments: tuple[Segment, ...]
    excluded: tuple[Span, ...] = ()
    flags: tuple[QualityFlag, ...] = ()
    understood: Mapping[str, str] = field(default_factory=dict)
    stated: Stated = Stated()
    jitter_us: float | None = None
    serial_hash: str | None = None
    acc_range_g: float | None = None
    gyr_range_dps: float | None = None
    reader: tuple[str, str] | None = None
    pose_windows_s: tuple[tuple[float, float], ...] = ()
    arm_axis: ArmAxis | None = None
    pose_held: PoseHeld | None = None
    worn_before: bool = False
    clock_offset_s: float = 0.0

    def __repr__(self) -> str:
        start = f" from {self.start:%Y-%m-%d %H:%M}" if self.start else ""
        rate = f" at {self.rate_hz:g} Hz" if self.segments else ""
        hours = self.duration_us / MICROSECONDS / 3600.0
        return (
            f"Recording({self.device}{start}, {hours:.2f} h, "
            f"segments: {len(self.segments)}{rate}, flags: {len(self.flags)})"
        )

    @property
    def holds_samples(self) -> bool:
        """Whether an inertial sensor measured it; a precomputed angle has segments without samples."""
        return any(len(segment) for segment in self.segments)

    @property
    def rate_hz(self) -> float:
        """The rate of the longest segment."""
        return max(self.segments, key=len).rate_hz


def find_missing(
    segments: Sequence[Segment], duration_us: int, excluded: Sequence[Span] = ()
) -> tuple[Span, ...]:
    """Return all gaps in time order: between the segments, after the last, and the bridged ones.

    Excluded time is not missing, not even in a bridged gap.
    """
    known = [(segment.start_us, segment.end_us) for segment in segments]
    known += [(span.start_us, span.end_us) for span in excluded]
    uncovered = find_uncovered(known, 0, duration_us, 0)
    holes = [Span(start_us, end_us - start_us, "gap") for start_us, end_us in uncovered]
    starts_us = sorted(span.start_us for span in excluded)
    ends_us = sorted(span.end_us for span in excluded)
    for segment in segments:
        for first, stop in segment.bridged:
            start_us = segment.start_us + round(first * MICROSECONDS / segment.rate_hz)
            length_us = round((stop - first) * MICROSECONDS / segment.rate_hz)
            middle_us = start_us + length_us // 2
            if bisect_right(starts_us, middle_us) == bisect_right(ends_us, middle_us):
                holes.append(Span(start_us, length_us, "gap"))
    return tuple(sorted(holes, key=lambda hole: hole.start_us))


def flag_gaps(
    segments: Sequence[Segment], duration_us: int, excluded: Sequence[Span] = ()
) -> tuple[QualityFlag, ...]:
    """Return the flag of missing time (W-GAP)."""
    return flag_spans(Caveat.GAP, find_missing(segments, duration_us, excluded))


def flag_counts(
    counts: Mapping[Caveat, int], first_s: float | None = None, last_s: float | None = None
) -> tuple[QualityFlag, ...]:
    """Return one flag for each caveat found at least once, with its place in seconds if known."""
    return tuple(
        QualityFlag(caveat, count, 0.0, first_s, last_s) for caveat, count in counts.items() if count > 0
    )


def flag_spans(caveat: Caveat, spans: Sequence[Span], **facts: str | float) -> tuple[QualityFlag, ...]:
    """Return one flag for all spans of a kind: number, total duration and place; none if there is none."""
    if not spans:
        return ()
    total_s = sum(span.duration_us for span in spans) / MICROSECONDS
    first_s, last_s = spans[0].start_us / MICROSECONDS, spans[-1].end_us / MICROSECONDS
    longest = sorted(spans, key=lambda span: -span.duration_us)[:MAX_SPANS]
    longest_s = tuple(sorted((span.start_us / MICROSECONDS, span.end_us / MICROSECONDS) for span in longest))
    return (QualityFlag(caveat, len(spans), total_s, first_s, last_s, facts, longest_s),)


def flag_stretches(
    caveat: Caveat,
    spans_s: Sequence[tuple[float, float]],
    facts: Mapping[str, str | int | float] | None = None,
) -> QualityFlag:
    """Return one flag for at least one stretch (start, end), s, in time order."""
    seconds = sum(end_s - start_s for start_s, end_s in spans_s)
    first_s, last_s = spans_s[0][0], spans_s[-1][1]
    return QualityFlag(caveat, len(spans_s), seconds, first_s, last_s, facts or {}, tuple(spans_s))


# Stretches of time or ranges of rows, (start, end).

Number = TypeVar("Number", int, float)


def join_overlapping(spans: Iterable[tuple[Number, Number]]) -> list[tuple[Number, Number]]:
    """Return the spans in order, with those in contact merged."""
    joined: list[tuple[Number, Number]] = []
    for start, end in sorted(spans):
        if joined and start <= joined[-1][1]:
            joined[-1] = (joined[-1][0], max(joined[-1][1], end))
        else:
            joined.append((start, end))
    return joined


def measure_samples(recording: Recording) -> Extent:
    """Return when a recording has samples."""
    covered_us = find_covered((segment.start_us, segment.end_us) for segment in recording.segments)
    return Extent(recording.start, recording.duration_us, recording.sha256, covered_us)


def find_covered(spans: Iterable[tuple[int, int]]) -> tuple[tuple[int, int], ...]:
    """Return the stretches with samples, joined over gaps of up to a minute."""
    return tuple((a, b - JOINED_US) for a, b in join_overlapping((a, b + JOINED_US) for a, b in spans))


def cut_windows(
    windows_s: Iterable[tuple[float, float]], first_us: int, stop_us: int
) -> tuple[tuple[float, float], ...]:
    """Return the windows within a stretch, in seconds from its start instead of the recording's."""
    first_s, stop_s = first_us / MICROSECONDS, stop_us / MICROSECONDS
    return tuple((a - first_s, b - first_s) for a, b in windows_s if first_s <= a and b <= stop_s)


def find_uncovered(
    spans: Iterable[tuple[Number, Number]], start: Number, end: Number, tolerance: Number
) -> list[tuple[Number, Number]]:
    """Return the stretches between ``start`` and ``end`` without a span, if longer than ``tolerance``."""
    uncovered: list[tuple[Number, Number]] = []
    covered = sorted(spans)
    covered.append((end, end))
    for first, stop in covered:
        if first - start > tolerance:
            uncovered.append((start, first))
        start = max(start, stop)
    return uncovered


# Units of acceleration and angular rate, by the words that people and loggers write.

STANDARD_GRAVITY = 9.80665
DEG_PER_RAD = math.degrees(1.0)
METRE_WORDS = ("m/s2", "ms2", "mps2", "m/s/s", "mss", "m/sec2", "ms-2", "m.s-2", "meters/s2")
ACC_UNITS_G = {
    **dict.fromkeys(("g", "gs", "gn"), 1.0),
    "mg": 1e-3,
    **dict.fromkeys(METRE_WORDS, 1 / STANDARD_GRAVITY),
    **dict.fromkeys(("cm/s2", "gal"), 1e-2 / STANDARD_GRAVITY),
    "mm/s2": 1e-3 / STANDARD_GRAVITY,
}
DEGREE_WORDS = (
    *("dps", "deg/s", "degs", "deg/sec", "degrees/s", "degrees/sec", "degps", "degs-1", "degpersec"),
    *("deg.s-1", "degres/s", "degre/s", "degres/sec"),
)
GYR_UNITS_DPS = {
    **dict.fromkeys(DEGREE_WORDS, 1.0),
    **dict.fromkeys(("mdps", "mdeg/s"), 1e-3),
    **dict.fromkeys(
        ("rad/s", "rads", "rps", "rad/sec", "radps", "rads-1", "radian/s", "radians/s"), DEG_PER_RAD
    ),
}


def name_unit_source(acc_unit: str | None, gyr_unit: str | None, *, is_known: bool = False) -> UnitSource:
    """Return "header" if a known device states both units, "stated" if names or a person do, else ""."""
    if not (acc_scale_g(acc_unit) and gyr_scale_dps(gyr_unit)):
        return ""
    return "header" if is_known else "stated"


def acc_scale_g(unit: str | None) -> float | None:
    """Return the factor to g; None if the unit is unknown or raw counts."""
    return ACC_UNITS_G.get(unit) if unit else None


def gyr_scale_dps(unit: str | None) -> float | None:
    """Return the factor to deg/s; None if the unit is unknown or raw counts."""
    return GYR_UNITS_DPS.get(unit) if unit else None
