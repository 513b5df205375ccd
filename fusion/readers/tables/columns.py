"""The meaning of a column's name: channel, axis, unit.

The alias table was gathered from the layouts seen in the wild (libraries of Arduino, SparkFun, Adafruit,
x-io, ActiLife, Xsens, phone loggers), with the names of French exports.
"""

import math
import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from statistics import median
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from fusion.caveats import Caveat
from fusion.errors import UnknownRate
from fusion.readers.samples import SampleColumns
from fusion.readers.timebase.clock import datetime_at_us, is_clock_set
from fusion.readers.timebase.grid import FASTEST_HZ, SLOWEST_HZ
from fusion.recording import MICROSECONDS, QualityFlag

Channel = Literal["acc", "gyr", "time", "counter", "other"]

ACC_STEMS = frozenset(
    {"a", "acc", "accel", "accelerometer", "acceleration", "accelero", "gf", "gforce", "xl"}
    | {"accelerometre"}
)
GYR_STEMS = frozenset(
    {"g", "gy", "gyr", "gyro", "gyroscope", "w", "omega", "rot", "rate", "rotation", "rotationrate"}
    | {"angularrate", "angularvelocity", "angvel", "angrate", "av"}
    | {"gyrometre", "vitesseangulaire", "vitesserotation", "vitessederotation", "tauxderotation"}
)
TIME_STEMS = frozenset(
    {
        "t",
        "time",
        "date",
        "timestamp",
        "times",
        "timestamps",
        "datetime",
        "ts",
        "clock",
        "elapsed",
        "elapsedtime",
    }
    | {"micros", "millis", "epoch", "unixtime", "unix", "sampletimefine", "seconds", "milliseconds"}
    | {
        "microseconds",
        "nanoseconds",
        "temps",
        "horodatage",
        "horodate",
        "heure",
        "dateheure",
        "dateetheure",
        "horloge",
        "secondes",
        "millisecondes",
        "microsecondes",
        "epochtime",
        "systemtime",
        "devicetime",
        "us",
        "ms",
        "usec",
        "msec",
        "sec",
        "secs",
    }
)
COUNTER_STEMS = frozenset(
    {"index", "sample", "samples", "nsamples", "samplenumber", "packetcounter", "counter", "packet"}
    | {"row", "n", "samplecount", "count", "sequence", "seq"}
    | {"compteur", "echantillon", "numero", "ligne", "paquet"}
)
AXIS_WORDS = ("axis", "axe")
PREFIXES = ("lsm9ds1", "imu", "sensor", "raw", "cal", "calib", "calibrated")

TIME_UNITS_EXPONENT = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds", "secondes"), 6),
    **dict.fromkeys(("ms", "msec", "millis", "milliseconds", "millisecondes"), 3),
    **dict.fromkeys(("us", "usec", "micros", "microseconds", "microsecondes"), 0),
    **dict.fromkeys(("ns", "nsec", "nanos", "nanoseconds"), -3),
}


@dataclass(frozen=True, slots=True)
class Column:
    """A column understood: ``axis`` 0 to 2 for acceleration and angular rate, ``unit`` as written or None."""

    name: str
    channel: Channel
    axis: int = 0
    unit: str | None = None


def parse_column_name(name: str) -> Column:
    """Find channel, axis and unit of a header's field."""
    text = _tidy(name)
    plain, unit = _split_bracketed(text)
    vector = _match_vector(name, plain, unit)
    if vector is not None:
        return vector
    stem, unit_word = _split_time_unit(plain)
    if stem in TIME_STEMS or (not stem and unit_word):
        return Column(name, "time", unit=_time_unit(stem, unit or unit_word))
    if stem.removeprefix("imu") in COUNTER_STEMS:
        return Column(name, "counter")
    return Column(name, "other")


def _tidy(name: str) -> str:
    text = name.strip().strip('"').strip().lower()
    for old, new in (("µ", "u"), ("μ", "u"), ("²", "2"), ("^", ""), ("°", "deg"), ("**", ""), ("·", ".")):
        text = text.replace(old, new)
    return "".join(sign for sign in unicodedata.normalize("NFD", text) if not unicodedata.combining(sign))


def _split_bracketed(text: str) -> tuple[str, str | None]:
    found = re.search(r"[\(\[\{]\s*([^\)\]\}]*?)\s*[\)\]\}]", text)
    if found is None:
        return text, None
    return (text[: found.start()] + text[found.end() :]).strip(), re.sub(r"\s+", "", found.group(1))


def _match_vector(name: str, plain: str, unit: str | None) -> Column | None:
    found = re.fullmatch(
        r"([a-z0-9 _.\-]*?)[ _.\-]*([xyz])(?:[ _.\-]*axis)?(?:[ _.\-]+([a-z0-9/_.\-]+))?", plain
    )
    if found is None:
        return None
    stem, axis, suffix = found.groups()
    word = re.sub(r"[ _.\-]", "", stem)
    for prefix in PREFIXES:
        word = word.removeprefix(prefix) or word
    for axis_word in AXIS_WORDS:
        word = word.removesuffix(axis_word) or word
    channel: Channel = "acc" if word in ACC_STEMS else "gyr" if word in GYR_STEMS else "other"
    if channel == "other":
        return Column(name, "other") if word else None
    if unit is None and suffix:
        unit = suffix.replace("_per_", "/").replace("_", "")
    if word in ("gf", "gforce"):
        unit = unit or "g"
    return Column(name, channel, "xyz".index(axis), unit)


def _split_time_unit(plain: str) -> tuple[str, str | None]:
    words = [word for word in re.split(r"[ _.\-]+", plain) if word]
    if len(words) > 1 and words[-1] in TIME_UNITS_EXPONENT:
        return "".join(words[:-1]), words[-1]
    return "".join(words), None


def _time_unit(stem: str, unit: str | None) -> str | None:
    if unit in TIME_UNITS_EXPONENT:
        return unit
    return stem if stem in TIME_UNITS_EXPONENT else None


def choose_vector(columns: Sequence[Column], channel: Channel) -> tuple[int, int, int] | None:
    """Places of x, y, z of a channel; None unless each is there exactly once."""
    places = [
        [k for k, c in enumerate(columns) if c.channel == channel and c.axis == axis] for axis in range(3)
    ]
    if any(len(found) != 1 for found in places):
        return None
    return places[0][0], places[1][0], places[2][0]


# The unit of a column of times: that of its name, or the one in which the rows come at a plausible rate.
#
# The candidates (s, ms, us, ns) lie a factor of 1000 apart and the rates span 250: at most one fits.


PLAUSIBLE_RATE_HZ = (8.0, 2000.0)
SMOOTH_RATIO = 0.3
"""Of readings that have nothing to do with each other, as of an arm every few seconds, the ratio is 1."""
LOOKED_AT_ROWS = 1 << 18
UNIT_NAMES = {TIME_UNITS_EXPONENT[unit]: unit for unit in ("s", "ms", "us", "ns")}


@dataclass(frozen=True, slots=True)
class TimeUnit:
    """Power of ten to microseconds, and that of the unit in the header where it cannot be.

    ``stated_hz``, ``rate_hz``: at what rate the first rows come, by the header and as taken.
    """

    exponent: int
    stated_exponent: int | None = None
    stated_hz: float = 0.0
    rate_hz: float = 0.0

    def flag(self) -> tuple[QualityFlag, ...]:
        """Flag that the header's unit was replaced (W-UNITS)."""
        if self.stated_exponent is None:
            return ()
        names = {"unit": UNIT_NAMES[self.stated_exponent], "read_as": UNIT_NAMES[self.exponent]}
        rate_hz = round(self.rate_hz, 3)
        facts: dict[str, str | int | float] = {
            "what": "time",
            "evidence": "rate",
            **names,
            "rate_hz": rate_hz,
        }
        return (QualityFlag(Caveat.UNITS, facts=facts),)

    def refuse_doubtful(self, columns: SampleColumns) -> None:
        """Refuse rows so slow by the header that only the readings can tell, where they do not.

        Raises
        ------
        UnknownRate
        """
        if self.stated_exponent is None or self.stated_hz >= SLOWEST_HZ:
            return
        if all(measure_roughness(values) < SMOOTH_RATIO for values in (columns.acc, columns.gyr)):
            return
        raise UnknownRate(
            m=round(self.stated_hz, 4),
            unit=UNIT_NAMES[self.stated_exponent],
            other_unit=UNIT_NAMES[self.exponent],
            other_hz=round(self.rate_hz, 3),
            cure="time unit",
        )


IN_MICROSECONDS = TimeUnit(0)


def find_time_unit(times: Sequence[float], unit: str | None) -> TimeUnit | None:
    """Find the unit of a column by its first times; None where neither header nor times give one.

    A unit in the header holds, unless no sensor writes rows so fast or so slowly and another unit fits. The
    time since 1970 keeps the header's unit, however slowly the rows come.
    """
    stated = TIME_UNITS_EXPONENT[unit] if unit else None
    times = [time for time in times if math.isfinite(time)]  # a damaged row holds no time
    found = guess_exponent(times)
    if stated is None:
        return None if found is None else TimeUnit(found)
    stated_hz = _rate_hz(times, stated)
    is_possible = SLOWEST_HZ <= stated_hz <= FASTEST_HZ or any(_is_epoch(time, stated) for time in times[:1])
    if found is None or is_possible:
        return TimeUnit(stated)
    return TimeUnit(found, stated, stated_hz, _rate_hz(times, found))


def guess_exponent(times: Sequence[float]) -> int | None:
    """The unit in which the rows would come at 8 to 2000 Hz; None where none does."""
    slowest_hz, fastest_hz = PLAUSIBLE_RATE_HZ
    return next((one for one in UNIT_NAMES if slowest_hz <= _rate_hz(times, one) <= fastest_hz), None)


def _rate_hz(times: Sequence[float], exponent: int) -> float:
    """The rate by the usual step, 0 where the times do not advance; the newest row may stand first."""
    steps = [after - before for before, after in pairwise(times)]
    if not steps:
        return 0.0
    if 2 * sum(step < 0 for step in steps) > sum(step != 0 for step in steps):
        steps = [-step for step in steps]
    # mean of the advancing steps: coarse stamps repeat
    step = median(steps) or sum(max(0.0, s) for s in steps) / len(steps)
    return MICROSECONDS / (step * 10.0**exponent) if step > 0 else 0.0


def _is_epoch(time: float, exponent: int) -> bool:
    moment = datetime_at_us(round(time * 10.0**exponent))
    return moment is not None and is_clock_set(moment)


def measure_roughness(values: NDArray[np.float32]) -> float:
    """How far readings are from those before, shape (n, 3), as a share of how far any two are apart.

    von Neumann's ratio (Ann Math Stat 1941;12:367), halved, of all axes together: 0 smooth, 1 unrelated.
    """
    values = values[:LOOKED_AT_ROWS]
    if len(values) < 2:
        return 1.0
    steps = float(np.square(np.diff(values, axis=0), dtype=np.float64).sum()) / (len(values) - 1)
    spread = float(values.var(axis=0, dtype=np.float64).sum())
    return steps / (2.0 * spread) if spread > 0.0 else 1.0
