"""How many lines the refusals of one asker may leave: guesses stay visible, the audit log bounded."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from threading import Lock
from typing import Literal

WINDOW_S = 15 * 60.0
MOST_LINES, MOST_OF_STRANGERS = 50, 300
"""In a window: of one subject or address, and of all who are not logged in together."""
MOST_COUNTED = 10_000
"""So many askers are counted at once; whoever asked longest ago is forgotten first."""
STRANGERS = ""

Share = Literal["line", "more", "none"]
"""What a refusal leaves: its line, the one line that says that more were refused, or nothing."""


@dataclass(slots=True)
class RefusedLines:
    """Counts the lines of each asker in a fixed window; each server process counts for itself."""

    clock: Callable[[], float] = time.monotonic
    _counts: dict[str, tuple[float, int]] = field(default_factory=dict)
    _turn: Lock = field(default_factory=Lock)

    def take(self, asker: str, *, is_stranger: bool) -> Share:
        """Count a refusal of a subject, or of an address that is nobody's."""
        with self._turn:
            share = self._count(asker, MOST_LINES)
            if share == "none" or not is_stranger:
                return share
            of_all = self._count(STRANGERS, MOST_OF_STRANGERS)
            return share if of_all == "line" else of_all

    def _count(self, asker: str, most: int) -> Share:
        now_s = self.clock()
        began_s, number = self._counts.pop(asker, (now_s, 0))
        if now_s - began_s >= WINDOW_S:
            began_s, number = now_s, 0
        elif not number and len(self._counts) >= MOST_COUNTED:
            del self._counts[next(iter(self._counts))]
        self._counts[asker] = (began_s, number + 1)
        if number < most:
            return "line"
        return "more" if number == most else "none"
