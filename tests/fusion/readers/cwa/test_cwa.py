"""Axivity AX6 `.cwa`: what the bytes say is what is read."""

import struct
from collections.abc import Callable, Iterable, Mapping
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acromion.fusion.errors import UnknownColumns, UnknownRate, UnusableTime
from acromion.fusion.pipeline import analyse
from acromion.fusion.readers import read_recording
from acromion.fusion.readers.cwa import DeviceHeader, build_recording, decode_log
from acromion.fusion.recording import Recording
from tests.badfiles import cwa_files
from tests.badfiles.gt3x_files import LOG, pack
from tests.fusion.readers.cwa.cwa_builder import (
    ROWS,
    START,
    START_US,
    block,
    blocks,
    header,
    log_of,
    pack_time,
    seal,
    stamp_fields,
    still_rows,
)
from tests.fusion.readers.seen import codes, counts, read_file, spans_s


def by_hand() -> bytes:
    """One block, field by field: 2026-03-02 08:00:00.5, 8 g, 1000 deg/s, two rows.

    The date: 26 << 26 | 3 << 22 | 2 << 17 | 8 << 12 = 0x68C48000. Half a second: 0x8000 | 0x4000. The
    fraction is worth 50 rows of 100 Hz, so the offset -50 says that the stamp is that of row 0. The scales:
    4 << 13 (4096 counts for 1 g) | 3 << 10 (1000 deg/s) = 0x8C00.
    """
    head = bytes.fromhex(
        "4158 fc01 00c0 4d000000 00000000 0080c468 008c c800 00 c8 4a 62 ceff 0200".replace(" ", "")
    )
    rows = struct.pack("<12h", 1, -2, 16384, 4096, -4096, 2048, 3, -4, -32768, 0, 8192, -1)
    return seal((head + rows).ljust(512, b"\0"))


def test_a_block_worked_out_by_hand_is_read_as_it_was_meant() -> None:
    at_rest = still_rows(ROWS)
    at_rest[:, 5] *= 2  # 4096 counts are 1 g here
    rest = [block(1 + k, START_US + 520_000 + 400_000 * k, at_rest, scales=0x8C00) for k in range(6)]

    recording = read_file(header() + by_hand() + b"".join(rest))

    segment = recording.segments[0]
    count_dps = 1000 / 32768
    assert segment.acc_g[:2].tolist() == [[1.0, -1.0, 0.5], [0.0, 2.0, -1 / 4096]]
    assert segment.gyr_dps[:2] == pytest.approx(
        np.array([[1, -2, 16384], [3, -4, -32768]]) * count_dps, rel=1e-6
    )
    assert recording.start == datetime(2026, 3, 2, 8, 0, 0, 500_000)  # noqa: DTZ001 (the device knows no zone)
    assert recording.acc_range_g == 8.0
    assert recording.gyr_range_dps == 1000.0


def test_an_unbroken_recording_is_one_segment_at_the_true_rate() -> None:
    recording = read_file(log_of(range(50), period_us=9_920))

    assert spans_s(recording) == [(0.0, 2000)]
    assert recording.rate_hz == pytest.approx(1e6 / 9_920, rel=1e-5)
    assert recording.duration_us == pytest.approx(2000 * 9_920, abs=100)
    assert codes(recording) == ["W-DRIFT"]


def test_the_recording_says_what_it_was_taken_for() -> None:
    recording = read_file(log_of(range(50)))

    assert recording.device == "ax6"
    assert recording.start == START
    assert recording.time_zone is None
    assert recording.serial_hash == "5994471abb01"  # of the text 12345
    assert (recording.acc_range_g, recording.gyr_range_dps) == (16.0, 2000.0)
    assert recording.understood["layout"] == "Axivity AX6 .cwa"
    assert recording.understood["nominal_rate_hz"] == "100"
    assert "Anne" not in repr(recording)  # a name in the notes of the header


def test_a_stamp_of_whole_seconds_at_a_row_of_the_block_is_understood() -> None:
    """Older firmware: no fraction; the offset is the row at which the second began."""
    content = header()
    for number in range(50):
        # the first row at 0.4 s times the number; the whole second that came last or comes next
        tenths = 4 * number
        second = -(-tenths // 10)
        row = (10 * second - tenths) * 10
        content += block(number, 0, stamp=(pack_time(START) + second, 0, row))

    recording = read_file(content)

    assert spans_s(recording) == [(0.0, 2000)]
    assert recording.duration_us == 20_000_000
    assert recording.start == START


def test_a_block_that_is_not_full_holds_as_many_rows_as_it_says() -> None:
    last = block(10, START_US + 4_000_000, still_rows(7))

    recording = read_file(header() + b"".join(blocks(range(10))) + last)

    assert spans_s(recording) == [(0.0, 407)]
    assert codes(recording) == []


def test_a_magnetometer_beside_the_two_sensors_is_passed_over() -> None:
    content = header()
    for number in range(60):
        nine = np.concatenate([still_rows(26, number), np.full((26, 3), 999, np.int16)], axis=1)
        content += block(number, START_US + 260_000 * number, nine, axes=0x92)

    recording = read_file(content)

    assert spans_s(recording) == [(0.0, 1560)]
    assert float(np.abs(recording.segments[0].acc_g).max()) < 1.01


@pytest.mark.parametrize(
    ("code", "range_dps"),
    [(0, 2000.0), (1, 4000.0), (2, 2000.0), (3, 1000.0), (4, 500.0), (5, 250.0), (6, 125.0)],
)
def test_the_range_of_the_gyroscope_stands_in_every_block(code: int, range_dps: float) -> None:
    recording = read_file(log_of(range(50), scales=3 << 13 | code << 10))

    assert recording.gyr_range_dps == range_dps
    assert recording.segments[0].gyr_dps[0, 0] == pytest.approx(range_dps / 32768)


def test_a_plan_that_was_not_reached_is_said() -> None:
    stop = pack_time(datetime(2026, 3, 2, 16, 0, 0))  # noqa: DTZ001 (the device knows no zone)

    recording = read_file(header(stop=stop) + b"".join(blocks(range(50))))

    assert codes(recording) == ["W-EARLY-END"]


def test_a_rate_that_shows_no_arm_is_refused() -> None:
    content = header() + b"".join(
        block(k, START_US + 6_400_000 * k, still_rows(ROWS, k), rate=0x46) for k in range(50)
    )

    with pytest.raises(UnknownRate) as refusal:
        read_file(content)

    assert refusal.value.facts["m"] == pytest.approx(6.25, rel=1e-4)


@settings(max_examples=20)
@given(
    counts=st.lists(st.lists(st.integers(-32768, 32767), min_size=6, max_size=6), min_size=1, max_size=ROWS)
)
def test_what_is_written_is_read_to_the_count(counts: list[list[int]]) -> None:
    content = block(0, START_US, np.array(counts, np.int16))

    log = decode_log([content])

    acc = np.rint(log.columns.acc * 2048).astype(int).tolist()
    gyr = np.rint(log.columns.gyr * 32768 / 2000).astype(int).tolist()
    assert [[*turn, *pull] for turn, pull in zip(gyr, acc, strict=True)] == counts


def test_the_angle_of_the_arm_is_that_of_the_same_minute_in_a_gt3x() -> None:
    """The pose tells the arm's axis: no convention of the device's own axes is needed."""
    of_cwa, of_gt3x = (analyse(read_file(content)) for content in (cwa_files.whole(), pack(LOG)))

    elevations = [analysis.elevation.segments[0].elevation_deg for analysis in (of_cwa, of_gt3x)]
    n = min(map(len, elevations))
    assert np.median(np.abs(elevations[0][:n] - elevations[1][:n])) < 0.1
    assert {flag.code for flag in of_cwa.quality.flags} == {flag.code for flag in of_gt3x.quality.flags}


# The clock of a `.cwa`: stamps that jump, are missing, scatter or drift, and the durations that result.

BLOCK_US = 400_000
DAY_US = 86_400_000_000
NEVER = (0, 0, 0)
"""A stamp that is no date."""


def read_stamped(times_us: Mapping[int, int], n_blocks: int = 50) -> Recording:
    """Read blocks in a row, some of which bear another time than their own."""
    return read_blocks(block(k, times_us.get(k, START_US + BLOCK_US * k)) for k in range(n_blocks))


def read_blocks(parts: Iterable[bytes]) -> Recording:
    return read_file(header() + b"".join(parts))


@pytest.mark.parametrize(
    ("number", "time_us"),
    [(20, START_US + 365 * DAY_US), (0, START_US - 400 * DAY_US), (49, START_US - 400 * DAY_US)],
    ids=["a year ahead", "first", "last"],
)
def test_a_stamp_alone_far_from_all_others_is_not_believed(number: int, time_us: int) -> None:
    recording = read_stamped({number: time_us})

    assert spans_s(recording) == [(0.0, 2000)]
    assert recording.start is not None
    assert abs((recording.start - START).total_seconds()) < 0.001
    assert codes(recording) == ["W-CLOCK-FWD"]


@pytest.mark.parametrize("numbers", [[20], [0, 1], [48, 49], [10, 20, 30]])
def test_blocks_without_a_stamp_lie_where_their_numbers_say(numbers: list[int]) -> None:
    recording = read_blocks(
        block(k, START_US + BLOCK_US * k, stamp=NEVER if k in numbers else None) for k in range(50)
    )

    assert spans_s(recording) == [(0.0, 2000)]
    assert recording.start is not None
    assert abs((recording.start - START).total_seconds()) < 0.001
    assert codes(recording) == ["W-CLOCK-FWD"]


def test_without_any_stamp_the_rate_of_the_setting_is_used_and_said() -> None:
    recording = read_blocks(block(k, 0, stamp=NEVER) for k in [*range(25), *range(30, 55)])

    assert spans_s(recording) == [(0.0, 1000), (12.0, 1000)]
    assert recording.start is None
    assert codes(recording) == ["W-CLOCK-UNSET", "W-RATE", "W-GAP"]


@pytest.mark.parametrize(
    ("step_us", "code"), [(-3_600_000_000, "W-CLOCK-BACK"), (40 * DAY_US, "W-CLOCK-FWD")]
)
def test_a_clock_that_was_set_costs_no_time(step_us: int, code: str) -> None:
    recording = read_stamped({k: START_US + step_us + BLOCK_US * k for k in range(25, 50)})

    assert [len(segment) for segment in recording.segments] == [1000, 1000]
    assert recording.duration_us == pytest.approx(20_000_000, abs=100)
    assert codes(recording) == [code]


def test_a_device_that_was_off_for_days_has_a_gap_of_that_length() -> None:
    recording = read_stamped({k: START_US + 3 * DAY_US + BLOCK_US * k for k in range(25, 50)})

    assert recording.duration_us == pytest.approx(3 * DAY_US + 20_000_000, abs=100)
    assert codes(recording) == ["W-GAP", "W-MULTIDAY"]


def test_stamps_that_scatter_by_some_milliseconds_make_no_holes() -> None:
    scatter_us = np.random.default_rng(3).normal(0.0, 2000.0, 500)

    recording = read_blocks(block(k, START_US + BLOCK_US * k + round(scatter_us[k])) for k in range(500))

    assert [len(segment) for segment in recording.segments] == [20_000]
    assert recording.rate_hz == pytest.approx(100.0, rel=1e-4)
    assert float(recording.understood["jitter_us"]) == pytest.approx(2000.0, rel=0.15)


def test_a_sample_that_was_lost_between_two_blocks_is_bridged_and_missing() -> None:
    recording = read_stamped({k: START_US + 10_000 + BLOCK_US * k for k in range(25, 50)})

    (segment,) = recording.segments
    assert (len(segment), segment.bridged) == (2001, ((1000, 1001),))
    assert recording.flags[0].seconds == pytest.approx(0.010, abs=1e-4)


def test_a_block_whose_number_is_missing_is_a_hole_however_the_stamps_scatter() -> None:
    """At 1600 Hz a block is 25 ms, and eight times a scatter of 4 ms are more than that."""
    scatter_us = np.random.default_rng(4).normal(0.0, 4000.0, 2000)
    numbers = [*range(1000), *range(1001, 2000)]

    recording = read_blocks(
        block(k, START_US + 25_000 * k + round(scatter_us[k]), rate=0x4E) for k in numbers
    )

    (gap,) = (flag for flag in recording.flags if flag.code == "W-GAP")
    assert gap.count == 1
    assert gap.seconds == pytest.approx(0.025, abs=0.02)


def test_a_clock_that_wanders_with_the_temperature_gives_the_true_duration() -> None:
    """The rate falls by 0.4 % over the recording: every block's stamp is true, none is a hole."""
    periods_us = 10_000 * (1 + 0.004 * np.linspace(0, 1, 2000))
    starts_us = START_US + np.concatenate([[0], np.cumsum(40 * periods_us)])

    recording = read_blocks(block(k, round(starts_us[k])) for k in range(2000))

    assert [len(segment) for segment in recording.segments] == [80_000]
    assert recording.duration_us == pytest.approx(starts_us[-1] - START_US, abs=20_000)


@pytest.mark.parametrize(
    "times_us",
    [
        np.random.default_rng(5).uniform(0, 3e9, 2000).round().astype(int).tolist(),
        [BLOCK_US * k + 50_000 * (k // 3) for k in range(1000)],
    ],
    ids=["at random", "a hole before every third block"],
)
def test_stamps_of_no_even_sampling_are_refused(times_us: list[int]) -> None:
    with pytest.raises(UnusableTime):
        read_blocks(block(k, START_US + us) for k, us in enumerate(times_us))


def test_a_date_that_is_none_is_no_stamp() -> None:
    packed, fraction, offset = stamp_fields(START_US + 8_000_000, 100.0)
    thirtieth_of_february = ((packed & ~(0x3FF << 17)) | 2 << 22 | 30 << 17, fraction, offset)

    recording = read_blocks(
        block(k, START_US + BLOCK_US * k, stamp=thirtieth_of_february if k == 20 else None) for k in range(50)
    )

    assert spans_s(recording) == [(0.0, 2000)]


@pytest.mark.parametrize("moved", [-1, 1])
def test_the_row_of_a_stamp_may_move_by_one_while_the_stamps_go_on_evenly(moved: int) -> None:
    """As in a real AX6: from the fourth block on the row is 41 in place of 40, and nothing is missing."""
    parts = []
    for number in range(50):
        packed, fraction, row = stamp_fields(START_US + BLOCK_US * number, 100.0)
        parts.append(block(number, 0, stamp=(packed, fraction, row if number < 3 else row + moved)))

    recording = read_blocks(parts)

    assert (spans_s(recording), codes(recording)) == ([(0.0, 2000)], [])


@pytest.mark.real_recordings
def test_a_real_ax6_is_one_unbroken_run(shared_data: Callable[[str], Path]) -> None:
    recording = read_recording(shared_data("other_layouts") / "ax6_sample.cwa")

    assert [len(segment) for segment in recording.segments] == [10_360]
    assert recording.rate_hz == pytest.approx(98.394, abs=0.001)
    assert codes(recording) == ["W-DRIFT"]


# Damaged `.cwa` files: only what is damaged is lost, and every second is accounted for.

WEEK_US = 7 * 86_400_000_000
PARTS = tuple(blocks(range(50)))
WHOLE = header() + b"".join(PARTS)
INSIDE = 1024 + 20 * 512 + 100
"""A byte among the samples of block 20."""
UNBROKEN = [(0.0, 2000)]
WITHOUT_20 = [(0.0, 800), (8.4, 1160)]


def spoil(*numbers: int) -> bytes:
    """Return a file in which these blocks have one wrong bit among their samples."""
    content = bytearray(WHOLE)
    for number in numbers:
        content[1024 + number * 512 + 100] ^= 1
    return bytes(content)


def put(number: int, *instead: bytes) -> bytes:
    """Return a file with other bytes in the place of a block."""
    return header() + b"".join([*PARTS[:number], *instead, *PARTS[number + 1 :]])


@pytest.mark.parametrize(
    ("content", "spans", "caveats"),
    [
        (put(20, b"\x00" * 512), WITHOUT_20, ["W-GAP"]),
        (WHOLE + b"\xff" * 50_000, UNBROKEN, []),
        (WHOLE[:INSIDE] + WHOLE[INSIDE + 33 :], WITHOUT_20, ["W-RESYNC", "W-GAP"]),
        (put(20, block(20, START_US + 8_000_000, count=41)), WITHOUT_20, ["W-ROWS-DROPPED", "W-GAP"]),
        (put(20, block(20, START_US + 8_000_000, axes=0x63)), WITHOUT_20, ["W-ROWS-DROPPED", "W-GAP"]),
        (put(20, block(20, START_US + 8_000_000, axes=0x52)), WITHOUT_20, ["W-ROWS-DROPPED", "W-GAP"]),
    ],
    ids=[
        *("wiped to zeros", "unwritten room at the end", "bytes lost"),
        *("too many rows", "unknown axes", "unknown packing"),
    ],
)
def test_damage_costs_its_own_block_and_no_other(
    content: bytes, spans: list[tuple[float, int]], caveats: list[str]
) -> None:
    recording = read_file(content)

    assert (spans_s(recording), codes(recording)) == (spans, caveats)


def test_two_blocks_in_a_row_that_fail_are_both_missing_and_their_place_is_told() -> None:
    recording = read_file(spoil(20, 21))

    flag = recording.flags[0]
    assert spans_s(recording) == [(0.0, 800), (8.8, 1120)]
    assert (flag.code, flag.count) == ("W-CHECKSUM", 2)
    assert [flag.first_s, flag.last_s] == pytest.approx([7.6, 7.6], abs=1e-4)


def test_of_two_blocks_with_one_number_and_stamp_the_first_is_kept() -> None:
    recording = read_file(put(19, PARTS[19], block(19, START_US + 7_600_000, still_rows(40, 700))))

    assert spans_s(recording) == UNBROKEN
    assert codes(recording) == ["W-DUP-CONFLICT"]
    assert recording.segments[0].gyr_dps[19 * 40, 0] == pytest.approx(20 * 2000 / 32768)


def test_doubles_of_other_lengths_contradict_the_block_before() -> None:
    shorter = [block(k, START_US + BLOCK_US * k, still_rows(30, k)) for k in (10, 20)]

    recording = read_file(
        header() + b"".join([*PARTS[:11], shorter[0], *PARTS[11:21], shorter[1], *PARTS[21:]])
    )

    assert spans_s(recording) == UNBROKEN
    assert counts(recording) == [("W-DUP-CONFLICT", 2)]


@pytest.mark.parametrize(("number", "time_us"), [(29, START_US + 30 * BLOCK_US), (20, START_US + 4_000_000)])
def test_a_number_that_its_stamp_contradicts_makes_no_double_and_moves_no_block(
    number: int, time_us: int
) -> None:
    recording = read_file(put(30, block(number, time_us, still_rows(40, 900))))

    assert sum(rows for _, rows in spans_s(recording)) == 2000
    assert not {"W-DUP-CONFLICT", "W-ORDER"} & set(codes(recording))


def test_sound_blocks_of_no_known_layout_alone_are_refused() -> None:
    with pytest.raises(UnknownColumns):
        read_file(header() + b"".join(block(k, START_US + BLOCK_US * k, axes=0x52) for k in range(50)))


@pytest.mark.parametrize("number", [1, 2])
def test_very_few_blocks_are_read(number: int) -> None:
    recording = build_recording(DeviceHeader(), decode_log(blocks(range(number))))

    assert spans_s(recording) == [(0.0, 40 * number)]


def test_a_block_that_came_late_is_put_into_its_place() -> None:
    recording = read_file(log_of([*range(20), 21, 22, 20, *range(23, 50)]))

    numbers = recording.segments[0].gyr_dps[::40, 0] * 32768 / 2000
    assert numbers.round().tolist() == list(range(1, 51))
    assert codes(recording) == ["W-ORDER"]


@pytest.mark.parametrize(
    ("session", "spans"), [(76, [(0.0, 400)]), (5, UNBROKEN)], ids=["the shorter one", "neither: the longer"]
)
def test_the_session_that_the_header_names_is_kept(session: int, spans: list[tuple[float, int]]) -> None:
    old = (block(50 + k, START_US - WEEK_US + BLOCK_US * k, session=76) for k in range(10))

    recording = read_file(header(session=session) + b"".join([*PARTS, *old]))

    assert spans_s(recording) == spans


@settings(max_examples=30, deadline=None)
@given(lost=st.sets(st.integers(1, 98), max_size=20))
def test_whatever_blocks_are_lost_every_other_sample_is_where_it_was(lost: set[int]) -> None:
    left = [k for k in range(100) if k not in lost]

    recording = read_file(log_of(left))

    at_s = [one.start_s + row / one.rate_hz for one in recording.segments for row in range(0, len(one), 40)]
    assert at_s == pytest.approx([0.4 * k for k in left], abs=1e-3)
    assert recording.duration_us == pytest.approx(40_000_000, abs=1000)
