"""What `acromion inspect` tells: what the reader took the file for, and what is wrong with it."""

from collections.abc import Sequence

from fusion.readers.sanity import measure_sanity
from fusion.readers.timing import find_missing
from fusion.recording import MICROSECONDS, QualityFlag, Recording, Span

LISTED_GAPS = 100
"""The longest ones; the count is always given in full."""


def inspect_recording(recording: Recording, left_out: Sequence[Span] = ()) -> dict[str, object]:
    """A JSON-ready description of a recording, for the person and for the maker of a logger.

    ``recorded_s`` = ``present_s`` + ``missing_s``, to the microsecond; ``gaps`` are all holes, those of up
    to 50 ms too; ``samples`` are those that were measured; ``excluded`` names time that the device itself
    says it did not measure, or not on the arm.

    ``left_out``: what an analysis will exclude; that is not missing, here as there.
    """
    holes = find_missing(recording.segments, recording.duration_us, (*recording.excluded, *left_out))
    gaps = sorted(holes, key=lambda gap: -gap.duration_us)
    bridged_rows = sum(stop - first for s in recording.segments for first, stop in s.bridged)
    missing_us = sum(gap.duration_us for gap in gaps)
    return {
        "device": recording.device,
        "sha256": recording.sha256,
        "serial_hash": recording.serial_hash,
        "start": recording.start.isoformat() if recording.start else None,
        "time_zone": recording.time_zone,
        "recorded_s": recording.duration_us / MICROSECONDS,
        "present_s": (recording.duration_us - missing_us) / MICROSECONDS,
        "missing_s": missing_us / MICROSECONDS,
        "rate_hz": round(recording.rate_hz, 4),
        "nominal_rate_hz": _number(recording.understood.get("nominal_rate_hz")),
        "jitter_us": _number(recording.understood.get("jitter_us")),
        "samples": sum(len(segment) for segment in recording.segments) - bridged_rows,
        "segments": len(recording.segments),
        "gap_count": len(gaps),
        "gaps": [_describe_span(gap) for gap in gaps[:LISTED_GAPS]],
        "excluded": [{**_describe_span(span), "reason": span.reason} for span in recording.excluded],
        "bridged_rows": bridged_rows,
        "counter_wraps": sum(flag.count for flag in recording.flags if flag.code == "W-WRAP"),
        "sanity": measure_sanity(recording),
        "acc_range_g": recording.acc_range_g,
        "gyr_range_dps": recording.gyr_range_dps,
        "understood": dict(recording.understood),
        "warnings": [_describe_flag(flag) for flag in recording.flags],
    }


def _number(text: str | None) -> float | None:
    return float(text) if text else None


def _describe_span(span: Span) -> dict[str, object]:
    return {"start_s": span.start_us / MICROSECONDS, "length_s": span.duration_us / MICROSECONDS}


def _describe_flag(flag: QualityFlag) -> dict[str, object]:
    return {
        "code": flag.code,
        "count": flag.count,
        "seconds": flag.seconds,
        "first_s": flag.first_s,
        "last_s": flag.last_s,
        "facts": dict(flag.facts),
    }
