"""A shift in several files: one clock, what lies between is missing, nothing is counted twice."""

import io

import pytest

from acromion.fusion.errors import UnusableJoin
from acromion.fusion.readers import join_recordings, read_recording, read_recordings
from tests.fusion.readers.gt3x.gt3x_builder import INFO, T0, count_utc, pack, record, schema, second


def part(first: int, stop: int, info: str = INFO) -> io.BytesIO:
    """Seconds ``first`` to ``stop`` of a device's clock, in a file of their own."""
    log = record(24, T0 + first, schema()) + b"".join(second(T0 + k) for k in range(first, stop))
    return pack(log, info)


def test_the_order_of_the_files_does_not_matter() -> None:
    there, back = (
        read_recordings(files) for files in ([part(0, 20), part(50, 80)], [part(50, 80), part(0, 20)])
    )

    assert (there.start, there.sha256, there.duration_us) == (back.start, back.sha256, back.duration_us)


def test_the_same_file_given_three_times_is_said() -> None:
    joined = read_recordings([part(0, 20), part(20, 40), part(0, 20), part(0, 20)])

    (flag,) = joined.flags
    assert [(s.start_s, len(s)) for s in joined.segments] == [(0.0, 2000), (20.0, 2000)]
    assert joined.duration_us == 40_000_000
    assert (flag.code, flag.count) == ("W-DUP-FILE", 2)


def test_one_file_is_returned_as_it_is() -> None:
    alone = read_recording(part(0, 20))

    joined = join_recordings([alone])

    assert (joined.sha256, joined.segments) == (alone.sha256, alone.segments)


def test_caveats_keep_their_place_in_the_later_file() -> None:
    holed = pack(record(24, T0 + 50, schema()) + b"".join(second(T0 + k) for k in (50, 51, 55, 56)))

    joined = read_recordings([part(0, 20), holed])

    assert [(flag.first_s, flag.spans_s) for flag in joined.flags] == [
        (52.0, ((52.0, 55.0),)),
        (20.0, ((20.0, 50.0),)),
    ]


def test_three_files_with_a_gap_and_an_overlap_account_for_every_second() -> None:
    joined = read_recordings([part(50, 80), part(0, 20), part(79, 100)])

    assert [(s.start_s, len(s)) for s in joined.segments] == [(0.0, 2000), (50.0, 3000), (80.0, 2000)]
    assert [(flag.code, flag.seconds) for flag in joined.flags] == [("W-GAP", 30.0), ("W-DUP", 1.0)]
    assert joined.duration_us == 100_000_000


def utc_part(first_unix_s: int) -> io.BytesIO:
    """Twenty seconds of a file that counts UTC and names its zone."""
    return pack(count_utc(first_unix_s) + b"".join(second(first_unix_s + k) for k in range(20)))


@pytest.mark.parametrize(("change", "step_s"), [(1_793_512_800, -3600), (1_805_007_600, 3600)])
def test_a_change_of_the_clock_between_two_files_costs_no_time(change: int, step_s: int) -> None:
    """America/Toronto, 2026-11-01 06:00 UTC and 2027-03-14 07:00 UTC."""
    joined = read_recordings([utc_part(change - 30), utc_part(change + 10)])

    told = {flag.code: flag for flag in joined.flags}
    assert joined.duration_us == 60_000_000
    assert (told["W-GAP"].seconds, told["W-DST"].first_s) == (20.0, 40.0)
    assert told["W-DST"].facts == {"step_s": step_s}


@pytest.mark.parametrize(
    ("files", "why"),
    [
        ([], "no-files"),
        ([part(0, 20), part(0, 20, INFO.replace("00000001", "00000002"))], "devices"),
        ([part(0, 40), part(10, 50)], "overlap"),
        ([part(0, 40), part(10, 11)], "overlap"),
        ([part(0, 20), part(40 * 86_400, 40 * 86_400 + 20)], "span"),
        ([part(0, 20), part(30, 50, INFO.replace("TimeZone: -05:00:00\r\n", ""))], "clock"),
        ([part(-T0, 20 - T0)], "clock"),
    ],
    ids=["nothing", "two devices", "overlap", "inside", "a month", "zones", "never set"],
)
def test_what_is_not_one_shift_is_refused(files: list[io.BytesIO], why: str) -> None:
    with pytest.raises(UnusableJoin) as refusal:
        read_recordings(files)

    assert refusal.value.facts == {"why": why}
