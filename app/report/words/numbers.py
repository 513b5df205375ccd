"""Numbers, durations, clock times and dates in English and French format.

All languages group thousands with a narrow no-break space and put a no-break space before the percent sign
(ISO 80000-1; narrow except in French); French uses "10 h 42" and the decimal comma.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date, datetime, tzinfo
from itertools import pairwise
from typing import TYPE_CHECKING

from acromion.app.report.words.wording import Language, fill, is_french, load_wording
from acromion.fusion.clocks import format_offset, is_repeated, read_clock

if TYPE_CHECKING:
    from acromion.fusion.exposure.types import Interval  # the page uses this module without ``fusion``


NARROW = "\u202f"
NO_BREAK = "\u00a0"
NONE = "–"
MINUTE_S = 60
HOUR_S = 3600
SHORT_S = 600


def format_number(value: float | None, decimals: int, language: Language) -> str:
    """Round and format; return an en dash if there is no value."""
    if value is None or not math.isfinite(value):
        return NONE
    text = f"{value:,.{decimals}f}".replace("-", "−")
    if not text.strip("−0.,"):
        text = text.lstrip("−")
    whole, _, fraction = text.partition(".")
    mark = "." if language == "en" else ","
    return whole.replace(",", NARROW) + (mark + fraction if fraction else "")


def format_signed(value: float, language: Language) -> str:
    """Format a difference with one decimal and its sign: "+1.2", "−0.4"."""
    return ("+" if round(value, 1) > 0 else "") + format_number(value, 1, language)


def format_exact(value: float, language: Language) -> str:
    """Format with up to six decimals, without trailing zeros, so that sums can be checked by hand."""
    mark = "." if language == "en" else ","
    text = format_number(value, 6, language).rstrip("0")
    return text.removesuffix(mark)


def format_percent(percent: float | None, language: Language) -> str:
    """Format a percentage, always with one decimal."""
    text = format_number(percent, 1, language)
    return text if text == NONE else text + percent_sign(language)


def percent_sign(language: Language) -> str:
    """Return the sign with its leading space: no-break in French, narrow in English."""
    return f"{NO_BREAK if is_french(language) else NARROW}%"


def format_angle(angle_deg: float | None, language: Language, decimals: int = 0) -> str:
    """Format degrees; the sign follows without a space in both languages."""
    text = format_number(angle_deg, decimals, language)
    return text if text == NONE else f"{text}°"


def format_classes(edges: Sequence[float | None], unit: str) -> tuple[str, ...]:
    """Format classes by their edges: "3–7 s"; the last may be open."""
    return tuple(
        f"≥ {low:g}{unit}" if high is None else f"{low:g}–{high:g}{unit}" for low, high in pairwise(edges)
    )


def round_classes(percents: Sequence[float]) -> list[int]:
    """Round the shares of all classes, from the lowest, to whole numbers that add up to 100.

    Each is the difference of two rounded times above an edge: 27 % above 30° and 14 % above 60° leave 13 %
    between them, also if the share itself is 12.4 %. It is never more than 1 point from the share.
    """
    above = [math.floor(sum(percents[k:]) + 0.5 + 1e-9) for k in range(len(percents) + 1)]
    return [low - high for low, high in pairwise(above)]


def format_range(interval: "Interval | None", language: Language) -> str:
    """Format a range of shares: "6.0–9.5 %"; empty without an interval."""
    if interval is None:
        return ""
    return f"{format_number(interval.low, 1, language)}–{format_percent(interval.high, language)}"


def format_angle_range(interval: "Interval | None", language: Language, decimals: int = 0) -> str:
    """Format a range of angles: "44–57°"; empty without an interval."""
    if interval is None:
        return ""
    low = format_number(interval.low, decimals, language)
    return f"{low}–{format_angle(interval.high, language, decimals)}"


def format_ends(interval: "Interval | None", decimals: int, language: Language) -> str:
    """Format both ends of a range without a unit: "2.5–6.0"; empty without an interval."""
    if interval is None:
        return ""
    return "–".join(format_number(end, decimals, language) for end in (interval.low, interval.high))


def format_duration_range(interval: "Interval", language: Language) -> str:
    """Format a range of durations, "40 s–1 min 5 s"; round equal ends outwards."""
    low, high = interval.low, interval.high
    if format_duration(low, language) == format_duration(high, language) and high < SHORT_S:
        per_s = 10 if round(high, 1) < 10 else 1
        low, high = math.floor(low * per_s) / per_s, math.ceil(high * per_s) / per_s
    return f"{format_duration(low, language)}–{format_duration(high, language)}"


def format_rate(rate_per_h: float | None, language: Language) -> str:
    """Format a rate per hour: no decimals from 10, one decimal below."""
    decimals = 0 if rate_per_h is None or rate_per_h >= 9.95 else 1
    return format_number(rate_per_h, decimals, language)


def format_duration(duration_s: float | None, language: Language) -> str:
    """Format a duration in its two leading units: "6 h 48 min", "31 min", "2 min 59 s", "4.2 s"."""
    if duration_s is None or not math.isfinite(duration_s):
        return NONE
    if round(duration_s, 1) < 10:
        decimals = 0 if round(duration_s, 1) % 1 == 0 else 1
        return f"{format_number(duration_s, decimals, language)}{NARROW}s"
    if round(duration_s) < SHORT_S:
        minutes, rest = divmod(round(duration_s), MINUTE_S)
        return _join_units((minutes, "min"), (rest, "s"))
    hours, minutes = divmod(round(duration_s / MINUTE_S), 60)
    return _join_units((hours, "h"), (minutes, "min"))


def format_long_duration(duration_s: float) -> str:
    """Format a duration of any length to the second: "6 h 48 min 12 s"."""
    hours, rest = divmod(round(duration_s), HOUR_S)
    minutes, rest = divmod(rest, MINUTE_S)
    return _join_units((hours, "h"), (minutes, "min"), (rest, "s"))


def format_clock(moment: datetime, language: Language, *, with_seconds: bool = False) -> str:
    """Format a clock time: "10:42" or "10 h 42"."""
    if not is_french(language):
        return moment.strftime("%H:%M:%S" if with_seconds else "%H:%M")
    text = f"{moment.hour}{NARROW}h{NARROW}{moment.minute:02d}"
    return f"{text}{NARROW}min{NARROW}{moment.second:02d}{NARROW}s" if with_seconds else text


def format_moment(moment: datetime, language: Language, *, with_seconds: bool = False) -> str:
    """Format a date with its clock time: "2026-11-26 22:11" or "2026-11-26 22 h 11"."""
    return f"{moment:%Y-%m-%d} {format_clock(moment, language, with_seconds=with_seconds)}"


def add_offset(text: str, moment: datetime) -> str:
    """Return a formatted time with its offset from UTC: "02:30 UTC+2"; unchanged if it has none."""
    offset = moment.utcoffset()
    if offset is None:
        return text
    shown = re.sub("(?<=[-+])0|:00", "", format_offset(round(offset.total_seconds())))
    return f"{text}{NO_BREAK}{shown.replace('-', '−')}"


def format_interval(interval: str, language: Language, zone: tzinfo | None) -> str:
    """Format an interval in ISO 8601 with its dates, in ``zone`` if it has offsets from UTC."""
    start, end = map(datetime.fromisoformat, interval.split("/"))
    shown = start.astimezone(zone) if start.tzinfo and zone else start
    return Clock(shown, language, (end - start).total_seconds()).format_whole()


def format_iso_moment(text: str, language: Language, *, with_seconds: bool = False) -> str:
    """Format a time in ISO 8601 in the zone that it states; return "" for an empty text."""
    return format_moment(datetime.fromisoformat(text), language, with_seconds=with_seconds) if text else ""


def format_hour(moment: datetime, language: Language) -> str:
    """Format a clock time for an axis, short for a whole hour in French: "8 h"."""
    if is_french(language) and moment.minute == 0:
        return f"{moment.hour}{NARROW}h"
    return format_clock(moment, language)


def format_elapsed(elapsed_s: float) -> str:
    """Format time since the first sample: "1:02:05"."""
    hours, rest = divmod(round(elapsed_s), HOUR_S)
    return f"{hours}:{rest // MINUTE_S:02d}:{rest % MINUTE_S:02d}"


def format_date(day: date, language: Language, *, with_year: bool = True) -> str:
    """Format an unambiguous date: "3 March 2026", "3 mars 2026"."""
    month = load_wording(language)["months"][day.month - 1]
    number = "1er" if is_french(language) and day.day == 1 else str(day.day)
    return f"{number}\u00a0{month}" + (f"\u00a0{day.year}" if with_year else "")


def _join_units(*parts: tuple[int, str]) -> str:
    shown = [f"{count}{NARROW}{unit}" for count, unit in parts if count]
    return "\u00a0".join(shown) or f"0{NARROW}{parts[-1][1]}"


@dataclass(frozen=True, slots=True)
class Clock:
    """Converts seconds of the recording to the device's clock, if the file has one.

    If the recording ends on another date than it starts, every time has its date. A time that its zone shows
    twice has its offset from UTC.
    """

    start: datetime | None
    language: Language = "en"
    duration_s: float = 0.0

    def at(self, elapsed_s: float) -> datetime | None:
        """Return the clock time in the zone of the recording; None without a clock.

        It follows the changes of a known zone; a device clock without a zone keeps counting.
        """
        if self.start is None:
            return None
        return read_clock(self.start, round(elapsed_s * 1e6))

    def format(self, elapsed_s: float, *, with_seconds: bool = False) -> str:
        """Format the time: "10:42", "10:42 on 3 March", or "2:44:00" since the first sample."""
        return self._add_day(self._format_time(elapsed_s, with_seconds), self.format_day(elapsed_s))

    def format_span(self, start_s: float, end_s: float) -> dict[str, str]:
        """Format ``start`` and ``end`` of a span; only ``time`` if both read the same.

        A date that both share is only in ``end``.
        """
        start, end = self.format(start_s), self.format(end_s)
        if start == end:
            return {"time": start, "end": end}
        is_one_day = self.format_day(start_s) == self.format_day(end_s)
        return {"start": self._format_time(start_s) if is_one_day else start, "end": end}

    def format_range(self, start_s: float, end_s: float, *, is_hour: bool = False) -> str:
        """Format a span: "10:42–11:42", "23:30–23:45 on 3 March"; with ``is_hour`` in French "8 h–9 h"."""
        write = self._format_hour if is_hour else self._format_time
        start, end = write(start_s), write(end_s)
        if is_hour and start == end:
            end = self._format_time(end_s, with_seconds=True)
        day, last_day = self.format_day(start_s), self.format_day(end_s)
        dash = "–" if day == last_day else " – "
        return self._add_day(start, day if day != last_day else "") + dash + self._add_day(end, last_day)

    def format_whole(self) -> str:
        """Format the start and end with their dates; empty without a clock.

        Both have their offset from UTC if it changes between them, or if one of them is ambiguous.
        """
        start, end = self.start, self.at(self.duration_s)
        if start is None or end is None:
            return ""
        facts = {
            "date": format_date(start, self.language),
            "start": format_clock(start, self.language),
            "last": format_date(end, self.language),
            "end": format_clock(end, self.language),
        }
        if start.utcoffset() != end.utcoffset() or is_repeated(start) or is_repeated(end):
            facts |= {name: add_offset(facts[name], at) for name, at in (("start", start), ("end", end))}
        key = "from_to" if facts["date"] == facts["last"] else "from_to_days"
        return fill(load_wording(self.language)["heading"][key], facts)

    def format_tick(self, elapsed_s: float) -> str:
        """Format the time under an axis; its date is below it."""
        moment = self.at(elapsed_s)
        return format_elapsed(elapsed_s) if moment is None else format_hour(moment, self.language)

    def format_offset(self, elapsed_s: float) -> str:
        """Format the offset from UTC of a time that its zone shows twice: "UTC+2"; else empty."""
        moment = self.at(elapsed_s)
        return add_offset("", moment).strip() if moment is not None and is_repeated(moment) else ""

    def format_day(self, elapsed_s: float) -> str:
        """Format the date of a time: "3 March"; empty if the recording has only one date, or no clock."""
        moment, end = self.at(elapsed_s), self.at(self.duration_s)
        if self.start is None or moment is None or end is None or end.date() == self.start.date():
            return ""
        return format_date(moment, self.language, with_year=False)

    def _format_time(self, elapsed_s: float, with_seconds: bool = False) -> str:  # noqa: FBT001, FBT002
        moment = self.at(elapsed_s)
        if moment is None:
            return format_elapsed(elapsed_s)
        shown = format_clock(moment, self.language, with_seconds=with_seconds)
        return add_offset(shown, moment) if is_repeated(moment) else shown

    def _format_hour(self, elapsed_s: float) -> str:
        tick, offset = self.format_tick(elapsed_s), self.format_offset(elapsed_s)
        return f"{tick}{NO_BREAK}{offset}" if offset else tick

    def _add_day(self, time: str, day: str) -> str:
        return fill(load_wording(self.language)["heading"]["time_on"], {"time": time, "date": day})

    def seconds_to_whole_hour(self) -> float:
        """Return the time from the first sample to the first whole hour in s; 0 without a clock."""
        if self.start is None:
            return 0.0
        into = self.start.minute * 60 + self.start.second + self.start.microsecond / 1e6
        return (3600 - into) % 3600
