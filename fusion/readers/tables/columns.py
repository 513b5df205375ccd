"""The meaning of a column's name: channel, axis, unit.

The alias table was gathered from the layouts seen in the wild (libraries of Arduino, SparkFun, Adafruit,
x-io, ActiLife, Xsens, phone loggers), with the names of French exports.
"""

import math
import re
import unicodedata
from collections import Counter
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
from fusion.units import ACC_UNITS_G, GYR_UNITS_DPS

Channel = Literal["acc", "gyr", "linear", "gravity", "time", "counter", "other"]
"""``linear``: an acceleration from which gravity was taken out."""

ACC_STEMS = frozenset(
    {"a", "acc", "accel", "accelerometer", "acceleration", "accelero", "gf", "gforce", "xl"}
    | {"accelerometre", "accelwr", "accelln", "widerangeaccelerometer", "lownoiseaccelerometer"}
)
NARROW_STEMS = frozenset({"accelln", "lownoiseaccelerometer"})
"""Of a Shimmer's two accelerometers the one that ends at 2 g, where an arm at work does not."""
LINEAR_STEMS = frozenset(
    {"linearacceleration", "linearaccelerometer", "linearaccel", "linearacc", "linacc", "linaccel"}
    | {"useracceleration", "useraccel", "useracc", "freeacc", "freeacceleration", "accelerationlineaire"}
)
GRAVITY_STEMS = frozenset({"gravity", "grav", "gravite"})
GYR_STEMS = frozenset(
    {"g", "gy", "gyr", "gyro", "gyroscope", "w", "omega", "rot", "rate", "rotation", "rotationrate"}
    | {"angularrate", "angularvelocity", "angvel", "angrate", "av"}
    | {"gyrometre", "vitesseangulaire", "vitesserotation", "vitessederotation", "tauxderotation"}
)
STEMS: tuple[tuple[Channel, frozenset[str]], ...] = (
    ("acc", ACC_STEMS),
    ("gyr", GYR_STEMS),
    ("linear", LINEAR_STEMS),
    ("gravity", GRAVITY_STEMS),
)
TIME_STEMS = frozenset(
    {"t", "time", "date", "timestamp", "times", "timestamps", "datetime", "ts", "clock", "elapsed"}
    | {"elapsedtime", "micros", "millis", "epoch", "epoc", "unixtime", "unix", "sampletimefine", "seconds"}
    | {"milliseconds", "microseconds", "nanoseconds", "temps", "horodatage", "horodate", "heure", "dateheure"}
    | {"dateetheure", "horloge", "secondes", "millisecondes", "microsecondes", "epochtime", "systemtime"}
    | {"devicetime", "us", "ms", "usec", "msec", "sec", "secs"}
)
TIME_WORDS = frozenset({"time", "timestamp"})
COUNTER_STEMS = frozenset(
    {"index", "sample", "samples", "nsamples", "samplenumber", "packetcounter", "counter", "packet"}
    | {"row", "n", "samplecount", "count", "sequence", "seq"}
    | {"compteur", "echantillon", "numero", "ligne", "paquet"}
)
AXIS_WORDS = ("axis", "axe")
AXIS_SUFFIX = re.compile(r"(?:[ _.\-]*axis)?(?:[ _.\-]+([a-z0-9/_.\-]+))?")
PREFIXES = ("lsm9ds1", "imu", "sensor", "raw", "cal", "calib", "calibrated", "motion")

TIME_UNITS_EXPONENT = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds", "secondes"), 6),
    **dict.fromkeys(("ms", "msec", "msecs", "millis", "milliseconds", "millisecondes"), 3),
    **dict.fromkeys(("us", "usec", "usecs", "micros", "microseconds", "microsecondes"), 0),
    **dict.fromkeys(("ns", "nsec", "nanos", "nanoseconds"), -3),
    "100us": 2,
}
"""Powers of ten to microseconds; MT Manager counts tenths of a millisecond."""
REMARKS = frozenset({"cal", "raw", "uncal", "calibrated", "uncalibrated"})
OTHER_UNITS = frozenset(
    {"", "local", "nounits", "ut", "gauss", "ga", "degc", "c", "deg", "v", "mv", "lux", "boolean"}
)
"""What may stand in a row of units beside those of samples and times."""


@dataclass(frozen=True, slots=True)
class Column:
    """A column understood: ``axis`` 0 to 2 for acceleration and angular rate, ``unit`` as written or None.

    ``sensor``: which of several it belongs to; "" where the table holds one. ``is_narrow``: of two
    accelerometers of one sensor, the one of the smaller range.
    """

    name: str
    channel: Channel
    axis: int = 0
    unit: str | None = None
    sensor: str = ""
    is_narrow: bool = False


def parse_column_name(name: str) -> Column:
    """Find channel, axis and unit of a header's field."""
    text = _tidy(name)
    plain, unit = _split_bracketed(text)
    vector = _match_vector(name, plain, unit)
    if vector is not None:
        return vector
    words = [word for word in re.split(r"[ _.\-]+", plain) if word]
    unit_word = words.pop() if len(words) > 1 and words[-1] in TIME_UNITS_EXPONENT else None
    stem = "".join(words)
    if stem in TIME_STEMS or TIME_WORDS & {*words, unit_word}:
        units = (unit or unit_word, stem)
        return Column(name, "time", unit=next((one for one in units if one in TIME_UNITS_EXPONENT), None))
    if stem.removeprefix("imu") in COUNTER_STEMS:
        return Column(name, "counter")
    return Column(name, "other")


def _tidy(name: str) -> str:
    text = name.strip().strip('"').strip().lower()
    for old, new in (("µ", "u"), ("μ", "u"), ("²", "2"), ("^", ""), ("°", "deg"), ("**", ""), ("·", ".")):
        text = text.replace(old, new)
    return "".join(sign for sign in unicodedata.normalize("NFD", text) if not unicodedata.combining(sign))


def _split_bracketed(text: str) -> tuple[str, str | None]:
    found = re.search(r"[\(\[\{]\s*((?:\([^\)]*\)|[^\)\]\}])*?)\s*[\)\]\}]", text)
    if found is None:
        return text, None
    unit = re.sub(r"[\s()]+", "", found.group(1))
    return (text[: found.start()] + text[found.end() :]).strip(), unit.replace("_per_", "/").replace("_", "")


def read_unit(field: str) -> str | None:
    """Read a field of a row of units: the unit, "" for one that is none of a sample's, None for no unit."""
    word = re.sub(r"[\s()]+", "", _tidy(field))
    if word in ACC_UNITS_G or word in GYR_UNITS_DPS or word in TIME_UNITS_EXPONENT:
        return word
    return "" if word in OTHER_UNITS else None


def read_axis(name: str) -> tuple[str, str | None] | None:
    """Find axis and unit of a name in a table of one sensor: `X (m/s^2)`, `x-axis (g)`; None for no axis."""
    plain, unit = _split_bracketed(_tidy(name))
    found = re.search(
        r"(?:^|[^a-z])([xyz])(?:[ _.\-]*ax[ie]s)?$|(?:acceleration|accel|gyroscope|gyro)([xyz])$", plain
    )
    return (found.group(1) or found.group(2), unit) if found else None


def _match_vector(name: str, plain: str, unit: str | None) -> Column | None:
    """Find sensor, axis and unit around any of the letters that may be the axis."""
    for found in re.finditer("[xyz]", plain):
        suffix = AXIS_SUFFIX.fullmatch(plain[found.end() :])
        word = re.sub(r"[ _.\-]", "", plain[: found.start()])
        for prefix in PREFIXES:
            word = word.removeprefix(prefix) or word
        for axis_word in AXIS_WORDS:
            word = word.removesuffix(axis_word) or word
        channel = next((channel for channel, stems in STEMS if word in stems), None)
        if suffix is None or channel is None:
            continue
        if unit is None and suffix.group(1) and suffix.group(1) not in REMARKS:
            unit = suffix.group(1).replace("_per_", "/").replace("_", "")
        if word in ("gf", "gforce"):
            unit = unit or "g"
        return Column(name, channel, "xyz".index(found.group()), unit, is_narrow=word in NARROW_STEMS)
    return None


Vector = tuple[int, int, int]


def choose_vector(columns: Sequence[Column], channel: Channel) -> Vector | None:
    """Places of x, y, z of a channel; None unless each is there exactly once."""
    chosen = [(k, c) for k, c in enumerate(columns) if c.channel == channel]
    if any(not column.is_narrow for _, column in chosen):
        chosen = [(k, column) for k, column in chosen if not column.is_narrow]
    places = [[k for k, column in chosen if column.axis == axis] for axis in range(3)]
    if any(len(found) != 1 for found in places):
        return None
    return places[0][0], places[1][0], places[2][0]


def choose_acceleration(columns: Sequence[Column]) -> tuple[Vector | None, Vector | None]:
    """Places of the acceleration, and of the gravity that it may lack; None for what is not there.

    Core Motion's "acceleration" lacks gravity, Android's does not: only where the other acceleration stands
    beside it does the name tell.
    """
    acc, linear, gravity = (choose_vector(columns, channel) for channel in ("acc", "linear", "gravity"))
    if acc is None:
        return (linear, gravity) if linear and gravity else (None, None)
    return acc, None if linear else gravity


def name_missing(columns: Sequence[Column]) -> str:
    """Which of the six channels are not there, or there more than once: "gy, gz"."""
    counts = Counter(
        f"{column.channel[0]}{'xyz'[column.axis]}" for column in columns if column.channel in ("acc", "gyr")
    )
    return ", ".join(name for name in ("ax", "ay", "az", "gx", "gy", "gz") if counts[name] != 1)


EPOCH_WORDS = frozenset(
    {"axis1", "axis2", "axis3", "vectormagnitude", "vm", "vmu", "counts", "activity", "steps", "stepcount"}
    | {"enmo", "mad", "mimsunit", "inclinometeroff", "inclinometerstanding", "hr", "cpm"}
)
FEWEST_EPOCH_WORDS = 2


def names_epochs(names: Sequence[str]) -> bool:
    """Whether a header is that of counts or epochs: two such words at least, and no axis of a gyroscope."""
    words = [re.sub(r"[^a-z0-9]", "", name.lower()) for name in names]
    is_raw = any(parse_column_name(name).channel == "gyr" for name in names)
    return not is_raw and sum(word in EPOCH_WORDS for word in words) >= FEWEST_EPOCH_WORDS


# The unit of a column of times: that of its name, or the one in which the rows come at a plausible rate.
#
# The candidates (s, ms, us, ns) lie a factor of 1000 apart and the rates span 250: at most one fits.

PLAUSIBLE_RATE_HZ = (8.0, 2000.0)
SECONDS_OF_DAY = 86_400
SMOOTH_RATIO = 0.3
"""Of readings that have nothing to do with each other, as of an arm every few seconds, the ratio is 1."""
LOOKED_AT_ROWS = 1 << 18
UNIT_NAMES = {TIME_UNITS_EXPONENT[unit]: unit for unit in ("s", "ms", "us", "ns")}


@dataclass(frozen=True, slots=True)
class TimeUnit:
    """Power of ten to microseconds, and that of the unit in the header where it cannot be.

    ``stated_hz``, ``rate_hz``: at what rate the first rows come, by the header and as taken. ``is_days``:
    the stamps are a spreadsheet's days.
    """

    exponent: int
    stated_exponent: int | None = None
    stated_hz: float = 0.0
    rate_hz: float = 0.0
    is_days: bool = False

    def flag(self) -> tuple[QualityFlag, ...]:
        """Flag that the header's unit was replaced (W-UNITS)."""
        if self.stated_exponent is None:
            return ()
        facts: dict[str, str | int | float] = {
            "what": "time",
            "evidence": "rate",
            "unit": UNIT_NAMES[self.stated_exponent],
            "read_as": UNIT_NAMES[self.exponent],
            "rate_hz": round(self.rate_hz, 3),
        }
        return (QualityFlag(Caveat.UNITS, facts=facts),)

    def refuse_doubtful(self, columns: SampleColumns) -> None:
        """Refuse rows so slow by the header that only the readings can tell, where they do not.

        Raises UnknownRate.
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
IN_DAYS = TimeUnit(11, is_days=True)
"""Days since the end of 1899, as spreadsheets count: read as hundred-thousand-millionths of a day."""
DAYS_TO_1970 = 25_569
POSSIBLE_DAYS = (36_526.0, 73_050.0)
"""The years 2000 to 2099."""
MICROSECONDS_OF_COUNT = 0.864


def count_from_1970(stamps: NDArray[np.int64]) -> None:
    """Turn a spreadsheet's days, read as :data:`IN_DAYS`, into microseconds since 1970, in place."""
    stamps -= DAYS_TO_1970 * 10**IN_DAYS.exponent
    stamps[:] = np.rint(stamps * MICROSECONDS_OF_COUNT)


def find_time_unit(times: Sequence[float], unit: str | None) -> TimeUnit | None:
    """Find the unit of a column by its first times; None where neither header nor times give one.

    A unit in the header holds, unless no sensor writes rows so fast or so slowly and another unit fits. The
    time since 1970 keeps the header's unit, however slowly the rows come.
    """
    stated = TIME_UNITS_EXPONENT.get(unit or "")  # a damaged row of units may name another quantity
    times = [time for time in times if math.isfinite(time)]  # a damaged row holds no time
    (first_day, last_day), (slowest_hz, fastest_hz) = POSSIBLE_DAYS, PLAUSIBLE_RATE_HZ
    if stated is None and times and all(first_day <= time < last_day for time in times):
        days_hz = _rate_hz(times, 0) / SECONDS_OF_DAY / MICROSECONDS
        if slowest_hz <= days_hz <= fastest_hz:
            return IN_DAYS
    found = guess_exponent(times)
    if stated is None:
        return None if found is None else TimeUnit(found)
    stated_hz = _rate_hz(times, stated)
    if found is None or SLOWEST_HZ <= stated_hz <= FASTEST_HZ:
        return TimeUnit(stated)
    moment = datetime_at_us(round(times[0] * 10.0**stated)) if times else None
    if moment is not None and is_clock_set(moment):
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
