"""What a `.gt3x` gives reason to say: from its records, its info.txt and its clock."""

from collections.abc import Sequence
from typing import Protocol

from fusion.readers.gt3x_clock import Timeline
from fusion.readers.gt3x_events import DeviceEvents
from fusion.readers.gt3x_info import DeviceText
from fusion.readers.gt3x_log import ScanTally
from fusion.readers.gt3x_primary import (
    LARGEST_DIFFERENCE_G,
    PrimarySecond,
    contradicts_header,
    measure_bias_g,
)
from fusion.readers.samples import SampleColumns
from fusion.readers.timing import LARGEST_DRIFT
from fusion.recording import QualityFlag, Segment

EARLY_END_S = 60.0
LOW_BATTERY_MV = 3600
"""A lithium cell under this is about to switch the device off."""
IMU_RATE_HZ = 100.0
TURNED_SERIAL, TURNED_FIRMWARE = "MOS", "1.6.0"
"""ActiGraph documents axes turned by 90 degrees in the ACTIVITY records of these; see docs/decisions."""


class GatheredLog(Protocol):
    """What this module needs of a decoded log."""

    columns: SampleColumns
    events: DeviceEvents
    n_undecoded: int

    @property
    def scan(self) -> ScanTally:
        """What the scan met."""

    @property
    def primary_seconds(self) -> Sequence[PrimarySecond]:
        """Seconds of the primary accelerometer that were looked at."""


def flag_file(
    text: DeviceText, log: GatheredLog, timeline: Timeline, segments: Sequence[Segment]
) -> tuple[QualityFlag, ...]:
    """Caveats that come from the records and from info.txt."""
    counts = {
        "W-ROWS-DROPPED": log.n_undecoded,
        "W-RESETS": int(text.number("Unexpected Resets") or 0),
        "W-ENCODING": int(text.encoding != "utf-8"),
        "W-TZ": int(_is_zone_unclear(text, counts_utc=log.events.counts_utc)),
        "W-EARLY-END": int(_ended_early_s(text, timeline) > EARLY_END_S),
        "W-BATTERY": int(0 < log.events.battery_mv < LOW_BATTERY_MV),
        "W-FIRMWARE": int(_has_turned_axes(text)),
    }
    flags = tuple(QualityFlag(code, count) for code, count in counts.items() if count > 0)
    return flag_damage(log.scan, timeline) + flags + flag_rates(text, log, timeline, segments)


def flag_damage(scan: ScanTally, timeline: Timeline) -> tuple[QualityFlag, ...]:
    """Records that do not verify, with the place of the first and the last, and a tail that is cut off."""
    places = [timeline.place_s(unix_s) for unix_s in (scan.first_damage_unix_s, scan.last_damage_unix_s)]
    first_s, last_s = (float(min(max(0, place), timeline.runs[-1].end_s)) for place in places)
    flags = tuple(
        QualityFlag(code, count, 0.0, first_s, last_s)
        for code, count in (("W-CHECKSUM", scan.bad_checksums), ("W-RESYNC", scan.resyncs))
        if count
    )
    if scan.tail_bytes:
        end_s = float(timeline.runs[-1].end_s)
        flags += (QualityFlag("W-TRUNC-TAIL", 1, 0.0, end_s, end_s, {"n": scan.tail_bytes}),)
    return flags


def flag_rates(
    text: DeviceText, log: GatheredLog, timeline: Timeline, segments: Sequence[Segment]
) -> tuple[QualityFlag, ...]:
    """Where header, nominal rate and the two accelerometers contradict each other."""
    seen = log.primary_seconds
    rate_hz = round(max(segments, key=len).rate_hz, 3)
    flags: tuple[QualityFlag, ...] = ()
    if contradicts_header(seen, text.number("Sample Rate")):
        flags += (QualityFlag("W-RATE", facts={"rate_hz": rate_hz, "rate_from": "measured"}),)
    if abs(rate_hz / IMU_RATE_HZ - 1.0) > LARGEST_DRIFT:
        flags += (QualityFlag("W-DRIFT", facts={"nominal_hz": IMU_RATE_HZ, "rate_hz": rate_hz}),)
    bias_g = measure_bias_g(seen, text, timeline, log.columns)
    if bias_g is not None and bias_g > LARGEST_DIFFERENCE_G:
        flags += (QualityFlag("W-BIAS", facts={"g": round(bias_g, 3)}),)
    return flags


def _is_zone_unclear(text: DeviceText, *, counts_utc: bool) -> bool:
    """Whether a zone is written that nobody understands, or UTC is counted with no zone told."""
    return text.offset_s is None and ("TimeZone" in text.values or counts_utc)


def _ended_early_s(text: DeviceText, timeline: Timeline) -> float:
    planned_s = text.unix_s("Stop Date")
    return 0.0 if planned_s is None else planned_s - float(timeline.seconds.unix_s[-1] + 1)


def _has_turned_axes(text: DeviceText) -> bool:
    serial, firmware = text.values.get("Serial Number", ""), text.values.get("Firmware", "")
    return serial.startswith(TURNED_SERIAL) and firmware == TURNED_FIRMWARE
