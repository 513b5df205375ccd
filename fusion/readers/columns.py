"""What a column's name says: which channel, which axis, which unit.

The alias table was gathered from the layouts seen in the wild (libraries of Arduino, SparkFun, Adafruit,
x-io, ActiLife, Xsens, phone loggers), with the names of French exports.
"""

import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

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


def understand_column(name: str) -> Column:
    """Tell channel, axis and unit from a header's field."""
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
