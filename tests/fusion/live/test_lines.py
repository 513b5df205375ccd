"""Lines of a board: header, torn lines, a board that starts anew."""

import numpy as np
import pytest

from acromion.fusion.errors import NoGyroscope, UnknownColumns, UnknownUnit, UnusableTime
from acromion.fusion.live import Frames
from acromion.fusion.live.lines import LineReader, StreamClock

PREAMBLE = "# device: LSM9DS1\n# acc_range_g: 16\n# gyr_range_dps: 2000\n"
HEADER = "time_us,counter,acc_x_g,acc_y_g,acc_z_g,gyr_x_dps,gyr_y_dps,gyr_z_dps\n"
NANO = "aX,aY,aZ,gX,gY,gZ\n"


def write_rows(first: int, stop: int, *, stamp: int = 0, count: int = 0) -> str:
    """Rows of 100 Hz; x holds a thousandth of the number of the row, so that each is known again."""
    return "".join(
        f"{(stamp + 10_000 * k) % (1 << 32)},{(count + k) % (1 << 16)},{k / 1000:.3f},0.0,1.0,0.5,0.0,0.0\n"
        for k in range(first, stop)
    )


def feed(reader: LineReader, text: str, piece_bytes: int = 64) -> list[Frames]:
    content = text.encode()
    pieces = [content[k : k + piece_bytes] for k in range(0, len(content), piece_bytes)]
    found = [reader.feed(piece, 1000 * number) for number, piece in enumerate(pieces)]
    return [frames for frames in found if frames is not None]


def read(text: str) -> tuple[LineReader, Frames]:
    reader = LineReader()
    found = feed(reader, text)
    return reader, Frames(
        np.concatenate([frames.time_us for frames in found]),
        np.concatenate([frames.counter for frames in found]),
        np.concatenate([frames.acc_g for frames in found]),
        np.concatenate([frames.gyr_dps for frames in found]),
    )


def test_the_header_tells_device_ranges_and_rate_and_no_row_is_lost_from_the_first_on() -> None:
    reader, frames = read(PREAMBLE + HEADER + write_rows(0, 300))

    facts = reader.facts
    assert facts is not None
    assert (facts.device, facts.rate_hz) == ("lsm9ds1", 100.0)
    assert (facts.acc_range_g, facts.gyr_range_dps) == (16.0, 2000.0)
    assert frames.counter.tolist() == list(range(300))
    assert frames.time_us.tolist() == [10_000 * k for k in range(300)]
    assert frames.acc_g[:, 0] == pytest.approx(np.arange(300) / 1000)
    assert reader.torn == 0
    assert reader.finish() is None  # nothing is given twice


def test_rows_too_few_to_tell_the_rate_at_once_are_given_at_the_end() -> None:
    reader = LineReader()
    assert feed(reader, HEADER + write_rows(0, 60)) == []

    frames = reader.finish()

    assert frames is not None
    assert frames.counter.tolist() == list(range(60))


ROW = write_rows(250, 251)
REST = ",0.25,0.0,1.0,0.5,0.0,0.0\n"


@pytest.mark.parametrize(
    ("line", "next_row"),
    [
        (ROW[:17] + "\n", 251),
        (ROW.rstrip("\n") + write_rows(251, 252), 252),
        (ROW.replace("0.250", "nan"), 251),
        (ROW.replace("0.250", "1e9"), 251),
        (ROW.replace("0.250", "x"), 251),
        (ROW.replace("0.250", ""), 251),
        ("inf,250" + REST, 251),
        ("1e300,250" + REST, 251),
        ("2500000,99999999999999999999" + REST, 251),
    ],
    ids=["cut", "two run together", "nan", "1e9 g", "a word", "empty", "inf us", "1e300 us", "count"],
)
def test_a_line_that_no_board_sends_is_torn_and_left_out(line: str, next_row: int) -> None:
    reader, frames = read(HEADER + write_rows(0, 250) + line + write_rows(next_row, 300))

    assert reader.torn == 1
    assert 250 not in frames.counter
    assert len(frames) == 300 - (next_row - 250)


def test_a_board_that_is_reset_while_its_rate_is_measured_is_read_from_there() -> None:
    before = HEADER + write_rows(0, 100, stamp=50_000_000)

    reader, frames = read(before + HEADER + write_rows(0, 250))

    assert reader.facts is not None
    assert reader.facts.rate_hz == 100.0
    assert len(frames) == 250


def test_a_header_that_changes_is_followed() -> None:
    # The same columns, the gyroscope in rad/s: 0.5 rad/s are 28.648 deg/s.
    changed = HEADER.replace("dps", "rad/s")

    reader, frames = read(HEADER + write_rows(0, 250) + changed + write_rows(250, 300))

    assert reader.torn == 0
    assert frames.gyr_dps[249, 0] == pytest.approx(0.5)
    assert frames.gyr_dps[250, 0] == pytest.approx(28.648, abs=0.001)


@pytest.mark.parametrize(
    ("text", "torn", "rows"),
    [
        (HEADER + write_rows(0, 250) + HEADER[12:] + write_rows(250, 300), 1, 300),
        (write_rows(0, 60) + PREAMBLE + HEADER + write_rows(60, 360), 0, 300),
        (HEADER + write_rows(0, 10) + "123,4\n" + write_rows(11, 300), 0, 299),
    ],
    ids=["torn header", "late header", "torn line before the header is understood"],
)
def test_a_torn_or_late_header_loses_no_row_after_it(text: str, torn: int, rows: int) -> None:
    reader, frames = read(text)

    assert len(frames) == rows
    assert reader.facts is not None
    assert reader.torn == torn


def test_a_board_that_sends_at_another_rate_is_refused() -> None:
    # From 100 to 50 Hz, the counter without a gap: the angle would turn half as far.
    slower = "".join(f"{3_000_000 + 20_000 * k},{300 + k},0.0,0.0,1.0,0.5,0.0,0.0\n" for k in range(200))

    with pytest.raises(UnusableTime, match="rate changed"):
        read(HEADER + write_rows(0, 300) + slower)


def test_without_stamps_rows_in_bursts_tell_the_rate() -> None:
    # Ten rows each 100 ms.
    reader = LineReader()
    reader.feed(NANO.encode(), 0)

    for k in range(1, 31):
        reader.feed(b"0.100,0.200,0.900,10.0,20.0,30.0\n" * 10, 100_000 * k)

    assert reader.facts is not None
    assert reader.facts.rate_hz == pytest.approx(100.0)


@pytest.mark.parametrize(
    "pieces", [[b"\xff\xfe\x00\x01,,\n"], [b"0" * 1000] * 5], ids=["no text", "no end: fills no memory"]
)
def test_bytes_that_are_no_line_are_a_torn_line(pieces: list[bytes]) -> None:
    reader = LineReader()
    feed(reader, HEADER + write_rows(0, 250))

    for piece in pieces:
        reader.feed(piece, 0)

    assert reader.torn == 1


def test_a_counter_that_wraps_loses_nothing() -> None:
    _, frames = read(HEADER + write_rows(0, 300, stamp=(1 << 32) - 500_000, count=65_500))

    assert frames.counter.tolist() == list(range(300))
    assert np.all(np.diff(frames.time_us) == 10_000)


def test_a_board_that_starts_anew_goes_on_after_a_hole() -> None:
    before = HEADER + write_rows(0, 300, stamp=50_000_000, count=7_000)

    reader, frames = read(before + PREAMBLE + HEADER + write_rows(0, 100))

    assert reader.restarts == 1
    assert reader.torn == 0
    assert len(frames) == 400
    assert np.all(np.diff(frames.time_us) > 0)


def test_the_nano_s_library_is_left_handed_and_prints_too_little() -> None:
    # IMU_Capture: no stamp and no counter; its arrivals tell the rate. The library prints 61.04 mdps for 70.
    reader = LineReader()
    reader.feed(NANO.encode(), 0)
    found = [reader.feed(b"0.100,0.200,0.900,10.0,20.0,30.0\n", 8403 * k) for k in range(300)]

    frames = next(frames for frames in found if frames is not None)
    assert frames.acc_g[0] == pytest.approx([-0.1, 0.2, 0.9])
    assert frames.gyr_dps[0] == pytest.approx([-11.468, 22.937, 34.406], abs=0.01)
    assert reader.facts is not None
    assert reader.facts.device == "nano33"
    assert reader.facts.rate_hz == pytest.approx(119.0, abs=0.1)


@pytest.mark.parametrize(
    ("header", "refusal"),
    [
        ("time_us,acc_x,acc_y,acc_z,gyr_x_dps,gyr_y_dps,gyr_z_dps\n", UnknownUnit),
        ("time_us,acc_x_g,acc_y_g,acc_z_g,mag_x,mag_y,mag_z\n", NoGyroscope),
        ("hello\n", UnknownColumns),
    ],
)
def test_a_header_that_leaves_something_open_is_refused(header: str, refusal: type[Exception]) -> None:
    rows = "".join(f"{10_000 * k},0.{k % 9},0.0,1.0,0.5,0.1,0.2\n" for k in range(300))

    with pytest.raises(refusal):
        read(header + rows)


# The clock of a stream: wraps, restarts, lost frames; all hand-worked at 100 Hz (10,000 us).

Frame = tuple[int | None, int | None, int]


def place(*frames: Frame) -> list[tuple[int, int]]:
    clock = StreamClock(10_000.0)
    return [clock.place(*frame) for frame in frames]


def test_without_a_stamp_rows_are_a_period_apart_however_they_come() -> None:
    # Four rows in one burst each 40 ms.
    bursts = [(None, None, 40_000 * (k // 4)) for k in range(4000)]

    placed = np.array(place(*bursts))

    assert placed[:, 1].tolist() == list(range(4000))
    assert np.abs(np.diff(placed[:, 0]) - 10_000).max() <= 500
    assert placed[-1, 0] == pytest.approx(39_990_000, abs=40_000)


def test_without_a_stamp_the_time_follows_a_board_whose_rate_is_another() -> None:
    # 101 Hz for 100 Hz, over 60 s.
    placed = place(*((None, None, 9_901 * k) for k in range(6000)))

    assert placed[-1][0] == pytest.approx(9_901 * 5999, abs=30_000)


@pytest.mark.parametrize(
    ("first", "second", "placed"),
    [
        (((1 << 32) - 4_000, 5, 0), (6_000, 6, 10_000), (10_000, 1)),
        ((0, 255, 0), (10_000, 0, 10_000), (10_000, 1)),
        ((0, 65_534, 0), (40_000, 2, 40_000), (40_000, 4)),  # 65,535, 0 and 1 were lost
        ((0, 10, 0), (30_000, 13, 30_000), (30_000, 3)),
        ((0, None, 0), (40_000, None, 40_000), (40_000, 4)),
        ((0, None, 0), (14_000, None, 14_000), (14_000, 1)),
        ((None, None, 0), (None, None, 1_000_000), (1_000_000, 100)),
        ((None, 7, 0), (None, 8, 1_000_000), (10_500, 1)),
    ],
    ids=[
        "stamp wraps", "8 bits wrap", "16 bits wrap over a loss", "counter shows a loss",
        "time shows a loss", "a late frame is no loss", "a silence is a loss", "counter shows a delay",
    ],
)  # fmt: skip
def test_a_frame_is_placed_by_its_stamp_its_counter_and_its_arrival(
    first: tuple[int | None, int | None, int],
    second: tuple[int | None, int | None, int],
    placed: tuple[int, int],
) -> None:
    assert place(first, second) == [(0, 0), placed]


def test_a_board_that_restarts_goes_on_by_the_arrivals() -> None:
    # Stamps begin anew after 2 s without a frame: 200 periods, 199 frames lost.
    clock = StreamClock(10_000.0)
    clock.place(500_000_000, 40_000, 0)

    assert clock.place(1_000, 0, 2_000_000) == (2_000_000, 200)
    assert clock.restarts == 1


def test_time_never_goes_back() -> None:
    clock = StreamClock(10_000.0)
    clock.place(500_000, None, 100)

    assert clock.place(400_000, None, 100)[0] == 10_000
