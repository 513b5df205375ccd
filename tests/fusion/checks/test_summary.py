"""Summaries of the samples: made once for each segment while the checks run, and freed after them."""

from pathlib import Path

from fusion.checks import summary
from fusion.readers import read_recording


def test_a_segment_is_summarised_once(shift_gt3x: Path) -> None:
    segment = read_recording(shift_gt3x).segments[0]

    assert summary.summarise(segment) is summary.summarise(segment)


def test_a_recording_that_was_read_holds_no_summary(shift_gt3x: Path) -> None:
    recording = read_recording(shift_gt3x)

    assert [segment for segment in recording.segments if segment in summary._SUMMARIES] == []
