"""The clock of a stream: counters that wrap, boards that restart."""

from dataclasses import dataclass

from fusion.recording import MICROSECONDS

STAMP_SIZE = 1 << 32
"""``micros()`` wraps here, every 71.6 minutes."""
COUNTER_SIZES = (1 << 8, 1 << 16, 1 << 32)
LONGEST_LOSS = 0.25
"""A counter that jumps by up to this part of its size has lost frames; by more, it began anew."""
LONGEST_STEP_US = 60 * MICROSECONDS
"""A stamp that jumps further began anew: the board was reset."""
LONGEST_DELAY_US = MICROSECONDS // 2
"""Rows without a stamp that come later than this were lost or not taken; up to it they were on their way."""
ARRIVAL_GAIN, MOST_PULL = 0.005, 0.05
"""So much of its distance from the arrivals the time of rows without a stamp takes back at each row, up to so
much of a period."""


@dataclass(slots=True)
class StreamClock:
    """Gives each frame a time that never goes back and a counter that never wraps.

    Frames without stamps are a period apart and follow the arrivals slowly, for frames come in bursts; frames
    without counter are counted by their time: a step of more than 1.5 periods, or without stamps a delay of
    more than half a second, shows as lost frames. After a restart of the board the time
    goes on by what passed between the arrivals.
    """

    period_us: float
    restarts: int = 0
    _stamp: int = -1
    _count: int = -1
    _time_us: int = -1
    _counter: int = -1
    _arrived_us: int = 0
    _origin_us: int = 0

    def place(self, stamp_us: int | None, count: int | None, arrived_us: int) -> tuple[int, int]:
        """Give time (us) and counter of the next frame.

        Parameters
        ----------
        stamp_us, count
            As the board wrote them; None where it writes none.
        arrived_us
            Of a clock here that never goes back.
        """
        if self._time_us < 0:
            time_us, counter = 0, 0
            self._origin_us = arrived_us
        elif stamp_us is None:
            time_us, counter = self._place_unstamped(count, arrived_us)
        else:
            step_us = self._step(stamp_us, arrived_us)
            time_us = self._time_us + step_us
            counter = self._counter + self._count_step(count, step_us)
        self._stamp, self._count = _or_none(stamp_us), _or_none(count)
        self._time_us, self._counter, self._arrived_us = time_us, counter, arrived_us
        return time_us, counter

    def _place_unstamped(self, count: int | None, arrived_us: int) -> tuple[int, int]:
        restarts = self.restarts
        steps = self._count_step(count, round(self.period_us))
        due_us = self._time_us + steps * self.period_us
        late_us = arrived_us - self._origin_us - due_us
        is_unnumbered = count is None or self.restarts > restarts
        if is_unnumbered and late_us > LONGEST_DELAY_US:
            steps += round(late_us / self.period_us)
            due_us += late_us
        else:
            most_us = MOST_PULL * self.period_us
            due_us += max(-most_us, min(ARRIVAL_GAIN * late_us, most_us))
        return max(self._time_us + 1, round(due_us)), self._counter + steps

    def _step(self, stamp_us: int, arrived_us: int) -> int:
        """Microseconds since the frame before, at least one."""
        between_us = max(1, arrived_us - self._arrived_us)
        if self._stamp < 0:
            return between_us
        step_us = stamp_us - self._stamp
        if step_us < 0 and self._stamp < STAMP_SIZE:
            step_us += STAMP_SIZE
        if 0 < step_us <= max(LONGEST_STEP_US, 2 * between_us):
            return step_us
        self.restarts += 1
        self._count = -1  # its counter began anew, too
        return max(between_us, round(self.period_us))

    def _count_step(self, count: int | None, step_us: int) -> int:
        """Frames since the one before, itself counted; at least one."""
        if count is not None and self._count >= 0:
            step = count - self._count
            if step > 0:
                return step
            for size in COUNTER_SIZES:
                if self._count < size and 0 < step + size <= LONGEST_LOSS * size:
                    return step + size
            self.restarts += 1
        periods = step_us / self.period_us
        return max(1, round(periods)) if periods > 1.5 else 1


def _or_none(value: int | None) -> int:
    return -1 if value is None else value
