"""What the first bytes of a file tell."""

import json
import struct
from contextlib import suppress

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acromion.fusion.errors import FusionError, NoGyroscope
from acromion.fusion.readers import read_recording
from acromion.fusion.readers.preview import inspect_recording, preview_head
from tests.fusion.readers.cwa.cwa_builder import START as CWA_START
from tests.fusion.readers.cwa.cwa_builder import blocks as cwa_blocks
from tests.fusion.readers.cwa.cwa_builder import header as cwa_header
from tests.fusion.readers.cwa.cwa_builder import log_of as cwa_log_of
from tests.fusion.readers.gt3x.gt3x_builder import INFO, log_of, pack
from tests.fusion.readers.tables.table_builder import PREAMBLE, read_text, table

HEAD = pack(log_of(range(20)), INFO).getvalue()[:22_000]


def test_a_start_date_beyond_the_calendar_is_not_told() -> None:
    info = INFO + "Start Date: 9999999999999999999\r\n"

    facts = preview_head(pack(b"", info).getvalue(), "shift.gt3x")

    assert (facts.device, facts.start) == ("gt9x", None)


def test_a_member_that_claims_to_be_large_is_not_believed() -> None:
    huge = struct.pack("<4s5H3I2H", b"PK\x03\x04", 20, 0, 0, 0, 0, 0, 2**32 - 2, 2**32 - 2, 8, 0)

    facts = preview_head(huge + b"info.txtTimeZone: 02:00:00\r\n", "shift.gt3x")

    assert (facts.time_zone, facts.start) == ("UTC+02:00", None)


@settings(max_examples=60, deadline=None)
@given(st.binary(max_size=300), st.integers(0, len(HEAD)))
def test_a_hostile_head_is_previewed_or_refused(noise: bytes, at: int) -> None:
    with suppress(FusionError):
        preview_head(HEAD[:at] + noise + HEAD[at:], "shift")


def test_the_first_bytes_of_a_cwa_say_what_it_is() -> None:
    facts = preview_head(cwa_log_of(range(20))[:-100], "shift.cwa")

    assert (facts.device, facts.start) == ("ax6", CWA_START)
    assert facts.rate_hz == pytest.approx(100.0, abs=0.01)
    assert facts.serial_hash == "5994471abb01"


def test_a_cwa_without_a_gyroscope_is_refused_at_its_first_bytes() -> None:
    head = cwa_header() + b"".join(cwa_blocks(range(20), axes=0x32))

    with pytest.raises(NoGyroscope):
        preview_head(head, "shift.cwa")


def test_the_header_of_a_cwa_alone_names_the_device() -> None:
    assert preview_head(cwa_header(), "shift.cwa").device == "ax6"


# What `inspect` tells can be written as JSON, and its seconds add up.


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
