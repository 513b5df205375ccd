"""The clock of a stream: wraps, restarts, lost frames; all hand-worked at 100 Hz (10,000 us)."""

from fusion.live import StreamClock


def place(*frames: tuple[int | None, int | None, int]) -> list[tuple[int, int]]:
    clock = StreamClock(10_000.0)
    return [clock.place(*frame) for frame in frames]


def test_the_first_frame_is_at_zero() -> None:
    assert place((4_000_000, 77, 0)) == [(0, 0)]


def test_a_stamp_that_wraps_goes_on() -> None:
    assert place(((1 << 32) - 4_000, 5, 0), (6_000, 6, 10_000))[1] == (10_000, 1)


def test_a_counter_of_eight_bits_wraps() -> None:
    assert place((0, 255, 0), (10_000, 0, 10_000))[1] == (10_000, 1)


def test_a_counter_of_sixteen_bits_wraps_over_a_loss() -> None:
    # 65,534 is followed by 2: 65,535, 0 and 1 were lost.
    assert place((0, 65_534, 0), (40_000, 2, 40_000))[1] == (40_000, 4)


def test_lost_frames_show_in_the_counter() -> None:
    assert place((0, 10, 0), (30_000, 13, 30_000))[1] == (30_000, 3)


def test_without_a_counter_time_shows_lost_frames() -> None:
    assert place((0, None, 0), (40_000, None, 40_000))[1] == (40_000, 4)


def test_without_a_counter_a_late_frame_is_not_a_loss() -> None:
    assert place((0, None, 0), (14_000, None, 14_000))[1] == (14_000, 1)


def test_without_a_stamp_the_arrival_is_the_time() -> None:
    assert place((None, 1, 5_000), (None, 2, 15_500))[1] == (10_500, 1)


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
