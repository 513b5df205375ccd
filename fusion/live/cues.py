"""When a person is to be told: rules over the live angle (docs/it/live.md gives what is known of each).

Only counted (valid) rows matter: a gap, or the first seconds after one, ends a stay.
"""

from collections import deque
from dataclasses import dataclass
from typing import Literal

from acromion.fusion.live.session import LiveRows
from acromion.fusion.recording import MICROSECONDS

CueKind = Literal["hold", "share", "stays"]
SHARE_WINDOW_S, STAYS_WINDOW_S = 900.0, 300.0
LEAST_KNOWN = 0.8
"""Minimum coverage of a window before its share is used, as in the report's windows."""
STAY_S = 7.0
"""Shortest stay for the exposure variation rule: the report's class of 7 to 15 s and longer."""
QUIET_S = 60.0
"""After a cue for a share or for stays, the same rule is silent for this time."""
LONGEST_STEP_S = 0.2


@dataclass(frozen=True, slots=True)
class CueRule:
    """One rule.

    ``kind``: "hold": at or above ``angle_deg`` for ``seconds`` without a break, repeated after each such
    period. "share": more than ``percent`` of the last 15 minutes at or above ``angle_deg``. "stays": in the
    last 5 minutes more than ``seconds`` in stays of at least 7 s at or above ``angle_deg``, based on exposure
    variation analysis.
    ``angle_deg``, ``seconds``, ``percent``: limits; a kind ignores limits that it does not use.
    """

    kind: CueKind
    angle_deg: float = 60.0
    seconds: float = 10.0
    percent: float = 10.0


@dataclass(frozen=True, slots=True)
class Cue:
    """A cue: the time in the stream's clock, and the rule."""

    time_s: float
    rule: CueRule


class CueWatch:
    """Tracks the angle and returns the cues of its rules; the result does not depend on the chunks."""

    def __init__(self, rules: tuple[CueRule, ...]) -> None:
        self._watches = tuple(_RuleWatch(rule) for rule in rules)

    def take(self, rows: LiveRows) -> list[Cue]:
        """Process the next rows; return the cues in time order."""
        cues: list[Cue] = []
        times_s = (rows.time_us / MICROSECONDS).tolist()
        for time_s, angle_deg, is_valid in zip(
            times_s, rows.elevation_deg.tolist(), rows.valid.tolist(), strict=True
        ):
            known_deg = angle_deg if is_valid else None
            cues += [Cue(time_s, watch.rule) for watch in self._watches if watch.step(time_s, known_deg)]
        return cues


class _RuleWatch:
    """One rule over the rows, second by second for windows."""

    def __init__(self, rule: CueRule) -> None:
        self.rule = rule
        window_s = SHARE_WINDOW_S if rule.kind == "share" else STAYS_WINDOW_S
        self._window_s = window_s
        self._seconds: deque[tuple[int, float, float]] = deque()
        self._sums = [0.0, 0.0]
        self._second, self._known_s, self._above_s = 0, 0.0, 0.0
        self._before_s: float | None = None
        self._stay_s = self._told_s = 0.0
        self._silent_until_s = 0.0

    def step(self, time_s: float, angle_deg: float | None) -> bool:
        """Process a row, None if the angle is not counted; return whether it triggers a cue."""
        step_s = 0.0 if self._before_s is None else time_s - self._before_s
        is_known = angle_deg is not None and 0.0 < step_s <= LONGEST_STEP_S
        self._before_s = None if angle_deg is None else time_s
        is_above = is_known and angle_deg is not None and angle_deg >= self.rule.angle_deg
        self._stay_s = self._stay_s + step_s if is_above else 0.0
        if self.rule.kind == "hold":
            return self._hold()
        self._close_second(time_s)
        self._known_s += step_s if is_known else 0.0
        self._above_s += self._count_above(step_s, is_above=is_above)
        return self._is_over(time_s)

    def _hold(self) -> bool:
        if self._stay_s == 0.0:
            self._told_s = 0.0
            return False
        if self._stay_s - self._told_s < self.rule.seconds - 1e-9:
            return False
        self._told_s += self.rule.seconds
        return True

    def _count_above(self, step_s: float, *, is_above: bool) -> float:
        """Return the seconds that this row adds; a stay counts from its start once it is long enough."""
        if not is_above:
            return 0.0
        if self.rule.kind == "share":
            return step_s
        if self._stay_s < STAY_S:
            return 0.0
        return self._stay_s if self._stay_s - step_s < STAY_S else step_s

    def _close_second(self, time_s: float) -> None:
        """Close the second that has ended, and drop the seconds that left the window."""
        if int(time_s) == self._second:
            return
        self._seconds.append((self._second, self._known_s, self._above_s))
        self._sums[0] += self._known_s
        self._sums[1] += self._above_s
        self._second, self._known_s, self._above_s = int(time_s), 0.0, 0.0
        while self._seconds and self._seconds[0][0] < self._second - self._window_s:
            _, known_s, above_s = self._seconds.popleft()
            self._sums[0] -= known_s
            self._sums[1] -= above_s

    def _is_over(self, time_s: float) -> bool:
        if time_s < self._silent_until_s:
            return False
        known_s, above_s = self._sums[0] + self._known_s, self._sums[1] + self._above_s
        if self.rule.kind == "share":
            is_over = (
                known_s >= LEAST_KNOWN * self._window_s and 100.0 * above_s > self.rule.percent * known_s
            )
        else:
            is_over = self._stay_s >= STAY_S and above_s > self.rule.seconds
        if is_over:
            self._silent_until_s = time_s + QUIET_S
        return is_over
