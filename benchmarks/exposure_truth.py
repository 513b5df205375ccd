"""Compare simulated shifts with their exact angle, and count the ranges that include the truth.

The truth is the exact angle of the simulated arm, counted in the same way. A range includes the error of the
angle (of the fusion, and of a pose held 3 deg off) and the sampling of the day in 5-minute blocks. Here both
sides have the same day, so only the first part is tested. A range that is wide because of its second part
includes the truth more often than 95 %. The ranges of speeds include the sampling only, so they do not show
the error of the angle. The ranges of the worst windows and of the longest episode include the error only, so
they do not show the variation between days. The simulated pose is held exactly; the second count rotates the
arm axis away from it, in a random direction, by an amount that the range allows for.
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from acromion.fusion.elevation import Elevation, ElevationSegment
from acromion.fusion.exposure.summary import summarise_exposure
from acromion.fusion.exposure.types import Exposure, Interval
from acromion.fusion.pipeline import Analysis, analyse
from acromion.fusion.pose.rules import HELD_SIGMA_DEG
from acromion.fusion.recording import Recording, Segment
from acromion.fusion.settings import AnalysisSettings
from acromion.fusion.simulation.sensor import Device
from acromion.fusion.simulation.shift import simulate_shift
from benchmarks.validation.worn import at_rows
from tests.simulated_shifts import play_shift

DEVICES: tuple[Device, ...] = ("gt9x", "lsm9ds1")
HOURS = 8.0
SEEDS = 10
ASKED_HZ = {"gt9x": 100.0, "lsm9ds1": 238.0}


@dataclass(frozen=True, slots=True)
class Compared:
    """A figure from the sensor, from the exact angle, and its range."""

    name: str
    measured: float
    true: float
    interval: Interval | None

    @property
    def is_inside(self) -> bool:
        """Return whether the range includes the truth."""
        return self.interval is not None and self.interval.low <= self.true <= self.interval.high


def expose_shift(device: Device, seed: int, hours: float) -> tuple[Analysis, Exposure]:
    """Analyse a simulated shift, and count its exact angle over the same valid rows."""
    shift = simulate_shift(device, hours, seed, ASKED_HZ[device])
    day = play_shift(shift)
    segment = Segment(0, day.rate_hz, day.acc_g, day.gyr_dps)
    recording = Recording(device, "0" * 64, day.start, None, segment.duration_us, (segment,))
    analysis = analyse(recording, AnalysisSettings(calibration_windows_s=(shift.calibration_s,)))
    (fused,) = analysis.elevation.segments
    exact_deg = at_rows(day.elevation_deg, len(fused)).astype(np.float32)
    exact = ElevationSegment(0, fused.rate_hz, exact_deg, fused.valid)
    return analysis, summarise_exposure(Elevation((exact,), None), day.start)


def turn_pose(analysis: Analysis, seed: int) -> Exposure:
    """Count again with the arm axis of a pose that is held 3 deg off (one sigma) in both directions."""
    random = np.random.default_rng([seed, 7])
    assert analysis.calibration is not None
    axis = analysis.calibration.arm_axis
    aside = np.cross(axis, random.normal(size=3))
    off = np.radians(HELD_SIGMA_DEG * random.normal())
    turned = np.cos(off) * axis + np.sin(off) * aside / np.linalg.norm(aside)
    (fused,) = analysis.elevation.segments
    assert fused.vertical is not None
    angle_deg = np.degrees(np.arccos(np.clip(fused.vertical[0 : len(fused)] @ turned, -1.0, 1.0)))
    segment = replace(fused, elevation_deg=angle_deg.astype(np.float32))
    sigma_deg = float(np.hypot(HELD_SIGMA_DEG, analysis.elevation.bias_sigma_deg or 0.0))
    elevation = Elevation((segment,), None)
    return summarise_exposure(elevation, analysis.recording.start, bias_sigma_deg=sigma_deg)


def compare(measured: Exposure, true: Exposure) -> Iterator[Compared]:
    """Yield the figures that depend on the angle alone, from both sides."""
    for ours, exact in zip(measured.bins, true.bins, strict=True):
        name = f"time {ours.lower_deg:g} to {ours.upper_deg:g} deg, %"
        yield Compared(name, ours.percent, exact.percent, ours.interval)
    for above, exact_above in zip(measured.time_above, true.time_above, strict=True):
        name = f"time above {above.threshold_deg:g} deg, %"
        yield Compared(name, above.percent, exact_above.percent, above.interval)
    ranges, truths = measured.intervals, _name_figures(true)
    for name, value in _name_figures(measured).items():
        yield Compared(name, value, truths[name], ranges.get(name))


def _name_figures(exposure: Exposure) -> dict[str, float]:
    speed = exposure.velocity_dps["inclination"]
    assert speed is not None
    return {
        **{f"elevation_p{p}_deg": value for p, value in exposure.percentiles_deg.items()},
        **{f"entries_above_{e.threshold_deg:g}_per_h": e.per_hour for e in exposure.entries},
        **{f"episodes_above_{e.threshold_deg:g}_total_s": e.total_s for e in exposure.episodes},
        **{f"episodes_above_{e.threshold_deg:g}_longest_s": e.longest_s or 0.0 for e in exposure.episodes},
        **{f"cycles_{c.lower_deg:g}_{c.upper_deg:g}_count": c.count for c in exposure.cycles[:-1]},
        "inclination_velocity_p50_dps": speed.p50_dps,
        "inclination_velocity_p90_dps": speed.p90_dps,
        **{
            f"worst_{w.length_s // 60}_min_above_60_percent": w.percent_above_60 or 0.0
            for w in exposure.peak_windows
        },
    }


def format_device(device: Device, seeds: int = SEEDS, hours: float = HOURS) -> Iterator[str]:
    """Yield as Markdown the figures of the first shift, and how often the ranges of all include the truth."""
    held: Counter[str] = Counter()
    held_turned: Counter[str] = Counter()
    for seed in range(1, seeds + 1):
        analysis, true = expose_shift(device, seed, hours)
        rows = list(compare(analysis.exposure, true))
        held.update({row.name: row.is_inside for row in rows})
        held_turned.update({r.name: r.is_inside for r in compare(turn_pose(analysis, seed), true)})
        if seed == 1:
            yield f"{device} at {ASKED_HZ[device]:g} Hz, {hours:g} h, seed 1:"
            yield ""
            yield from format_shift(rows)
    yield ""
    yield f"{device}, {seeds} shifts: how many ranges include the figure of the exact angle."
    yield ""
    yield from format_coverage(held, held_turned, seeds)


def format_shift(rows: list[Compared]) -> Iterator[str]:
    """Yield one shift's figures with those of its exact angle."""
    yield "| figure | sensor | exact angle | 95 % range | truth inside |"
    yield "|---|---:|---:|---:|---|"
    for row in rows:
        interval = f"{row.interval.low:.2f} to {row.interval.high:.2f}" if row.interval else "none"
        inside = "yes" if row.is_inside else "**no**"
        yield f"| {row.name} | {row.measured:.2f} | {row.true:.2f} | {interval} | {inside} |"


def format_coverage(held: Counter[str], held_turned: Counter[str], seeds: int) -> Iterator[str]:
    """Yield for how many shifts the range of each figure included the truth."""
    yield "| figure | pose exact | pose off |"
    yield "|---|---:|---:|"
    for name, count in held.items():
        yield f"| {name} | {count} | {held_turned[name]} |"
    shares = [100 * sum(counts.values()) / (seeds * len(held)) for counts in (held, held_turned)]
    yield f"| all, % | {shares[0]:.1f} | {shares[1]:.1f} |"


def main(seeds: int = SEEDS, devices: tuple[Device, ...] = DEVICES) -> int:
    print(__doc__)
    for device in devices:
        for line in format_device(device, seeds):
            print(line, flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
