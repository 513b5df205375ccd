"""What a `.gt3x` says happened besides measuring: idle sleep, the USB dock, how its clock counts."""

import re
from collections.abc import Iterable
from dataclasses import dataclass, field

from fusion.recording import MICROSECONDS, Span

ACTIVITY, BATTERY, EVENT, METADATA, SCHEMA, SENSOR_DATA, ACTIVITY2 = 0, 2, 3, 6, 24, 25, 26
SLEEP_ENTER, SLEEP_LEAVE = 0x08, 0x09
ZONE_NAME = re.compile(rb'"Name" ?: ?"(\(UTC[^"]{1,80})"')
MAX_EVENTS = 200_000
"""More than any shift can hold; further ones are counted only."""


@dataclass(slots=True)
class DeviceEvents:
    """Gathered while the log is read. ``sleep``: (Unix seconds, entering); ``battery_mv``: the last."""

    sleep: list[tuple[int, bool]] = field(default_factory=list)
    docked_s: list[int] = field(default_factory=list)
    counts_utc: bool = False
    zone_name: str = ""
    battery_mv: int = 0
    ignored: int = 0

    def note(self, kind: int, unix_s: int, payload: bytes) -> None:
        """Take one record that is neither samples nor schema."""
        if len(self.sleep) + len(self.docked_s) >= MAX_EVENTS:
            self.ignored += 1
        elif kind == EVENT and payload[:1] in (bytes([SLEEP_ENTER]), bytes([SLEEP_LEAVE])):
            self.sleep.append((unix_s, payload[0] == SLEEP_ENTER))
        elif kind in (ACTIVITY, ACTIVITY2) and len(payload) == 1:
            self.docked_s.append(unix_s)
        elif kind == METADATA:
            self._note_clock(payload.replace(b"\\", b""))
        elif kind == BATTERY and len(payload) == 2:
            self.battery_mv = int.from_bytes(payload, "little")

    def _note_clock(self, text: bytes) -> None:
        self.counts_utc = self.counts_utc or b'"UsedUtc":true' in text.replace(b" ", b"")
        found = ZONE_NAME.search(text)
        if found:
            self.zone_name = found.group(1).decode("latin-1")


def pair_sleep(sleep: Iterable[tuple[int, bool]], last_unix_s: int) -> list[tuple[int, int]]:
    """Idle sleep as (from, to) in Unix seconds; one that never ends lasts to the last stamp of the file.

    Leaving without having entered is ignored.
    """
    spans: list[tuple[int, int]] = []
    entered: int | None = None
    for unix_s, is_entering in sleep:
        if is_entering and entered is None:
            entered = unix_s
        elif not is_entering and entered is not None:
            spans.append((entered, unix_s))
            entered = None
    if entered is not None:
        spans.append((entered, last_unix_s))
    return [(start, end) for start, end in spans if end > start]


def merge_seconds(seconds: Iterable[int]) -> list[tuple[int, int]]:
    """Join single seconds into (from, to)."""
    spans: list[tuple[int, int]] = []
    for second in sorted(set(seconds)):
        if spans and spans[-1][1] == second:
            spans[-1] = (spans[-1][0], second + 1)
        else:
            spans.append((second, second + 1))
    return spans


def cut_out(start: int, end: int, covered: Iterable[tuple[int, int]]) -> list[tuple[int, int]]:
    """What of [start, end) is not covered; ``covered`` in order and without overlap."""
    left: list[tuple[int, int]] = []
    for first, stop in covered:
        if stop <= start or first >= end:
            continue
        if first > start:
            left.append((start, first))
        start = max(start, stop)
    if start < end:
        left.append((start, end))
    return left


def make_spans(spans_s: Iterable[tuple[int, int]], reason: str) -> tuple[Span, ...]:
    """Seconds to exact microseconds."""
    return tuple(Span(start * MICROSECONDS, (end - start) * MICROSECONDS, reason) for start, end in spans_s)
