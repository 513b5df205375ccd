"""From seconds of the recording to the device's clock, where the file has one."""

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

from app.report.numbers import format_clock, format_elapsed, format_hour
from app.report.wording import Language


@dataclass(frozen=True, slots=True)
class Clock:
    """Tells the time of a second of the recording; without a start, time since the first sample."""

    start: datetime | None
    language: Language = "en"

    def at(self, seconds: float) -> datetime | None:
        """Give the clock time, in the zone of the recording; None without a clock.

        A zone with daylight saving is followed (UTC-stamped files); a device clock counts on.
        """
        if self.start is None:
            return None
        passed = timedelta(microseconds=round(seconds * 1e6))
        if self.start.tzinfo is None:
            return self.start + passed
        return (self.start.astimezone(UTC) + passed).astimezone(self.start.tzinfo)

    def tell(self, seconds: float, *, with_seconds: bool = False) -> str:
        """Write the time: "10:42", or "2:44:00" since the first sample."""
        moment = self.at(seconds)
        if moment is None:
            return format_elapsed(seconds)
        return format_clock(moment, self.language, with_seconds=with_seconds)

    def label_tick(self, seconds: float) -> str:
        """Write the time under an axis."""
        moment = self.at(seconds)
        return format_elapsed(seconds) if moment is None else format_hour(moment, self.language)

    def seconds_to_whole_hour(self) -> float:
        """Tell how long after the first sample the first whole hour (or, without a clock, zero) comes."""
        if self.start is None:
            return 0.0
        into = self.start.minute * 60 + self.start.second + self.start.microsecond / 1e6
        return (3600 - into) % 3600
