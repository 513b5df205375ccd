"""A simulated working day: its plan, its exact truth, and the sensor's readings, block by block."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import datetime

import numpy as np

from acromion.fusion.recording import Float64Array
from acromion.fusion.simulation.activities import (
    ACTIVITIES,
    HANGING,
    Choreography,
    draw_person,
    hold_still,
    relax,
)
from acromion.fusion.simulation.body import ArmState, Body, Motion, compute_readings, play
from acromion.fusion.simulation.sensor import (
    PARTS,
    Device,
    Part,
    RawArray,
    Readings,
    SensorErrors,
    draw_errors,
    quantise,
    sense,
)

START = datetime(2026, 3, 2, 7, 0, 0)  # noqa: DTZ001 - the device's own clock, which has no zone
CALIBRATION_S = 20.0
BLOCK_S = 60.0
WORK = {
    "standing": (0.09, 40.0),
    "walking": (0.15, 45.0),
    "assembly": (0.42, 150.0),
    "waiting": (0.06, 40.0),
    "overhead": (0.08, 50.0),
    "lifting": (0.15, 70.0),
    "swinging": (0.02, 12.0),
    "throwing": (0.02, 15.0),
}
"""Share of the work, and typical length in s, of each activity."""

ON_FOOT = frozenset({"walking", "lifting"})
WITHOUT_WALKING_SHARE, WORK_BLOCK_S, WHOLE_DAY_S = 0.3, (1200.0, 5400.0), 8 * 3600.0
"""Duration of work blocks on a whole day, and the share of blocks without a step."""
BREAKS = ((0.25, 0.02), (0.48, 0.06), (0.75, 0.02))
"""Start and duration (fractions of the shift) of the breaks."""


@dataclass(frozen=True, slots=True)
class PlannedActivity:
    """One entry of the day's plan; seconds from the first sample."""

    name: str
    start_s: float
    end_s: float


@dataclass(frozen=True, slots=True, eq=False)
class SampleBlock:
    """A stretch of samples.

    ``first_sample``: index of its first sample in the recording.
    ``time_s``: shape (n,): exact times, seconds from the first sample.
    ``state``: the truth.
    ``readings``: with the sensor's errors, before rounding and clipping.
    """

    first_sample: int
    time_s: Float64Array
    state: ArmState
    readings: Readings


@dataclass(frozen=True, slots=True, eq=False)
class SimulatedShift:
    """A day that can be generated repeatedly with identical results.

    ``rate_hz``: the true rate, which differs slightly from the nominal one.
    """

    device: Device
    seed: int
    nominal_rate_hz: float
    rate_hz: float
    sample_count: int
    start: datetime
    plan: tuple[PlannedActivity, ...]
    motion: Motion
    errors: SensorErrors
    body: Body

    @property
    def part(self) -> Part:
        """The sensor model."""
        return PARTS[self.device]

    @property
    def calibration_s(self) -> tuple[float, float]:
        """Start and end of the calibration pose; a plan without one raises StopIteration."""
        return next((entry.start_s, entry.end_s) for entry in self.plan if entry.name == "calibration")

    def blocks(self) -> Iterator[SampleBlock]:
        """Yield the day in blocks of about a minute, each with its own noise seed."""
        size = round(BLOCK_S * self.nominal_rate_hz)
        for number, first in enumerate(range(0, self.sample_count, size)):
            count = min(size, self.sample_count - first)
            time_s = np.arange(first, first + count) / self.rate_hz
            state = compute_readings(play(self.motion, first, count, self.rate_hz), self.body)
            readings = sense(state, self.errors, time_s, np.random.default_rng([self.seed, 3, number]))
            yield SampleBlock(first, time_s, state, readings)

    def count(self, readings: Readings) -> tuple[RawArray, RawArray]:
        """Round and clip as the sensor does: acceleration and angular rate as counts, shapes (n, 3)."""
        part = self.part
        return (
            quantise(readings.acc_g, part.acc_g_per_lsb, part.acc_range_g),
            quantise(readings.gyr_dps, part.gyr_dps_per_lsb, part.gyr_range_dps),
        )


def simulate_shift(
    device: Device, duration_h: float, seed: int, rate_hz: float | None = None
) -> SimulatedShift:
    """Simulate a day of work with a sensor on the right upper arm.

    ``duration_h``: length, to the second; a short day has the same activities, each shorter.
    ``seed``: determines everything: the person, the day, the sensor specimen, the noise. The same seed gives
    the same bytes.
    ``rate_hz``: nominal rate (the sensor's own if None); the true rate differs by its clock error.
    """
    duration_s = float(max(1, round(duration_h * 3600.0)))
    plan, motion = plan_day(duration_s, np.random.default_rng([seed, 1]))
    recorded = tuple(
        replace(entry, end_s=min(entry.end_s, duration_s)) for entry in plan if entry.start_s < duration_s
    )
    return wear_sensor(device, seed, recorded, motion, rate_hz)


def wear_sensor(
    device: Device, seed: int, plan: tuple[PlannedActivity, ...], motion: Motion, rate_hz: float | None = None
) -> SimulatedShift:
    """Mount a specimen of the sensor, from the first second of the plan to its last."""
    part, duration_s = PARTS[device], plan[-1].end_s
    nominal_hz = rate_hz or part.nominal_rate_hz
    chance = np.random.default_rng([seed, 2])
    true_hz = nominal_hz * (1.0 + chance.uniform(*part.rate_error))
    errors = draw_errors(part, true_hz, duration_s, chance)
    count = int(np.ceil(duration_s * true_hz))
    return SimulatedShift(device, seed, nominal_hz, true_hz, count, START, plan, motion, errors, Body())


def plan_day(duration_s: float, chance: np.random.Generator) -> tuple[tuple[PlannedActivity, ...], Motion]:
    """Return plan and motion of a person's day: a pose, then bouts of work with breaks at fixed times."""
    body = Choreography(draw_person(chance))
    body.move(1e-6, HANGING, after_s=-1.0)
    hold_still(body, min(CALIBRATION_S, duration_s), chance)
    plan = [PlannedActivity("calibration", 0.0, body.time_s)]
    breaks = [(start * duration_s, length * duration_s) for start, length in BREAKS]
    for start_s, length_s in [*breaks, (duration_s, 0.0)]:
        plan += work(body, start_s, duration_s, chance)
        if length_s and body.time_s < duration_s:
            plan.append(_perform(body, "break", length_s, chance))
    return tuple(plan), body.finish()


def work(
    body: Choreography, until_s: float, duration_s: float, chance: np.random.Generator
) -> list[PlannedActivity]:
    """Add bouts of work until a time; ``duration_s`` is that of the whole day."""
    plan = []
    scale = min(1.0, duration_s / 3600.0)
    block_end_s, is_on_foot = body.time_s, True
    while body.time_s < until_s:
        if body.time_s >= block_end_s:
            block_end_s += chance.uniform(*WORK_BLOCK_S) * min(1.0, duration_s / WHOLE_DAY_S)
            is_on_foot = chance.random() >= WITHOUT_WALKING_SHARE
        # draw the next bout so that each activity gets its share of the time
        names = [name for name in WORK if is_on_foot or name not in ON_FOOT]
        odds = np.array([WORK[name][0] / WORK[name][1] for name in names])
        name = names[int(chance.choice(len(names), p=odds / odds.sum()))]
        bout_s = max(3.0, WORK[name][1] * scale * chance.uniform(0.5, 1.5))
        plan.append(_perform(body, name, min(bout_s, max(3.0, until_s - body.time_s)), chance))
    return plan


def _perform(
    body: Choreography, name: str, duration_s: float, chance: np.random.Generator
) -> PlannedActivity:
    """Add one activity, after lowering the arm from the previous one."""
    start_s = body.time_s
    if start_s > 0.0:
        body.go(0.8, relax(body, chance))
    ACTIVITIES[name](body, duration_s, chance)
    return PlannedActivity(name, start_s, body.time_s)
