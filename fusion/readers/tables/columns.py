"""Find the meaning of columns: channel, axis and unit from the names, the form of times from the stamps."""

import math
import re
import unicodedata
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, date, datetime, timedelta
from functools import lru_cache
from itertools import pairwise
from statistics import median
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from acromion.fusion.caveats import Caveat
from acromion.fusion.clocks import is_clock_set
from acromion.fusion.errors import UnknownRate, UnknownUnit, UnusableTime
from acromion.fusion.readers.samples import SampleColumns
from acromion.fusion.readers.time.clock import datetime_at_us, is_change_of_offset
from acromion.fusion.readers.time.grid import FASTEST_HZ, SLOWEST_HZ
from acromion.fusion.recording import (
    ACC_UNITS_G,
    GYR_UNITS_DPS,
    MICROSECONDS,
    QualityFlag,
    acc_scale_g,
    gyr_scale_dps,
)

# The meaning of a column's name: channel, axis, unit.
#
# The alias table was gathered from the layouts seen in the wild (libraries of Arduino, SparkFun, Adafruit,
# x-io, ActiLife, Xsens, phone loggers), with the names of French exports.

Channel = Literal["acc", "gyr", "linear", "gravity", "time", "counter", "other"]
"""``linear``: an acceleration without gravity."""

ACC_STEMS = frozenset(
    {"a", "ac", "acc", "accl", "accel", "accelerometer", "acceleration", "accelero", "gf", "gforce", "xl"}
    | {
        "accelerometeracceleration",
        "accelerometre",
        "accelwr",
        "accelln",
        "widerangeaccelerometer",
        "lownoiseaccelerometer",
    }
)
NARROW_STEMS = frozenset({"accelln", "lownoiseaccelerometer"})
"""The accelerometer of a Shimmer with a range of 2 g, which an arm at work exceeds."""
LINEAR_STEMS = frozenset(
    {"linearacceleration", "linearaccelerometer", "linearaccel", "linearacc", "linacc", "linaccel"}
    | {"useracceleration", "useraccel", "useracc", "freeacc", "freeacceleration", "accelerationlineaire"}
)
GRAVITY_STEMS = frozenset({"gravity", "grav", "gravite"})
GYR_STEMS = frozenset(
    {"g", "gy", "gyr", "gyro", "gyroscope", "w", "omega", "rot", "rate", "rotation", "rotationrate"}
    | {"angularrate", "angularvelocity", "angvel", "angrate", "av", "gyrorotation"}
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
    | {"devicetime", "us", "ms", "usec", "msec", "sec", "secs", "arrived"}
)
TIME_WORDS = frozenset({"time", "timestamp"})
ENDS_IN_TIME = re.compile(r"(?:time(?:stamp)?|zeit|tiempo|tempo)(?![a-z])", re.IGNORECASE)
"""A name such as `loggingTime` is a time if no other column is, because devices write several of them."""
COUNTER_STEMS = frozenset(
    {"index", "sample", "samples", "nsamples", "samplenumber", "packetcounter", "counter", "packet"}
    | {"row", "n", "samplecount", "count", "sequence", "seq"}
    | {"compteur", "echantillon", "numero", "ligne", "paquet"}
)
GYROSCOPE = re.compile(r"(?<![a-z])gyr", re.IGNORECASE)
"""A name of the gyroscope, whether its axis is understood or not."""
AXIS_WORDS = ("axis", "axe")
LONGEST_NAME = 200
"""Only these first characters of a column's name are read."""
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
"""Other words that a row of units may contain."""


@dataclass(frozen=True, slots=True)
class Column:
    """A column understood: ``axis`` 0 to 2 for acceleration and angular rate, ``unit`` as written or None.

    ``sensor``: its sensor if the table contains several; else "". ``is_narrow``: the accelerometer with the
    smaller range, if a sensor has two.
    """

    name: str
    channel: Channel
    axis: int = 0
    unit: str | None = None
    sensor: str = ""
    is_narrow: bool = False


def parse_column_name(name: str) -> Column:
    """Parse channel, axis and unit from a field of the header."""
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
    return Column(name, "other", unit=unit if unit in TIME_UNITS_EXPONENT else None)


def _tidy(name: str) -> str:
    text = name[:LONGEST_NAME].strip().strip('"').strip().lower()
    for old, new in (("µ", "u"), ("μ", "u"), ("²", "2"), ("^", ""), ("°", "deg"), ("**", ""), ("·", ".")):
        text = text.replace(old, new)
    return "".join(sign for sign in unicodedata.normalize("NFD", text) if not unicodedata.combining(sign))


def _split_bracketed(text: str) -> tuple[str, str | None]:
    opened = re.search(r"[(\[{]", text)
    last = max(text.rfind(mark) for mark in ")]}")
    if opened is None or last < opened.start():
        return text, None
    end = opened.end()
    while text[end] not in ")]}":
        inner = text.find(")", end) if text[end] == "(" else -1
        end = inner + 1 if 0 <= inner < last else end + 1
    unit = re.sub(r"[\s()]+", "", text[opened.end() : end])
    return (text[: opened.start()] + text[end + 1 :]).strip(), unit.replace("_per_", "/").replace("_", "")


def read_unit(field: str) -> str | None:
    """Read a field of a row of units: the unit, "" for a unit of another quantity, None for no unit."""
    word = re.sub(r"[\s()\[\]]+", "", _tidy(field))
    if word in ACC_UNITS_G or word in GYR_UNITS_DPS or word in TIME_UNITS_EXPONENT:
        return word
    return "" if word in OTHER_UNITS else None


def read_axis(name: str) -> tuple[str, str | None] | None:
    """Find axis and unit of a name in a table of one sensor: `X (m/s^2)`, `x-axis (g)`; None for no axis."""
    plain, unit = _split_bracketed(_tidy(name))
    found = re.search(
        r"(?:^|[^a-z])([xyz])(?:[ _.\-]*ax[ie]s)?$|(?:acceleration|accel|gyroscope|gyro)([xyz])$"
        r"|^([xyz])_(?:acc|angular)\w*$",
        plain,
    )
    return (found[found.lastindex or 0], unit) if found else None


def read_named_axis(name: str) -> tuple[str, str | None] | None:
    """Find axis and unit as :func:`read_axis`, also of a name that states the sensor: `ax`, `gyroX`."""
    found, column = read_axis(name), parse_column_name(name)
    if found is None and column.channel in ("acc", "gyr", "linear", "gravity"):
        return "xyz"[column.axis], column.unit
    return found


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


def find_own_axes(names: Sequence[str]) -> Vector | None:
    """Return the places of x, y and z in a table of one sensor; None unless each exists exactly once."""
    axes = [found[0] if (found := read_named_axis(name)) else "" for name in names]
    if any(axes.count(axis) != 1 for axis in "xyz"):
        return None
    return axes.index("x"), axes.index("y"), axes.index("z")


def choose_vector(columns: Sequence[Column], channel: Channel) -> Vector | None:
    """Return the places of x, y, z of a channel; None unless each exists exactly once."""
    chosen = [(k, c) for k, c in enumerate(columns) if c.channel == channel]
    if any(not column.is_narrow for _, column in chosen):
        chosen = [(k, column) for k, column in chosen if not column.is_narrow]
    places = [[k for k, column in chosen if column.axis == axis] for axis in range(3)]
    if any(len(found) != 1 for found in places):
        return None
    return places[0][0], places[1][0], places[2][0]


def check_units(sensor: str, units: Sequence[str | None]) -> None:
    """Raise UnknownUnit if the header states different units for the axes of a sensor."""
    scales = {scale for unit in units if (scale := acc_scale_g(unit) or gyr_scale_dps(unit))}
    if len(scales) > 1:
        raise UnknownUnit(mixed=sensor, units=", ".join(unit or "-" for unit in units))


def check_both_units(columns: Sequence[Column], acc: Vector, gyr: Vector) -> None:
    """Raise UnknownUnit as :func:`check_units`, for both sensors of a table."""
    for sensor, places in (("accelerometer", acc), ("gyroscope", gyr)):
        check_units(sensor, [columns[place].unit for place in places])


def choose_acceleration(columns: Sequence[Column]) -> tuple[Vector | None, Vector | None]:
    """Return the places of the acceleration, and of the gravity it may lack; None for an absent one.

    Core Motion's "acceleration" lacks gravity, Android's does not: the name is clear only if both
    accelerations are there.
    """
    acc, linear, gravity = (choose_vector(columns, channel) for channel in ("acc", "linear", "gravity"))
    if acc is None:
        return (linear, gravity) if linear and gravity else (None, None)
    return acc, None if linear else gravity


def name_missing(columns: Sequence[Column]) -> dict[str, str]:
    """Return the names of absent channels, and of channels that occur more than once.

    Returns facts of a refusal: ``missing`` and ``doubled`` ("gy, gz"), each only if there is one.
    """
    counts = Counter(
        f"{column.channel[0]}{'xyz'[column.axis]}" for column in columns if column.channel in ("acc", "gyr")
    )
    channels = ("ax", "ay", "az", "gx", "gy", "gz")
    found = {
        "missing": ", ".join(name for name in channels if counts[name] == 0),
        "doubled": ", ".join(name for name in channels if counts[name] > 1),
    }
    return {fact: names for fact, names in found.items() if names}


EPOCH_WORDS = frozenset(
    {"axis1", "axis2", "axis3", "vectormagnitude", "vm", "vmu", "counts", "activity", "steps", "stepcount"}
    | {"enmo", "mad", "mimsunit", "inclinometeroff", "inclinometerstanding", "hr", "cpm"}
)
FEWEST_EPOCH_WORDS = 2


def names_epochs(names: Sequence[str]) -> bool:
    """Return whether a header names counts or epochs: at least two such words, and no gyroscope axis."""
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
    """Power of ten to microseconds; also that of the header's unit if it is impossible.

    ``stated_hz``, ``rate_hz``: rate of the first rows by the header's unit and by the chosen unit.
    ``is_days``: the stamps are a spreadsheet's days.
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
        """Refuse a header's unit that gives a very low rate, unless the readings are smooth.

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
    """Find the unit of a column from its first times; None if neither header nor times show one.

    The header's unit applies unless it gives a rate that no sensor has and another unit fits. Time since 1970
    keeps the header's unit at any rate.
    """
    stated = TIME_UNITS_EXPONENT.get(unit or "")  # a damaged row of units may name another quantity
    times = [time for time in times if math.isfinite(time)]  # a damaged row has no time
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
    """Return the unit that gives a rate of 8 to 2000 Hz; None if there is none."""
    slowest_hz, fastest_hz = PLAUSIBLE_RATE_HZ
    return next((one for one in UNIT_NAMES if slowest_hz <= _rate_hz(times, one) <= fastest_hz), None)


NEAR_STEP, NEAR_ROWS = 0.1, 32


def _rate_hz(times: Sequence[float], exponent: int) -> float:
    """Return the rate from the usual step, 0 if the times do not advance; the newest row may be first."""
    steps = [after - before for before, after in pairwise(times)]
    if not steps:
        return 0.0
    if 2 * sum(step < 0 for step in steps) > sum(step != 0 for step in steps):
        steps = [-step for step in steps]
    # mean of the advancing steps: coarse stamps repeat, and rows that arrived together follow at once
    step, mean = median(steps), sum(max(0.0, s) for s in steps) / len(steps)
    if 0 < step < NEAR_STEP * mean:
        blocks = [after - before for before, after in zip(times, times[NEAR_ROWS:], strict=False)]
        step = abs(median(blocks)) / NEAR_ROWS if blocks else step
    step = step or mean
    return MICROSECONDS / (step * 10.0**exponent) if step > 0 else 0.0


def measure_roughness(values: NDArray[np.float32]) -> float:
    """Return the distance of successive readings, shape (n, 3), relative to that of any two readings.

    Half of von Neumann's ratio (Ann Math Stat 1941;12:367) over all axes: 0 smooth, 1 unrelated.
    """
    values = values[:LOOKED_AT_ROWS]
    if len(values) < 2:
        return 1.0
    steps = float(np.square(np.diff(values, axis=0), dtype=np.float64).sum()) / (len(values) - 1)
    spread = float(values.var(axis=0, dtype=np.float64).sum())
    return steps / (2.0 * spread) if spread > 0.0 else 1.0


# Stamps as people write them: `14/03/2026 08:00:00.01`, date and time in two columns, a zone at the end.
#
# :func:`find_dates` recognises how a table writes them; :class:`StampWriter` rewrites them to the ISO form of
# the other tables before the rows are read.

# The order of day, month and year: whether `02/03/2026` is the second of March or the third of February.

DateOrder = Literal["ymd", "dmy", "mdy"]
FORMAT_WORDS = re.compile(r"date[ _]format[ :=]+([Mdy])", re.IGNORECASE)
FIRST_OF: dict[str, DateOrder] = {"m": "mdy", "d": "dmy", "y": "ymd"}
START_DATE = re.compile(
    r"^[^\w\n]*+start(?:[ _]date)?[ :=]++(\d{1,4})[/.\-](\d{1,2})[/.\-](\d{1,4})",
    re.IGNORECASE | re.MULTILINE,
)
NEAR_DAYS = 14
"""How far the rows may begin from the start that the header tells, in a file that was cut. The two readings
of a date lie four weeks apart or more."""
YEAR_DIGITS = 4
MONTH_NAMES = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
MONTHS = {name: number for number, name in enumerate(MONTH_NAMES, start=1)}
CENTURY = 2000
"""Of a year of two digits: no recorder of this kind is older."""


def order_dates(
    parts: Sequence[tuple[str, ...]], head: str, order: DateOrder | None
) -> tuple[DateOrder, bool]:
    """Find the order of day, month and year of the dates in rows, and whether the header contradicts it.

    If the dates do not decide it, these do, in this order: the order that a person gives; the header's start
    date, if only one order comes near it; the header's date format. The format is last because a program that
    saves a file again may rewrite the dates without changing the header.

    Raises UnusableTime if day and month, or a two-digit year, cannot be told apart, or if no order fits all
    dates.
    """
    open_to = find_orders(parts)
    if not open_to:
        raise UnusableTime(why="dates")
    if len(open_to) == 1:
        return open_to[0], False
    if order in open_to:
        return order, False
    named = FORMAT_WORDS.search(head)
    word = FIRST_OF[named.group(1).lower()] if named else None
    begun = _read_start(head, word)
    near = [one for one in open_to if begun and _is_near(_read_date(parts[0], one), begun)]
    if len(near) == 1:
        return near[0], False
    if word not in open_to:
        raise UnusableTime(why="date-order")
    return word, begun is not None and not near


def find_orders(parts: Sequence[tuple[str, ...]]) -> list[DateOrder]:
    """Return the orders of day, month and year in which all of these are valid dates.

    Impossible dates, as of damaged rows, do not count.
    """
    first, second, third = parts[0]
    if len(first) == YEAR_DIGITS:
        return ["ymd"]
    orders: tuple[DateOrder, ...] = ("dmy", "mdy") if len(third) == YEAR_DIGITS else ("dmy", "mdy", "ymd")
    if second[:1].isalpha():
        orders = ("dmy",)
    valid = [{one for one in orders if _read_date(part, one)} for part in dict.fromkeys(parts)]
    possible = [one for one in valid if one]
    return [one for one in orders if possible and all(one in orders_of for orders_of in possible)]


def find_order_by_span(first: tuple[str, ...], last: tuple[str, ...]) -> DateOrder | None:
    """Return the only order in which a file's first and last dates are close; None if several are.

    A recording past midnight goes from 03/03 to 04/03: one day in one order, a month in the other.
    """
    spans = {one: (_read_date(first, one), _read_date(last, one)) for one in find_orders([first, last])}
    near = [one for one, (begun, ended) in spans.items() if begun and _is_near(ended, begun)]
    return near[0] if len(near) == 1 else None


def _read_start(head: str, word: DateOrder | None) -> date | None:
    """Parse the header's start date in the format it names, or in the other if that gives no date."""
    found = START_DATE.search(head)
    if found is None:
        return None
    orders = ["ymd"] if len(found.group(1)) == YEAR_DIGITS else [word or "", "dmy", "mdy"]
    dates = [_read_date(found.groups(), one) for one in dict.fromkeys(orders) if one]
    known = [one for one in dates if one is not None]
    return known[0] if known and (word or len(known) == 1) else None


def _read_date(parts: Sequence[str], order: str) -> date | None:
    numbers = dict(zip(order, map(_read_part, parts), strict=True))
    try:
        return date(_complete_year(numbers["y"]), numbers["m"], numbers["d"])
    except ValueError:
        return None


def _read_part(part: str) -> int:
    """Return day, month or year as a number; 0 for no month's name."""
    return int(part) if part.isdigit() else MONTHS.get(part[:3].lower(), 0)


def _complete_year(year: int) -> int:
    return year + CENTURY if year < 100 else year


def _is_near(day: date | None, begun: date) -> bool:
    return day is not None and abs((day - begun).days) <= NEAR_DAYS


FIELD_END = r"(?=[\" ]*(?:[,;\t|\r\n]|$))"
ZONE = (
    r"(?P<zone>Z(?![A-Za-z])|[+\-]\d{2}:?\d{2}(?!\d)|[+\-]\d{2}" + FIELD_END
    + r"| [+\-]\d{2}:?\d{2}" + FIELD_END + r"| ?[A-Za-z]{1,5}" + FIELD_END + r")?(?:\[[\w/+\-]+\])?"
)  # fmt: skip
HALF = r"(?P<half> ?[AaPp]\.?[Mm]\.?(?![A-Za-z]))?"
CLOCK = r"(?P<hour>\d{1,2}):(?P<minute>\d{2}):(?P<seconds>\d{2}(?:[%s]\d+|:\d{3})?)" + HALF + ZONE
NUMERIC_DATE = (
    r"(?<![\d:/.\-])(?P<first>\d{1,4})(?P<mark>[/.\-])(?P<second>\d{1,2})(?P=mark)(?P<third>\d{1,4})"
)
NAMED_DATE = (
    r"(?<![\w:/.\-])(?P<first>\d{1,4})(?P<mark>[/.\- ])"
    r"(?P<second>(?i:" + "|".join(MONTH_NAMES) + r")[a-z]{0,6})(?P=mark)(?P<third>\d{2,4})"
)
WITH_YEAR = r"(?=\d{4}[/.\-]|\d{1,2}[/.\-]\d{1,2}[/.\-]\d{4}|\d{1,2}/\d{1,2}/\d{2})"
"""Apart from a time of day, `4.0.2` must not read as a date."""
NEXT_COLUMN = r" *\"?[,;\t|]\"? *"
FURTHER_ON = NEXT_COLUMN + r"(?:[^,;\t|\n:]{0,60}" + NEXT_COLUMN + r"){0,12}?"
"""Between a date and a time of day stand other columns."""
DATED = NUMERIC_DATE + r"(?P<between>T| +|" + NEXT_COLUMN + r")" + CLOCK + r"(?![\d:])"
APART = (NUMERIC_DATE.replace("(?P<first>", WITH_YEAR + "(?P<first>"), NAMED_DATE)
DATED_FORMS = (
    DATED,
    NAMED_DATE + r"(?P<between>[ :]|" + NEXT_COLUMN + r")" + CLOCK + r"(?![\d:])",
    *(date + r"(?P<between>" + FURTHER_ON + r")" + CLOCK + r"(?![\d:])" for date in APART),
    *(
        r"(?<![\d:/.\-])" + CLOCK + r"(?P<between> +|" + FURTHER_ON + r")" + date + r"(?![\d:/.\-])"
        for date in APART
    ),
)
"""A date and a time of day: in one column or in two, whichever comes first."""
COMPACT = (
    r"(?<![\w.])(?P<first>\d{4})(?P<second>\d{2})(?P<third>\d{2})(?P<between>T)"
    r"(?P<hour>\d{2})(?P<minute>\d{2})(?P<seconds>\d{2}(?:[%s]\d+)?)(?P<half>(?!))?" + ZONE + r"(?![\d:])"
)
BARE = (
    r"(?<![\w.\-])(?P<first>20\d{2})(?P<second>\d{2})(?P<third>\d{2})(?P<between>[ _\-]?|"
    + NEXT_COLUMN
    + r")"
    r"(?P<hour>\d{2}|(?<=[ ,;\t|\"])\d)(?P<minute>\d{2})(?P<seconds>\d{2}(?:[%s]\d+)?)"
    r"(?P<half>(?!))?(?P<zone>(?!))?" + FIELD_END
)
"""Date and time as two whole numbers: `20260302,070000.00`."""
UNDATED = (
    r"^(?P<before>(?:[^:\n]*[,;\t|])?[\" ]*)(?P<hour>\d{1,2}):(?P<minute>\d{2})"
    r":(?P<seconds>\d{2}(?:[%s]\d+|:\d{3})?)" + HALF + ZONE + r"(?=[\" ]*[,;\t| ])"
)  # fmt: skip
NO_SECONDS = re.compile(
    r"(?<![\d:/.\-])\d{1,4}([/.\-])\d{1,2}\1\d{1,4}(?:T| +| *\"?[,;\t|]\"? *)"
    r"\d{1,2}:\d{2}(?: ?[AaPp][Mm])?(?![\d:])"
)
MINUTES_ONLY = re.compile(r"(?<![\d:])\d{1,2}:\d{2}[.,]\d(?![\d:])")
"""A time of day with a fraction as Excel shows it: `58:00.1`, without the hour."""
HOUR_AND_MINUTE = re.compile(r"(?<![\w:.\-])\d{1,2}:\d{2}(?: ?[AaPp][Mm])?" + FIELD_END)
PLAIN = re.compile(r"\d{4}-\d{1,2}-\d{1,2}[T ]\d{1,2}:\d{2}:\d{2}(?:[.,]\d++)?+(Z?)(?![\w:+\- \[])")
STAMP_LIKE = re.compile(r"\d:\d\d|\dT\d|\d{1,4}([/.\-])\d{1,2}\1\d{1,4}|(?<![\w.\-])20\d{6}(?!\.)")
NAMED_ZONES_H = {
    **dict.fromkeys(("Z", "UT", "UTC", "GMT"), 0),
    **dict.fromkeys(("PST",), -8),
    **dict.fromkeys(("MST", "PDT"), -7),
    **dict.fromkeys(("CST", "MDT"), -6),
    **dict.fromkeys(("EST", "CDT", "HNE"), -5),
    **dict.fromkeys(("EDT", "HAE"), -4),
    **dict.fromkeys(("CET",), 1),
    **dict.fromkeys(("CEST",), 2),
}
"""Hours east of UTC: RFC 5322 §4.3, the French names of Eastern time, Central European time."""
LARGEST_OFFSET_S = 14 * 3600
SNIFFED_LINES = 400
FIELDS_OF_A_ROW = 6


@dataclass(frozen=True, slots=True)
class DateDialect:
    """How stamps are written: a pattern over lines, and the order of day, month and year.

    ``offset_s``: seconds east of UTC, where the first row tells them; ``has_date``: false where the stamps
    are a time of day only; ``is_iso``: they are as the kernels read them, nothing is to be rewritten;
    ``is_doubtful``: day and month may be the other way round.
    """

    pattern: re.Pattern[str]
    order: DateOrder
    offset_s: int | None = None
    has_date: bool = True
    is_iso: bool = False
    is_doubtful: bool = False


def find_dates(
    head: str, order: DateOrder | None = None, fewest: int = FIELDS_OF_A_ROW
) -> DateDialect | None:
    """Find how the rows of a table's head write date and time; None if they are ISO without an offset.

    ``order``: of day, month and year, as a person gives it.

    Raises UnusableTime: day and month cannot be told apart, a spreadsheet has cut the seconds off, a zone's
    name does not tell its offset, or the stamps have a form that is not known.
    """
    lines = {k: line for k, line in enumerate(head.split("\n")[:SNIFFED_LINES], 1) if _is_wide(line, fewest)}
    if not any(STAMP_LIKE.search(line) for line in lines.values()):
        return None
    mark = ".," if any(";" in line or "\t" in line for line in lines.values()) else "."
    for form in (*DATED_FORMS, COMPACT, BARE):
        pattern = re.compile(form % mark)
        found = {k: match for k, line in lines.items() if (match := pattern.search(line))}
        is_rare = form not in (DATED, COMPACT) and 2 * len(found) <= len(lines)
        if found and not is_rare and (form is not BARE or all(map(_is_clock, found.values()))):
            plain = [PLAIN.search(lines[k]) for k in found]
            if all(plain):
                is_utc = all(match is not None and match.group(1) for match in plain)
                return DateDialect(pattern, "ymd", 0, is_iso=True) if is_utc else None
            parts = [(match["first"], match["second"], match["third"]) for match in found.values()]
            order, is_doubtful = order_dates(parts, head, order)
            return DateDialect(pattern, order, _find_offset_s(found), is_doubtful=is_doubtful)
    forms = (NO_SECONDS, MINUTES_ONLY, HOUR_AND_MINUTE)
    cut = sum(any(form.search(line) for form in forms) for line in lines.values())
    if 2 * cut > len(lines):
        raise UnusableTime(why="seconds")
    pattern = re.compile(UNDATED % mark, re.MULTILINE)
    found = {k: match for k, line in lines.items() if (match := pattern.search(line))}
    if 2 * len(found) > len(lines):
        return DateDialect(pattern, "ymd", _find_offset_s(found), has_date=False)
    strange = [k for k, line in lines.items() if re.search(r"\d:\d\d(?!\d)", line)]
    if 2 * len(strange) > len(lines):  # a clock's time or a date which nothing here understands
        raise UnusableTime(why="form", line=strange[0])
    return None


@lru_cache(maxsize=2)
def find_open_date(head: str, fewest: int = FIELDS_OF_A_ROW) -> tuple[str, ...]:
    """Day, month and year of the first row as written, if their order is open; else nothing."""
    found = _find_parts(head.split("\n")[:SNIFFED_LINES], fewest)
    return found[0] if found and len(find_orders(found)) > 1 else ()


def find_last_date(tail: str, fewest: int = FIELDS_OF_A_ROW) -> tuple[str, ...]:
    """The same of the last whole row of a table's tail; nothing if there is none."""
    found = _find_parts(tail.split("\n")[1:-1], fewest)
    return found[-1] if found else ()


def _find_parts(lines: Sequence[str], fewest: int) -> list[tuple[str, ...]]:
    wide = [line for line in lines if _is_wide(line, fewest) and STAMP_LIKE.search(line)]
    for form in DATED_FORMS:
        pattern = re.compile(form % ".,")
        if found := [match for line in wide if (match := pattern.search(line))]:
            return [match.group("first", "second", "third") for match in found]
    return []


def _is_clock(found: re.Match[str]) -> bool:
    """Return whether numbers are a date and a time of day."""
    day = _read_date(found.group("first", "second", "third"), "ymd")
    seconds = float(_read_seconds(found).replace(",", "."))
    return day is not None and int(found["hour"]) < 24 and int(found["minute"]) < 60 and seconds < 61


def _find_offset_s(found: dict[int, re.Match[str]]) -> int | None:
    """Return the offset of the first row that has one."""
    for line, match in found.items():
        if match["zone"]:
            offset_s = parse_zone_s(match["zone"])
            if offset_s is None:
                raise UnusableTime(why="zone name", line=line)
            return offset_s
    return None


def parse_zone_s(text: str) -> int | None:
    """Seconds east of UTC of `-04:00`, `+0530`, `Z`, `EDT`; None for a name of more than one meaning."""
    zone = text.strip().upper()
    if zone in NAMED_ZONES_H:
        return 3600 * NAMED_ZONES_H[zone]
    if zone[0] not in "+-":
        return None
    digits = zone[1:].replace(":", "").ljust(4, "0")
    offset_s = 3600 * int(digits[:2]) + 60 * int(digits[2:])
    return None if offset_s > LARGEST_OFFSET_S else -offset_s if zone[0] == "-" else offset_s


def _is_wide(line: str, fewest: int) -> bool:
    return max(line.count(mark) for mark in ",;\t|") >= fewest - 1


# Stamps of any dialect are rewritten to the ISO form of the kernels, on the clock of the first row.
#
# A stamp with an offset from UTC is an instant. Where the offset changes, the later stamps are converted to
# the first one, so that no hour is lost or gained, and the change is noted.

NOON = 12
DAY_S = 86_400
LONGEST_SET_BACK_S = 3 * 3600
"""A clock is set back by no more than this (daylight saving, a zone): a larger step back is a new day."""
LATEST_S = 600
"""Rows come late by no more than this."""
FIRST_DAY = datetime(1970, 1, 2)  # noqa: DTZ001 - for an unknown date
EPOCH = datetime(1970, 1, 1)  # noqa: DTZ001 - as the kernels count
MOST_CHANGES = 20


@dataclass(frozen=True, slots=True)
class OffsetChange:
    """The first stamp with another offset, and both offsets in seconds east of UTC.

    The stamp is in microseconds since 1970 on the first row's clock. ``first_s``: offset of the first row.
    """

    at_us: int
    before_s: int
    after_s: int
    first_s: int


class StampWriter:
    """Rewrites the stamps of one table, from its first row on.

    ``changes``: changes of the offset from UTC.
    """

    def __init__(self, dialect: DateDialect) -> None:
        self.changes: list[OffsetChange] = []
        self._dialect = dialect
        self._offset_s = dialect.offset_s
        self._day = FIRST_DAY
        self._last_s: float | None = None
        self._line_end = -1

    def rewrite(self, text: str) -> str:
        """Write every stamp as `2026-03-14T08:00:00.010`; a separate time column is left empty."""
        write = self._write if self._dialect.has_date else self._write_undated
        self._line_end = -1
        return self._dialect.pattern.sub(write, text)

    def _write(self, found: re.Match[str]) -> str:
        parts, order = found.group("first", "second", "third"), self._dialect.order
        year, month, day = (parts[order.index(letter)] for letter in "ymd")
        clock = f"{_count_hour(found):02d}:{found['minute']}:{_read_seconds(found)}"
        stamp = f"{_complete_year(int(year))}-{_read_part(month):02d}-{day:0>2}T{clock}"
        is_first = found.start() > self._line_end  # a second stamp of a row may have another offset
        if is_first:
            self._line_end = found.string.find("\n", found.end()) % (len(found.string) + 1)
        moved, between = self._move(stamp, found["zone"], is_first=is_first), found["between"]
        return (
            found.group()
            if moved is None
            else moved + (re.sub(r"[T \"]", "", between) if re.search(r"[,;\t|]", between) else "")
        )

    def _move(self, stamp: str, zone: str | None, *, is_first: bool = True) -> str | None:
        """Convert a stamp to the first row's clock; None for an impossible date.

        A stamp without a zone, among stamps with one, takes the last zone.
        """
        offset_s = parse_zone_s(zone) if zone else self._offset_s
        if offset_s is None or self._dialect.offset_s is None:
            return None if zone else stamp
        step_s = offset_s - self._dialect.offset_s
        if step_s == 0 and (offset_s == self._offset_s or not is_first):
            return stamp
        try:
            moment = datetime.fromisoformat(stamp.replace(",", ".")) - timedelta(seconds=step_s)
        except (ValueError, OverflowError):
            return None
        if is_first and offset_s != self._offset_s and self._offset_s is not None:
            at_us = (moment - EPOCH) // timedelta(microseconds=1)
            self.changes.append(OffsetChange(at_us, self._offset_s, offset_s, self._dialect.offset_s))
        self._offset_s = offset_s if is_first else self._offset_s
        return moment.isoformat(timespec="microseconds")

    def _write_undated(self, found: re.Match[str]) -> str:
        """Add the date to a time of day; a step back of more than a few hours means that midnight passed.

        A step forward is a pause of any length, unless the row is a late one from before midnight.
        """
        hour = _count_hour(found)
        time_s = 3600.0 * hour + 60.0 * int(found["minute"]) + float(_read_seconds(found).replace(",", "."))
        step_s = 0.0 if self._last_s is None else time_s - self._last_s
        if step_s < -LONGEST_SET_BACK_S:
            self._day += timedelta(days=1)
        elif step_s > DAY_S - LATEST_S:
            self._day -= timedelta(days=1)
        self._last_s = time_s
        stamp = f"{self._day:%Y-%m-%d}T{hour:02d}:{found['minute']}:{_read_seconds(found)}"
        moved = self._move(stamp, found["zone"])
        return found.group() if moved is None else found["before"] + moved


def _read_seconds(found: re.Match[str]) -> str:
    """Return the seconds of a stamp; some loggers write a colon before the milliseconds."""
    return found["seconds"].replace(":", ".")


def _count_hour(found: re.Match[str]) -> int:
    hour, half = int(found["hour"]), found["half"]
    if half is None:
        return hour
    return hour % NOON + (NOON if half.strip()[0] in "Pp" else 0)


class TextWriter(Protocol):
    """A writer that rewrites whole lines of text."""

    def rewrite(self, text: str) -> str:
        """Rewrite whole lines."""


def rewrite_pieces(pieces: Iterable[bytes], writer: TextWriter | None) -> Iterator[bytes]:
    """Rewrite pieces of any length, whole lines at a time."""
    if writer is None:
        yield from pieces
        return
    carried = b""
    for piece in pieces:
        cut = piece.rfind(b"\n") + 1
        if cut:
            yield writer.rewrite((carried + piece[:cut]).decode("latin-1")).encode("latin-1")
            carried = b""
        carried += piece[cut:]
    yield writer.rewrite(carried.decode("latin-1")).encode("latin-1")


def flag_changes(changes: Iterable[OffsetChange], first_stamp_us: int) -> tuple[QualityFlag, ...]:
    """Flag the first 20 changes of the offset from UTC.

    W-DST if some time zone made this change at about that time, else W-OFFSET.
    """
    flags: tuple[QualityFlag, ...] = ()
    for change in list(changes)[:MOST_CHANGES]:
        moment = datetime_at_us(change.at_us - change.first_s * MICROSECONDS)
        is_daylight_saving = moment is not None and is_change_of_offset(
            moment.replace(tzinfo=UTC), change.before_s, change.after_s
        )
        at_s = (change.at_us - first_stamp_us) / MICROSECONDS
        code = Caveat.DST if is_daylight_saving else Caveat.OFFSET
        flags += (QualityFlag(code, 1, 0.0, at_s, at_s, {"step_s": change.after_s - change.before_s}),)
    return flags
