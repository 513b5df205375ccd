"""The part of section (h) in which the sensor turns soon after it was strapped on."""

from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from benchmarks.validation.document import Goal, draw_table, judge
from benchmarks.validation.turned_days import ABRUPT_S, HOURS, Turn, Turned, draw_across

MINUTES, ANGLES_DEG = (2.0, 4.0, 7.0, 9.0, 12.0), (20.0, 45.0, 90.0)
LEAST_VALID_PERCENT = 75.0
HEADER = ("turn", "left out", "named", "valid %, least", "RMSE deg, worst", "in the range %, worst")

PROSE = f"""\
Days of {HOURS:g} h on which the sensor turns in the first minutes, when little but the pose was held. The
rest of the day is to be kept and read from a window in which the arm hung as in walking. *Named*: days with a
caveat that names it (W-REMOUNT, W-SLIP-DOUBT, W-POSE-APART, W-POSE-DOUBT). *In the range*: valid rows within
1.96 times the standard deviation of their second and of the pose together."""


def list_early(seed: int) -> Iterator[tuple[tuple[float, float], Turn]]:
    """Every case with its angle and minute; the axis is drawn anew for each."""
    chance = np.random.default_rng([seed, 38])
    for angle_deg in ANGLES_DEG:
        for minute in MINUTES:
            across = draw_across(chance)
            yield (angle_deg, minute), Turn(angle_deg, across, 60.0 * minute, ABRUPT_S)


def measure_early(
    seeds: Sequence[int], play: Callable[[int, Turn], Sequence[Turned]]
) -> tuple[str, Goal, Goal]:
    """The table and its goals; ``play`` gives the days of a seed with a turn, one for each device."""
    found: dict[tuple[float, float], list[Turned]] = {}
    for seed in seeds:
        for case, turn in list_early(seed):
            found.setdefault(case, []).extend(play(seed, turn))
    return draw_table(HEADER, [_draw(*case) for case in found.items()]), *_judge(found)


def _draw(case: tuple[float, float], days: Sequence[Turned]) -> list[str]:
    return [
        f"{case[0]:g} deg after {case[1]:g} minutes",
        f"{sum(day.is_found for day in days)}/{len(days)}",
        f"{sum(day.is_named for day in days)}/{len(days)}",
        f"{min(day.valid_percent for day in days):.1f}",
        f"{max(day.rmse_deg for day in days):.2f}",
        f"{min(day.ranged_percent for day in days):.1f}",
    ]


def _judge(found: Mapping[tuple[float, float], Sequence[Turned]]) -> tuple[Goal, Goal]:
    days = [day for cases in found.values() for day in cases]
    unnamed = sum(not day.is_named for day in days)
    lost = sum(day.valid_percent < LEAST_VALID_PERCENT for day in days)
    what = "turns in the first 12 minutes: "
    return (
        judge(what + "not named", unnamed, 0, f"of {len(days)}", 0),
        judge(what + f"days with less than {LEAST_VALID_PERCENT:g} % valid", lost, 0, f"of {len(days)}", 0),
    )
