"""All caveat codes, each with its grade and its facts, in the order of the list in the docs.

A caveat qualifies a result; an error (:mod:`acromion.fusion.errors`) means that there is no result.
:class:`acromion.fusion.recording.QualityFlag` is one caveat of one recording. ``app/report/words`` has the
texts under the same code. The table in ``docs/reference/codes.md`` is generated from this module.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum, StrEnum
from math import inf
from types import MappingProxyType
from typing import Self

TERM = "a fixed term"
"""The meaning of a fact that the words files translate into both languages."""


def name_facts(**meanings: str) -> Mapping[str, str]:
    """Declare the facts of a code: each name with its unit or meaning."""
    return MappingProxyType(meanings)


class Grade(IntEnum):
    """The effect of a caveat on the verdict: none, "caution" or "poor"."""

    NOTE = 0
    CAUTION = 1
    POOR = 2


NOTE, CAUTION, POOR = Grade


@dataclass(frozen=True, slots=True)
class Limit:
    """When a caveat counts one grade higher than usual.

    ``from_share``: if it concerns at least this share of the recorded time.
    """

    from_share: float = inf


NO_LIMIT = Limit()
NO_FACTS = name_facts()
FEW_H = 4
"""With fewer hours analysed a recording is short, and is not compared with values for a working day."""


class Caveat(StrEnum):
    """A code (``str(Caveat.GAP)`` is "W-GAP") with its grade and facts.

    ``grade``: the usual effect on the verdict.
    ``fact_meanings``: the allowed names in :attr:`QualityFlag.facts`, each with its unit or meaning.
    ``limit``: when it counts one grade higher.
    """

    grade: Grade
    fact_meanings: Mapping[str, str]
    limit: Limit

    def __new__(
        cls,
        code: str,
        grade: Grade = CAUTION,
        fact_meanings: Mapping[str, str] = NO_FACTS,
        limit: Limit = NO_LIMIT,
    ) -> Self:
        """Create a member whose value is its code, so that ``Caveat(code)`` finds it."""
        caveat = str.__new__(cls, code)
        caveat._value_ = code
        caveat.grade, caveat.fact_meanings, caveat.limit = grade, fact_meanings, limit
        return caveat

    # The file and its bytes.
    TRUNC_TAIL = "W-TRUNC-TAIL", CAUTION, name_facts(n="bytes skipped")
    CHECKSUM = "W-CHECKSUM", CAUTION
    RESYNC = "W-RESYNC", CAUTION
    SESSION = "W-SESSION", CAUTION, name_facts(n="samples skipped")
    DUP_UPLOAD = "W-DUP-UPLOAD", NOTE
    DUP_FILE = "W-DUP-FILE", NOTE
    ENCODING = "W-ENCODING", NOTE
    LOCALE = "W-LOCALE", NOTE
    HEADER = "W-HEADER", CAUTION, name_facts(text="lines, as in the file")
    HEADER_REPEAT = "W-HEADER-REPEAT", NOTE
    PRECISION = "W-PRECISION", NOTE
    READER = "W-READER", NOTE, name_facts(reader="name", version="of its package", cause="in English")
    SIDE_ASSUMED = "W-SIDE-ASSUMED", CAUTION

    # The device.
    BATTERY = "W-BATTERY", NOTE
    FIRMWARE = "W-FIRMWARE", NOTE
    RESETS = "W-RESETS", CAUTION
    DOCKED = "W-DOCKED", NOTE
    SLEEP = "W-SLEEP", CAUTION
    EARLY_END = "W-EARLY-END", CAUTION

    # Rows: missing, repeated or out of order.
    GAP = "W-GAP", NOTE, NO_FACTS, Limit(from_share=0.01)
    PAUSE = "W-PAUSE", CAUTION
    NAN = "W-NAN", CAUTION
    ROWS_DROPPED = "W-ROWS-DROPPED", CAUTION, name_facts(line="first line skipped")
    DUP = "W-DUP", NOTE
    DUP_CONFLICT = "W-DUP-CONFLICT", CAUTION
    ORDER = "W-ORDER", NOTE

    # The clock and the rate.
    CLOCK_BACK = "W-CLOCK-BACK", CAUTION, name_facts(step_s="s")
    CLOCK_FWD = "W-CLOCK-FWD", CAUTION, name_facts(step_s="s")
    CLOCK_UNSET = "W-CLOCK-UNSET", NOTE
    CLOCK_SET = "W-CLOCK-SET", NOTE, name_facts(offset="h:min:s, added")
    WRAP = "W-WRAP", NOTE
    SEC_COUNT = "W-SEC-COUNT", NOTE
    JITTER = "W-JITTER", CAUTION
    DRIFT = "W-DRIFT", CAUTION, name_facts(nominal_hz="Hz, stated", rate_hz="Hz, measured")
    RATE = (
        "W-RATE",
        CAUTION,
        name_facts(rate_hz="Hz, used", rate_from=TERM, other_hz="Hz, the other possibility"),
    )
    ACC_RATE = "W-ACC-RATE", NOTE, name_facts(acc_hz="Hz of the accelerometer", gyr_hz="Hz of the gyroscope")
    RATE_CHANGE = "W-RATE-CHANGE", CAUTION, name_facts(rate_hz="Hz, of the longest such stretch")
    TZ = "W-TZ", NOTE
    UTC = "W-UTC", NOTE
    DST = "W-DST", NOTE, name_facts(step_s="s", zone="name, as stated")
    OFFSET = "W-OFFSET", CAUTION, name_facts(step_s="s")
    NO_DATE = "W-NO-DATE", NOTE, name_facts(time_of_day="time of the first row")
    DATE_ORDER = "W-DATE-ORDER", CAUTION, name_facts(date="date of the first row, as read")
    START = "W-START", NOTE, name_facts(header="start by the header", first="time of the first row")
    MULTIDAY = "W-MULTIDAY", CAUTION
    FEW_DAYS = "W-FEW-DAYS", CAUTION
    """No code raises it; the help page still lists it."""

    # The signal.
    UNITS = (
        "W-UNITS",
        CAUTION,
        {
            "what": TERM,
            "evidence": TERM,
            "factor": "times",
            "g": "g at rest, as read",
            "turned": "axes reversed",
            "unit": "unit named",
            "read_as": "unit read",
            "rate_hz": "Hz, as read",
        },
    )
    SCALE_DOUBT = (
        "W-SCALE-DOUBT",
        CAUTION,
        name_facts(
            sensor=TERM,
            factor="times, that would fit",
            g="g at rest, as read",
            moving_g="g (median), never at rest",
        ),
    )
    MIXED = "W-MIXED", CAUTION, name_facts(percent="% unexplained", turns="stretches")
    CLIP = "W-CLIP", NOTE, NO_FACTS, Limit(from_share=0.001)
    SPIKE = "W-SPIKE", CAUTION
    STUCK_PART = "W-STUCK-PART", CAUTION, name_facts(filled=TERM)
    RESOLUTION = (
        "W-RESOLUTION",
        CAUTION,
        name_facts(step_mg="mg from one reading to the next", step_dps="deg/s from one reading to the next"),
    )
    BIAS = "W-BIAS", CAUTION, name_facts(g="g between the two accelerometers")
    GYRO_DRIFT = "W-GYRO-DRIFT", CAUTION, name_facts(dps="deg/s")
    ACC_DRIFT = "W-ACC-DRIFT", CAUTION, name_facts(mg="mg at rest, between start and end")
    UNTRUSTED = "W-UNTRUSTED", NOTE, NO_FACTS, Limit(from_share=0.01)

    # The sensor on the arm, and the calibration pose.
    NO_STILL = "W-NO-STILL", POOR, name_facts(deg="deg (sigma)")
    POSE_SHORT = "W-POSE-SHORT", CAUTION
    POSE_ASSUMED = "W-POSE-ASSUMED", CAUTION
    WHICH_POSE = "W-WHICH-POSE", CAUTION, name_facts(apart_deg="deg between the candidates")
    NOT_HELD = "W-NOT-HELD", CAUTION
    CARRIED = "W-CARRIED", CAUTION
    POSE_UNSTEADY = "W-POSE-UNSTEADY", CAUTION, name_facts(what=TERM)
    POSE_DOUBT = "W-POSE-DOUBT", POOR
    POSES_DIFFER = (
        "W-POSES-DIFFER",
        CAUTION,
        name_facts(apart_deg="deg between two poses"),
        Limit(from_share=0.5),
    )
    SLIP = "W-SLIP", CAUTION, name_facts(apart_deg="deg between the directions of the hanging arm")
    PUT_BACK = "W-PUT-BACK", CAUTION
    AXIS = "W-AXIS", CAUTION, name_facts(deg="deg (sigma)")
    LEAN = "W-LEAN", CAUTION
    NPOSE = "W-NPOSE", NOTE, name_facts(reads_low_by_up_to_deg="deg")
    NONWEAR = "W-NONWEAR", CAUTION
    REMOUNT = "W-REMOUNT", CAUTION, NO_FACTS, Limit(from_share=0.5)
    UPSIDE = "W-UPSIDE", POOR, name_facts(deg="deg (median)")

    # The amount of analysed time, and the method.
    LOWCOVER = "W-LOWCOVER", POOR, name_facts(percent="% analysed")
    SHORT = "W-SHORT", NOTE
    FEW_HOURS = (
        "W-FEW-HOURS",
        NOTE,
        name_facts(hours="h, less than", minutes="min, less than: no ranges, no rates per hour"),
    )
    PUBLISHED = "W-PUBLISHED", CAUTION, name_facts(dps="deg/s")
    DIARY = "W-DIARY", CAUTION, name_facts(lines="numbers of the lines")
    OVERLAP = "W-OVERLAP", NOTE


TIME_LOST = frozenset(
    {
        Caveat.GAP,
        Caveat.DOCKED,
        Caveat.SLEEP,
        Caveat.CLIP,
        Caveat.SPIKE,
        Caveat.STUCK_PART,
        Caveat.UNTRUSTED,
    }
)
"""Caveats whose seconds were not analysed. The seconds of all others only state a place or a length."""
