"""Normal equations of three unknowns that are straight lines between knots."""

import numpy as np
from numpy.typing import NDArray

Table = NDArray[np.float64]
BAND = 6
"""Three unknowns at each knot, and neighbours touch."""


JUMP_S = 0.02
"""Two knots so near each other stand for a jump, and are not held together."""


def hold_together(knots_s: Table, sd_per_root_min: float) -> Table:
    """Lower band of a random walk from knot to knot, the same for each of the three unknowns."""
    band = np.zeros((BAND, 3 * len(knots_s)))
    apart_s = np.diff(knots_s)
    stiffness = 1.0 / (sd_per_root_min**2 * np.maximum(apart_s, 1.0) / 60.0)
    stiffness[apart_s < 1.5 * JUMP_S] = 0.0
    per_axis = np.repeat(stiffness, 3)
    band[0, :-3] += per_axis
    band[0, 3:] += per_axis
    band[3, :-3] -= per_axis
    return band


class Hats:
    """Shares observations at given times between the two knots about each."""

    def __init__(self, knots_s: Table, time_s: Table) -> None:
        self.left = np.clip(np.searchsorted(knots_s, time_s, side="right") - 1, 0, len(knots_s) - 2)
        width_s = knots_s[self.left + 1] - knots_s[self.left]
        self.share = np.clip((time_s - knots_s[self.left]) / width_s, 0.0, 1.0)

    def add(self, band: Table, right: Table, squares: Table, pulls: Table) -> None:
        """Add ``squares`` (w, 3, 3) to the lower band and ``pulls`` (w, 3) to the right side."""
        here, there = 1.0 - self.share, self.share
        self.pull(right, pulls)
        for row in range(3):
            for column in range(3):
                value = squares[:, row, column]
                self._collect(band[3 + row - column], column, here * there * value)
                if row >= column:
                    self._collect(band[row - column], column, here**2 * value)
                    self._collect(band[row - column], column + 3, there**2 * value)

    def add_alike(self, band: Table, right: Table, weight: Table, pulls: Table) -> None:
        """The same where each observation is of the three unknowns themselves, with one ``weight`` (w,)."""
        here, there = 1.0 - self.share, self.share
        self.pull(right, pulls)
        for place, values in (
            (band[0], here**2 * weight),
            (band[0, 3:], there**2 * weight),
            (band[3], here * there * weight),
        ):
            sums = np.bincount(self.left, weights=values)
            place[: 3 * len(sums)] += np.repeat(sums, 3)

    def pull(self, right: Table, pulls: Table) -> None:
        """Add ``pulls`` (w, 3) to the right side alone."""
        for row in range(3):
            self._collect(right, row, (1.0 - self.share) * pulls[:, row])
            self._collect(right, row + 3, self.share * pulls[:, row])

    def read(self, values: Table) -> Table:
        """Values (k, 3) of the knots at the times of the observations, (w, 3)."""
        share = self.share[:, None]
        return np.asarray((1.0 - share) * values[self.left] + share * values[self.left + 1])

    def _collect(self, target: Table, offset: int, values: Table) -> None:
        """Add ``values`` (w,) so many places behind the first unknown of the knot on the left."""
        sums = np.bincount(self.left, weights=values)
        target[offset : offset + 3 * len(sums) : 3] += sums
