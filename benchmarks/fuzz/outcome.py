"""Allowed outcomes of a damaged file: a FusionError, or a recording that accounts for every second."""

import io
import warnings
from collections.abc import Sequence
from random import Random

import numpy as np

from acromion.fusion.errors import FusionError
from acromion.fusion.readers import read_recording
from acromion.fusion.recording import MICROSECONDS, Recording
from benchmarks.fuzz.mutations import mutate, mutate_blocks, mutate_records
from benchmarks.fuzz.seeds import SEEDS, wrap

SAMPLES_PER_BYTE = 64
SPARE_BYTES = 1 << 20
PACKED = ("CSV, gzip", "CSV in zip", "Parquet")
PACKED_RATIO = 20
MENDING = {"gt3x log, checksums mended": mutate_records, "cwa, checksums mended": mutate_blocks}
"""Mutations that correct checksums, so that the damage is reached."""


def damage(name: str, random: Random) -> bytes:
    """Return a damaged file of a format."""
    return wrap(name, MENDING.get(name, mutate)(SEEDS[name], random))


def read_damaged(name: str, random: Random) -> str:
    """Damage a file, read it, check the outcome; return "read" or the code of the error."""
    return read_checked(name, damage(name, random), rate_hz=random.choice((None, 100.0)))


def read_checked(name: str, content: bytes, rate_hz: float | None = None) -> str:
    """Read a file, check the outcome; return "read" or the code of the error."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            recording = read_recording(io.BytesIO(content), rate_hz=rate_hz)
    except FusionError as error:
        return error.code
    check_recording(recording, len(content) * (PACKED_RATIO if name.startswith(PACKED) else 1))
    return "read"


def check_recording(recording: Recording, size_bytes: int) -> None:
    """Raise AssertionError if a second is lost or counted twice, or if too much memory is used."""
    reached_us = 0
    for segment in recording.segments:
        assert len(segment) > 0, "an empty segment"
        assert segment.acc_g.shape == segment.gyr_dps.shape == (len(segment), 3), "shapes"
        assert segment.acc_g.dtype == segment.gyr_dps.dtype == np.float32, "types"
        assert bool(np.isfinite(segment.acc_g).all() and np.isfinite(segment.gyr_dps).all()), "not finite"
        assert segment.start_us >= reached_us, "segments overlap"
        assert 1.0 < segment.rate_hz < 10_000.0, "rate"
        reached_us = segment.end_us
    assert recording.duration_us >= reached_us, "segments outlast the recording"
    for span in recording.excluded:
        assert 0 <= span.start_us <= span.end_us <= recording.duration_us + 1, "exclusion outside"
    check_missing(recording)
    held_bytes = sum(segment.acc_g.nbytes + segment.gyr_dps.nbytes for segment in recording.segments)
    assert held_bytes <= SAMPLES_PER_BYTE * size_bytes + SPARE_BYTES, "too much memory"


def check_missing(recording: Recording) -> None:
    """Check that the missing time in the caveats is the time without samples and exclusions."""
    spans = [(s.start_us, s.end_us) for s in recording.segments]
    explained_us = measure_union(spans + [(s.start_us, s.end_us) for s in recording.excluded])
    bridged_us = sum(
        (stop - first) * MICROSECONDS / segment.rate_hz
        for segment in recording.segments
        for first, stop in segment.bridged
    )
    told_us = sum(flag.seconds for flag in recording.flags if flag.code == "W-GAP") * MICROSECONDS
    missing_us = recording.duration_us - explained_us + bridged_us
    n_parts = len(recording.segments) + len(recording.excluded)
    n_parts += sum(len(segment.bridged) for segment in recording.segments)
    assert abs(missing_us - told_us) <= 2 * n_parts + 2, f"missing {missing_us} us, told {told_us} us"


def measure_union(spans: Sequence[tuple[int, int]]) -> int:
    total_us = reached_us = 0
    for start_us, end_us in sorted(spans):
        total_us += max(0, end_us - max(start_us, reached_us))
        reached_us = max(reached_us, end_us)
    return total_us
