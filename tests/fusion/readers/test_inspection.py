"""What `inspect` tells can be written as JSON, and its seconds add up."""

import json

import pytest

from fusion.readers import read_recording
from fusion.readers.preview import inspect_recording
from tests.fusion.readers.gt3x.gt3x_builder import log_of, pack
from tests.fusion.readers.tables.table_builder import PREAMBLE, read_text, table


def test_a_gap_is_told_with_start_and_length() -> None:
    recording = read_recording(pack(log_of([*range(20), *range(80, 100)])))

    told = inspect_recording(recording)

    assert told["gaps"] == [{"start_s": 20.0, "length_s": 60.0}]
    assert (told["recorded_s"], told["present_s"], told["missing_s"]) == (100.0, 40.0, 60.0)
    assert told["start"] == "2026-03-02T08:00:00-05:00"


def test_everything_told_is_json() -> None:
    recording = read_text(PREAMBLE + table(range(0, 20_000_000, 2000)))

    told = json.loads(json.dumps(inspect_recording(recording)))

    assert told["rate_hz"] == pytest.approx(500.0)
    assert told["jitter_us"] == 0.0
    assert told["understood"]["acceleration_unit"] == "g"
