"""Moments of a recording as people type and read them: the device's clock, or seconds where it has none."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any

from app.errors import BadParameter
from fusion.diary import DiaryEntry, read_diary
from fusion.errors import UnusableDiary
from fusion.periods import place_diary
from fusion.recording import MICROSECONDS

DAY_S = 86400.0


@dataclass(frozen=True, slots=True)
class DayClock:
    """When a recording began, and how long it is."""

    start: datetime | None
    duration_us: int

    @classmethod
    def of(cls, facts: Mapping[str, Any]) -> "DayClock":
        """Take it from the facts of a day file."""
        start = datetime.fromisoformat(facts["start"]) if facts["start"] else None
        return cls(start, int(facts["duration_us"]))

    @property
    def duration_s(self) -> float:
        """Seconds from the first sample to the end."""
        return self.duration_us / MICROSECONDS

    @property
    def needs_date(self) -> bool:
        """An hour alone may mean two days."""
        return self.duration_s >= DAY_S

    def tell(self, second: float) -> str:
        """Write a moment so that :meth:`read` gives it back, to the hundredth of a second."""
        if self.start is None:
            return f"{second:.2f}".rstrip("0").rstrip(".")
        moment = self.start + timedelta(seconds=round(second, 2))
        hundredths = f".{moment.microsecond // 10_000:02d}".rstrip("0").rstrip(".")
        return moment.strftime("%Y-%m-%d %H:%M:%S" if self.needs_date else "%H:%M:%S") + hundredths

    def tell_bounds(self) -> str:
        """Write from when to when a moment may be."""
        return f"{self.tell(0.0)} … {self.tell(self.duration_s)}"

    def read(self, text: str, name: str) -> float:
        """Read a moment that a person typed, in seconds from the first sample.

        Raises
        ------
        BadParameter
        """
        row = f"start;kind\n{text.replace(';', ' ')};task\n".encode()
        try:
            (placed,) = place_diary(read_diary(row), self.start, self.duration_us).periods
        except (UnusableDiary, ValueError):
            raise BadParameter(name=name, value=text[:60], allowed=self.tell_bounds()) from None
        return placed.start_us / MICROSECONDS


def place_rows(entries: Sequence[DiaryEntry], clock: DayClock) -> list[dict[str, Any]]:
    """Give the rows of a diary as the form shows them: clock times that can be typed again.

    Raises
    ------
    fusion.errors.UnusableDiary
    """
    periods = place_diary(entries, clock.start, clock.duration_us).periods
    return [
        {
            "kind": period.kind,
            "label": period.label,
            "start": clock.tell(period.start_us / MICROSECONDS),
            "end": clock.tell(period.end_us / MICROSECONDS),
        }
        for period in periods
    ]
