"""Damaged tables and files of other kinds: one row is lost, or the file is refused with the place.

`tests/badfiles` (rows 59 to 82) has more of them.
"""

import pytest

from fusion.errors import (
    AmbiguousDecimal,
    EpochFile,
    FusionError,
    NoGyroscope,
    UnknownFormat,
    UnknownRate,
    UnreadableRows,
    UnusableTime,
)
from tests.fusion.readers.seen import codes
from tests.fusion.readers.tables.table_builder import CANON, line, read_text


def with_line(number: int, text: str) -> str:
    lines = CANON.split("\n")
    lines[number] = text
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("10000000,0,0,1", "W-ROWS-DROPPED"),
        ("10000000,0,0,1,0,0,0,7,8", "W-ROWS-DROPPED"),
        ("10000000,0,0,1,0,0,0.110010000,0,0,1,0,0,0.1", "W-ROWS-DROPPED"),
        ('10000000,"0,0,1,0,0,0', None),
        ("10000000,0,0,x,0,0,0", "W-ROWS-DROPPED"),
        ("\0" * 40, "W-ROWS-DROPPED"),
        ("10000000,0,0,1e99,0,0,0", "W-ROWS-DROPPED"),
        ("10000000,0,0,NaN,0,0,0", "W-NAN"),
        ("10000000,0,0,-inf,0,0,0", "W-NAN"),
        ("10000000,0,0,,0,0,0", "W-NAN"),
        ("10000000,0,0,-,0,0,0", "W-NAN"),
    ],
)
def test_one_spoilt_line_costs_its_own_row_only(text: str, code: str | None) -> None:
    recording = read_text(with_line(1001, text))

    (segment,) = recording.segments
    assert segment.bridged == (((1000, 1001),) if code else ())
    assert segment.gyr_dps[1001:, 2].tolist() == read_text(CANON).segments[0].gyr_dps[1001:, 2].tolist()
    assert codes(recording) == ([code, "W-GAP"] if code else [])


def test_more_than_one_line_in_twenty_unreadable_is_refused_with_the_place() -> None:
    lines = CANON.split("\n")
    lines[500:700] = ["rubbish"] * 200

    with pytest.raises(UnreadableRows) as refusal:
        read_text("\n".join(lines))

    assert refusal.value.facts == {"k": 200, "line": 501}


@pytest.mark.parametrize(
    ("content", "error"),
    [
        ("time_s,ax,ay,az\n" + "".join(f"{k / 100},0,0,1\n" for k in range(50)), NoGyroscope),
        ("Date,Axis1,Axis2,Axis3,Steps,Vector Magnitude\n" + "1/2/2026,3,4,5,6,7\n" * 50, EpochFile),
        (
            "time_us,acc_x,acc_y,acc_z,gyr_x,gyr_y,gyr_z\n"
            + "".join(f"{k * 10_000},0,5,1,0,3,0,5,0,5,0,5\n" for k in range(50)),
            AmbiguousDecimal,
        ),
        ("t_ms,ax,ay,az,b,c\n" + "10,0,0,1,5,6\n" * 50, NoGyroscope),
        ("ax,ay,az,gx,gy,gz\n" + "0,0,1,0,0,0\n" * 50, UnknownRate),
        ("time_s,ax,ay,az,gx,gy,gz\n" + "".join(f"{10 * k},0,0,1,0,0,0\n" for k in range(50)), UnknownRate),
        ("time_s,ax,ay,az,gx,gy,gz\n" + "7,0,0,1,0,0,0\n" * 50, UnusableTime),
        ("nothing to see here\n" * 20, UnknownFormat),
    ],
)
def test_what_is_no_recording_is_refused_by_kind(content: str, error: type[FusionError]) -> None:
    with pytest.raises(error):
        read_text(content)


def test_a_layout_without_time_is_read_at_the_rate_that_is_told() -> None:
    text = "ax,ay,az,gx,gy,gz\n" + "".join(line(k) + "\n" for k in range(1200))

    recording = read_text(text, rate_hz=50.0)

    assert recording.duration_us == 24_000_000
    assert codes(recording)[:1] == ["W-RATE"]
