"""Lines of a board: header, torn lines, a board that starts anew."""

import numpy as np
import pytest

from fusion.errors import NoGyroscope, UnknownColumns, UnknownUnit, UnusableTime
from fusion.live import Frames
from fusion.live.lines import LineReader

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


def test_the_header_tells_device_ranges_and_rate() -> None:
    reader, _ = read(PREAMBLE + HEADER + write_rows(0, 300))

    facts = reader.facts
    assert facts is not None
    assert (facts.device, facts.rate_hz) == ("lsm9ds1", 100.0)
    assert (facts.acc_range_g, facts.gyr_range_dps) == (16.0, 2000.0)


def test_no_row_is_lost_from_the_first_on() -> None:
    reader, frames = read(PREAMBLE + HEADER + write_rows(0, 300))

    assert frames.counter.tolist() == list(range(300))
    assert frames.time_us.tolist() == [10_000 * k for k in range(300)]
    assert frames.acc_g[:, 0] == pytest.approx(np.arange(300) / 1000)
    assert reader.torn == 0


def test_rows_too_few_to_tell_the_rate_at_once_are_given_at_the_end() -> None:
    reader = LineReader()
    assert feed(reader, HEADER + write_rows(0, 60)) == []

    frames = reader.finish()

    assert frames is not None
    assert frames.counter.tolist() == list(range(60))


def test_at_the_end_nothing_is_given_twice() -> None:
    reader, _ = read(HEADER + write_rows(0, 300))

    assert reader.finish() is None


def test_a_torn_line_is_left_out_and_shows_as_lost() -> None:
    torn = write_rows(250, 251)[:17] + "\n"

    reader, frames = read(HEADER + write_rows(0, 250) + torn + write_rows(251, 300))

    assert reader.torn == 1
    assert 250 not in frames.counter
    assert len(frames) == 299


def test_two_lines_that_ran_together_are_left_out() -> None:
    together = write_rows(250, 251).rstrip("\n") + write_rows(251, 252)

    reader, frames = read(HEADER + write_rows(0, 250) + together + write_rows(252, 300))

    assert reader.torn == 1
    assert len(frames) == 298


@pytest.mark.parametrize("value", ["nan", "1e9", "x", ""])
def test_a_value_that_no_sensor_has_is_a_torn_line(value: str) -> None:
    wrong = f"2500000,250,{value},0.0,1.0,0.5,0.0,0.0\n"

    reader, frames = read(HEADER + write_rows(0, 250) + wrong + write_rows(251, 300))

    assert reader.torn == 1
    assert len(frames) == 299


@pytest.mark.parametrize("start", ["inf,250", "1e300,250", "2500000,99999999999999999999"])
def test_a_stamp_or_a_count_that_no_board_has_is_a_torn_line(start: str) -> None:
    wrong = f"{start},0.25,0.0,1.0,0.5,0.0,0.0\n"

    reader, frames = read(HEADER + write_rows(0, 250) + wrong + write_rows(251, 300))

    assert reader.torn == 1
    assert len(frames) == 299


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


def test_a_torn_header_changes_nothing() -> None:
    reader, frames = read(HEADER + write_rows(0, 250) + HEADER[12:] + write_rows(250, 300))

    assert reader.torn == 1
    assert len(frames) == 300


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


def test_bytes_that_are_no_text_are_torn_lines() -> None:
    reader = LineReader()
    feed(reader, HEADER + write_rows(0, 250))

    reader.feed(b"\xff\xfe\x00\x01,,\n", 0)

    assert reader.torn == 1


def test_a_line_without_end_fills_no_memory() -> None:
    reader = LineReader()

    for _ in range(5):
        reader.feed(b"0" * 1000, 0)

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


def test_a_header_that_comes_late_is_waited_for() -> None:
    reader, frames = read(write_rows(0, 60) + PREAMBLE + HEADER + write_rows(60, 360))

    assert reader.facts is not None
    assert len(frames) == 300


def test_a_torn_line_before_the_header_is_understood_does_no_harm() -> None:
    _, frames = read(HEADER + write_rows(0, 10) + "123,4\n" + write_rows(11, 300))

    assert len(frames) == 299


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
    ],
)
def test_a_header_that_leaves_something_open_is_refused(header: str, refusal: type[Exception]) -> None:
    rows = "".join(f"{10_000 * k},0.{k % 9},0.0,1.0,0.5,0.1,0.2\n" for k in range(300))

    with pytest.raises(refusal):
        read(header + rows)


def test_words_that_are_no_header_are_refused() -> None:
    with pytest.raises(UnknownColumns):
        read("hello\n" + write_rows(0, 300))
