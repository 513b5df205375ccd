"""What the first bytes of a file tell, and what its last ones add: when the recording ends."""

import random
import struct
from collections.abc import Callable
from datetime import datetime, timedelta, timezone
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion.errors import NoGyroscope
from fusion.readers.gt3x.read import TICKS_AT_UNIX_EPOCH, TICKS_PER_SECOND
from fusion.readers.preview import preview_head
from fusion.simulation import write_recordings
from tests.fusion.cwa_builder import START as CWA_START
from tests.fusion.cwa_builder import blocks as cwa_blocks
from tests.fusion.cwa_builder import header as cwa_header
from tests.fusion.cwa_builder import log_of as cwa_log_of
from tests.fusion.gt3x_builder import INFO, T0, log_of, pack, record
from tests.fusion.table_builder import HEADER, PREAMBLE, table

HOUR_S = 3600
NEW_YORK = timezone(timedelta(hours=-5))
GARBAGE = random.Random(1).randbytes(65_536)


def info_of(last_unix_s: int) -> str:
    return f"{INFO}Last Sample Time: {TICKS_AT_UNIX_EPOCH + last_unix_s * TICKS_PER_SECOND}\r\n"


def halves(last_unix_s: int) -> tuple[bytes, bytes]:
    """The first 10 s of a `.gt3x`, and its last 4 KiB, in which info.txt stands behind samples."""
    content = pack(log_of(range(20)), info_of(last_unix_s)).getvalue()
    return content[:22_000], content[-4096:]


def count_for(first_us: int) -> bytes:
    """20 s of rows whose stamps go on from ``first_us``; a count that begins at 0 says its start above."""
    text = table(range(first_us, first_us + 20_000_000, 10_000))
    return (text.partition("\n")[2] if first_us else PREAMBLE + text).encode()


def test_a_gt3x_ends_at_the_last_sample_time_of_its_tail() -> None:
    head, tail = halves(T0 + 8 * HOUR_S)

    facts = preview_head(head, "shift.gt3x", tail=tail)

    assert facts.start == datetime(2026, 3, 2, 8, 0, tzinfo=NEW_YORK)
    assert facts.end == datetime(2026, 3, 2, 16, 0, tzinfo=NEW_YORK)


def test_without_a_tail_a_gt3x_has_no_end_yet() -> None:
    facts = preview_head(halves(T0 + 8 * HOUR_S)[0], "shift.gt3x")

    assert (facts.device, facts.end) == ("gt9x", None)


@pytest.mark.parametrize(
    "last_unix_s", [T0 + 2, T0 - HOUR_S, T0 + 400 * 24 * HOUR_S, 300_000_000_000], ids=str
)
def test_a_last_sample_time_that_cannot_be_is_not_told(last_unix_s: int) -> None:
    head, tail = halves(last_unix_s)

    assert preview_head(head, "shift.gt3x", tail=tail).end is None


def test_where_the_log_counts_utc_the_clock_of_the_last_sample_time_is_not_known() -> None:
    log = log_of(range(10)) + record(6, T0, b'{"UsedUtc":true}') + log_of(range(10, 20))
    content = pack(log, info_of(T0 + 8 * HOUR_S)).getvalue()

    facts = preview_head(content[:30_000], "shift.gt3x", tail=content[-4096:])

    assert facts.start == datetime(2026, 3, 2, 3, 0, tzinfo=NEW_YORK)
    assert facts.end is None


def test_a_start_date_beyond_the_calendar_is_not_told() -> None:
    info = INFO + "Start Date: 9999999999999999999\r\n"

    facts = preview_head(pack(b"", info).getvalue(), "shift.gt3x")

    assert (facts.device, facts.start) == ("gt9x", None)


def test_of_a_gt3x_that_is_all_there_the_end_is_in_the_head() -> None:
    whole = pack(log_of(range(20)), info_of(T0 + 20)).getvalue()

    assert preview_head(whole, "shift.gt3x", tail=b"").end == datetime(2026, 3, 2, 8, 0, 20, tzinfo=NEW_YORK)


def test_an_actilife_table_ends_with_its_last_line(tmp_path: Path) -> None:
    content = write_recordings(tmp_path, "gt9x", 0.1, 5)[1].read_bytes()

    facts = preview_head(content[:200_000], "shift-IMU.csv", tail=content[-65_536:])

    assert facts.start is not None
    assert facts.end is not None
    assert (facts.start.isoformat(), facts.end.isoformat()) == ("2026-03-02T07:00:00", "2026-03-02T07:06:00")


def test_an_lsm9ds1_table_with_stamps_of_the_calendar_ends_with_its_last_line() -> None:
    since_1970_us = T0 * 1_000_000
    head = HEADER.encode() + b"\n" + count_for(since_1970_us)
    last = count_for(since_1970_us + 8 * HOUR_S * 1_000_000)

    facts = preview_head(head, "shift.csv", tail=last[33:])

    assert facts.end is not None
    assert facts.end.isoformat() == "2026-03-02T16:00:20+00:00"


def test_an_lsm9ds1_table_that_counts_past_32_bits_ends_with_its_last_line() -> None:
    facts = preview_head(count_for(0), "shift.csv", tail=count_for(8 * HOUR_S * 1_000_000))

    assert facts.start == datetime(2026, 3, 3, 7, 58, tzinfo=NEW_YORK)
    assert facts.end == datetime(2026, 3, 3, 15, 58, 20, tzinfo=NEW_YORK)


def test_a_count_that_may_have_begun_anew_tells_no_end() -> None:
    assert preview_head(count_for(0), "shift.csv", tail=count_for(HOUR_S * 1_000_000)).end is None


def test_a_last_line_that_is_broken_off_is_not_read() -> None:
    tail = count_for(8 * HOUR_S * 1_000_000) + b"99999999999,0.0"

    end = preview_head(count_for(0), "shift.csv", tail=tail).end

    assert end == datetime(2026, 3, 3, 15, 58, 20, tzinfo=NEW_YORK)


@pytest.mark.parametrize(
    "tail",
    [GARBAGE, b"\n" * 65_536, b"PK\x03\x04" * 16_384, b"{" * 65_536],
    ids=["noise", "empty lines", "zip signatures", "no line"],
)
@pytest.mark.parametrize("head", [halves(T0 + 60)[0], count_for(0)], ids=["gt3x", "table"])
def test_a_tail_of_nothing_changes_nothing(head: bytes, tail: bytes) -> None:
    assert preview_head(head, "shift", tail=tail) == preview_head(head, "shift")


def test_a_member_that_claims_to_be_large_is_not_believed() -> None:
    huge = struct.pack("<4s5H3I2H", b"PK\x03\x04", 20, 0, 0, 0, 0, 0, 2**32 - 2, 2**32 - 2, 8, 0)
    head = halves(T0 + 60)[0]

    facts = preview_head(head, "shift.gt3x", tail=huge + b"info.txtTimeZone: 02:00:00\r\n")

    assert (facts.time_zone, facts.end) == ("UTC+02:00", None)


@settings(max_examples=60, deadline=None)
@given(st.binary(max_size=300), st.integers(0, 4096), st.booleans())
def test_no_tail_makes_the_head_fail(noise: bytes, at: int, is_table: bool) -> None:
    head, tail = halves(T0 + 60)
    hostile = tail[:at] + noise + tail[at:]

    facts = preview_head(count_for(0) if is_table else head, "shift", tail=hostile)

    assert facts.device == ("lsm9ds1" if is_table else "gt9x")


@pytest.mark.real_recordings
def test_the_real_gt9x_says_its_end_from_its_tail(shared_data: Callable[[str], Path]) -> None:
    content = shared_data("gt9x/link_imu_100hz_179s.gt3x").read_bytes()

    facts = preview_head(content[:100_000], "link.gt3x", tail=content[-65_536:])

    assert facts.end == datetime(2019, 2, 14, 9, 1, tzinfo=NEW_YORK)


def cwa_ends(seconds: int = 28_800) -> tuple[bytes, bytes]:
    """The first 8 s of a `.cwa`, cut within a block, and its last 4 KiB, which begin within one."""
    first, last = range(20), range(seconds * 5 // 2 - 20, seconds * 5 // 2)
    return cwa_log_of(first)[:-100], b"".join(cwa_blocks(last))[-4096:]


def test_the_first_bytes_of_a_cwa_say_what_it_is() -> None:
    facts = preview_head(cwa_ends()[0], "shift.cwa")

    assert (facts.device, facts.start, facts.end) == ("ax6", CWA_START, None)
    assert facts.rate_hz == pytest.approx(100.0, abs=0.01)
    assert facts.serial_hash == "5994471abb01"


def test_a_cwa_ends_at_the_last_block_of_its_tail() -> None:
    head, tail = cwa_ends()

    end = preview_head(head, "shift.cwa", tail=tail).end

    assert end is not None
    assert abs(end - CWA_START - timedelta(hours=8)) < timedelta(milliseconds=50)


def test_a_cwa_that_is_all_in_the_head_ends_with_it() -> None:
    end = preview_head(cwa_log_of(range(50)), "shift.cwa", tail=b"").end

    assert end is not None
    assert abs(end - CWA_START - timedelta(seconds=20)) < timedelta(milliseconds=1)


@pytest.mark.parametrize("tail", [GARBAGE, b"\xff" * 4096])
def test_a_tail_of_no_blocks_tells_no_end_of_a_cwa(tail: bytes) -> None:
    assert preview_head(cwa_ends()[0], "shift.cwa", tail=tail).end is None


def test_a_cwa_without_a_gyroscope_is_refused_at_its_first_bytes() -> None:
    head = cwa_header() + b"".join(cwa_blocks(range(20), axes=0x32))

    with pytest.raises(NoGyroscope):
        preview_head(head, "shift.cwa")


def test_the_header_of_a_cwa_alone_names_the_device() -> None:
    assert preview_head(cwa_header(), "shift.cwa").device == "ax6"
