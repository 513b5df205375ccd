"""Read a small file from memory, and what tests look at in the recording."""

import io

from acromion.fusion.readers import read_recording
from acromion.fusion.recording import Recording


def read_file(content: bytes, name: str = "") -> Recording:
    return read_recording(io.BytesIO(content), file_name=name)


def codes(recording: Recording) -> list[str]:
    return [flag.code for flag in recording.flags]


def counts(recording: Recording) -> list[tuple[str, int]]:
    """Return code and count of each caveat."""
    return [(flag.code, flag.count) for flag in recording.flags]


def spans_s(recording: Recording) -> list[tuple[float, int]]:
    """Return start and rows of each segment."""
    return [(round(segment.start_s, 3), len(segment)) for segment in recording.segments]
