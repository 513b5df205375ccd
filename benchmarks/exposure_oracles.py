"""Compare the figures of constructed signals with oracles: values that follow from a formula.

The metric filter is off if the oracle is defined without it. The last line counts the failures.
"""

from collections.abc import Iterator
from datetime import UTC, datetime
from zoneinfo import ZoneInfo

import numpy as np

from acromion.fusion.elevation import Elevation, ElevationSegment
from acromion.fusion.exposure.bins import find_percentiles, summarise_bins
from acromion.fusion.exposure.metric_filter import MetricAngle, filter_angle
from acromion.fusion.exposure.parts import split_hours
from acromion.fusion.exposure.speeds import (
    CycleTally,
    SpeedTally,
    count_rainflow,
    find_mean_power_frequency,
    measure_turns,
)
from acromion.fusion.exposure.stays import find_stays
from acromion.fusion.exposure.summary import summarise_exposure
from acromion.fusion.exposure.types import Exposure
from acromion.fusion.recording import IntArray
from acromion.fusion.runs import START, STOP, find_stays_above
from benchmarks.exposure_oracles_sensor import check_properties, check_sensor
from benchmarks.exposure_oracles_table import ALL_DAY, FloatVector, Oracle, sample, share_above, tally


def swing(time_s: FloatVector) -> FloatVector:
    return np.asarray(45 + 40 * np.sin(2 * np.pi * 0.25 * time_s))


def square(time_s: FloatVector) -> FloatVector:
    return np.where(time_s % 90 < 60, 10.0, 70.0)


def expose(angle_deg: FloatVector, rate_hz: float) -> Exposure:
    valid = np.ones(len(angle_deg), np.bool_)
    return summarise_exposure(
        Elevation((ElevationSegment(0, rate_hz, angle_deg.astype(np.float32), valid),), None)
    )


def check_swing() -> Iterator[Oracle]:
    angle = sample(swing, 600)
    for threshold_deg, share in ((20, 0.714901), (30, 0.622357), (60, 0.377643), (80, 0.160861)):
        yield Oracle("1", f"swing above {threshold_deg} deg", share, share_above(angle, threshold_deg), 0.005)
    percentiles = find_percentiles(tally(angle))
    for p, value in ((1, 5.0197), (10, 6.9577), (50, 45.0), (90, 83.0423), (99, 84.9803)):
        yield Oracle("2", f"swing P{p}, deg", value, percentiles[p], 0.06)
    speeds = SpeedTally()
    speeds.add_inclination(angle)
    velocity = speeds.summarise()
    assert velocity is not None
    computed = (velocity.p10_dps, velocity.p50_dps, velocity.p90_dps, velocity.p99_dps, velocity.mean_dps)
    names = ("P10", "P50", "P90", "P99", "mean")
    for name, value, got in zip(names, (9.8291, 44.4288, 62.0583, 62.8241, 40.0), computed, strict=True):
        yield Oracle("3", f"swing speed {name}, deg/s", value, got, 0.05)
    slow = float(speeds.cell_s[:501].sum() / speeds.cell_s.sum())
    yield Oracle("4", "swing slower than 5 deg/s", 0.050714, slow, 0.0005)


def run_trigger(angle: MetricAngle, enter_deg: float, leave_deg: float) -> IntArray:
    return find_stays_above(angle.elevation_deg, angle.valid, np.array([enter_deg]), np.array([leave_deg]))


def check_repetition() -> Iterator[Oracle]:
    angle = sample(swing, 600, 2000.0)
    yield Oracle("5", "entries above 60 deg", 150, len(find_stays(angle, 60).entry_us), 0)
    for enter, leave, value in ((60.0, 60.0, 1.510571), (65.0, 55.0, 1.505805)):
        stays = run_trigger(angle, enter, leave)
        got = float((stays[:, STOP] - stays[:, START]).mean() / 2000)
        yield Oracle("6", f"stay, trigger {enter:g}/{leave:g}, s", value, got, 0.001)
    frequency_hz = find_mean_power_frequency(angle.elevation_deg, 2000.0) or 0.0
    yield Oracle("7", "swing, MPF of its speed, Hz", 0.25, frequency_hz, 0.002)
    cycles = CycleTally(np.zeros(1), ALL_DAY)
    cycles.add(angle)
    yield Oracle("8", "rainflow cycles of 60 to 90 deg", 149.5, cycles.summarise()[2].count, 0)
    tones = sample(lambda t: 60 + 30 * np.sin(0.4 * np.pi * t) + 5 * np.sin(3 * np.pi * t), 600, 100.0)
    frequency_hz = find_mean_power_frequency(tones.elevation_deg, 100.0) or 0.0
    yield Oracle("14", "two tones, MPF of the speed, Hz", 0.992683, frequency_hz, 0.002)
    rippled = sample(lambda t: 60 + 30 * np.sin(0.1 * np.pi * t) + 2 * np.sin(4 * np.pi * t), 600, 100.0)
    for enter, leave, value in ((65.0, 55.0, 30), (60.0, 60.0, 60)):
        got = len(run_trigger(rippled, enter, leave))
        yield Oracle("15", f"ripple, trigger {enter:g}/{leave:g}", value, got, 0)
    ranges, counts, _ = count_rainflow(np.array([-2.0, 1, -3, 5, -1, 3, -4, 4, -2]), np.zeros(9, np.int64))
    for size, value in ((3, 0.5), (4, 1.5), (6, 0.5), (8, 1.0), (9, 0.5)):
        yield Oracle("16", f"ASTM example, range {size}", value, float(counts[ranges == size].sum()), 0)


def check_shapes() -> Iterator[Oracle]:
    triangle = sample(lambda t: 5 + 80 * (1 - np.abs(2 * ((t / 4 + 0.25) % 1) - 1)), 600)
    for p, value in ((10, 13.0), (50, 45.0), (90, 77.0)):
        yield Oracle("9", f"triangle P{p}, deg", value, find_percentiles(tally(triangle))[p], 0.05)
    yield Oracle("9", "triangle above 60 deg", 0.3125, share_above(triangle, 60), 0.0005)
    ramp = [part.percent / 100 for part in summarise_bins(tally(sample(lambda t: t, 180, 100.0)))]
    for name, got, value in (
        ("0 to 20", ramp[0], 1 / 9),
        ("20 to 60", sum(ramp[1:4]), 2 / 9),
        ("60 to 90", sum(ramp[4:6]), 1 / 6),
        ("90 to 180", sum(ramp[6:]), 1 / 2),
    ):
        yield Oracle("10", f"ramp, {name} deg", value, got, 1e-6)
    holds = expose(square(np.arange(18_000) / 10), 10.0)
    yield Oracle("11", "holds above 60 deg, %", 100 / 3, holds.time_above[1].percent, 1e-6)
    yield Oracle("11", "holds, longest, s", 30.0, holds.episodes[1].longest_s or 0.0, 0)
    yield Oracle("11", "EVA 0-20 deg, 31-63 s, %", 200 / 3, float(holds.eva.percent[0, 5]), 1e-6)
    yield Oracle("11", "EVA sum, %", 100.0, float(holds.eva.percent.sum()), 1e-9)


def check_days() -> Iterator[Oracle]:
    time_s = np.arange(8 * 36_000) / 10
    day = expose(np.where((time_s >= 7200) & (time_s < 7800), 70.0, 10.0), 10.0)
    for window, value in zip(day.peak_windows, (100.0, 200 / 3, 100 / 6), strict=True):
        name = f"worst {window.length_s // 60} min, %"
        yield Oracle("12", name, value, window.percent_above_60 or 0.0, 0.005)
    low, high = np.linspace(0, 30, 21_600, endpoint=False), np.linspace(60, 90, 7200, endpoint=False)
    pooled = expose(np.concatenate([low, high]), 1.0).percentiles_deg
    yield Oracle("13", "pooled P50, deg", 20.0, pooled[50], 0.06)
    yield Oracle("13", "pooled P90, deg", 78.0, pooled[90], 0.06)
    still = expose(np.full(360_000, 50.0), 100.0)
    yield Oracle("27", "held at 50 deg: longest, s", 3600.0, still.episodes[0].longest_s or 0.0, 0)
    yield Oracle("27", "held at 50 deg: entries", 0, still.entries[0].count, 0)
    toronto = datetime(2027, 3, 14, 3, tzinfo=UTC).astimezone(ZoneInfo("America/Toronto"))
    hours = [int(label[11:13]) for label in split_hours(toronto, 7 * 3600 * 10**6).labels]
    yield Oracle("28", "hour after 01 when clocks go on", 3, hours[4], 0)
    yield Oracle("28", "hours of the night shift", 7, len(hours), 0)


def check_turning() -> Iterator[Oracle]:
    tilt, turned = np.radians(60.0), np.radians(90.0) * np.arange(200) / 100
    about = np.stack(
        [np.sin(tilt) * np.cos(turned), -np.sin(tilt) * np.sin(turned), np.cos(tilt) + 0 * turned], 1
    )
    valid = np.ones(200, np.bool_)
    yield Oracle(
        "17", "axial spin, generalised, deg/s", 77.9423, float(measure_turns(about, valid, 100.0)[9]), 0.02
    )
    lifted = np.radians(9.0) * np.arange(200) / 100
    plane = np.stack([np.sin(lifted), 0 * lifted, np.cos(lifted)], 1)
    yield Oracle(
        "17", "elevation, generalised, deg/s", 9.0, float(measure_turns(plane, valid, 100.0)[9]), 1e-6
    )
    tone = np.sin(2 * np.pi * 5 * np.arange(2000) / 100)
    yield Oracle(
        "20", "metric filter at 5 Hz", 0.5, float(np.abs(filter_angle(tone, 100.0)[500:1500]).max()), 0.001
    )
    gap = sample(lambda t: swing(t - 0.005), 600, 100.0)
    gap.valid[10_000:11_200] = False
    yield Oracle("23", "gap of three swings, above 60 deg", 0.3775, share_above(gap, 60), 0.0001)


CHECKS = (
    check_swing,
    check_repetition,
    check_shapes,
    check_days,
    check_turning,
    check_sensor,
    check_properties,
)


def list_oracles() -> list[Oracle]:
    """Return every figure in the order of the oracles."""
    return sorted((oracle for check in CHECKS for oracle in check()), key=lambda o: int(o.number))


def format_oracles(oracles: list[Oracle]) -> Iterator[str]:
    """Yield the lines of a Markdown table, and the number of failures."""
    yield "| D | figure | expected | got | tolerance | |"
    yield "|---:|---|---:|---:|---:|---|"
    for o in oracles:
        values = f"{o.expected:.6f} | {o.got:.6f} | {o.tolerance:.6f}"
        yield f"| {o.number} | {o.name} | {values} | {'met' if o.is_met else '**fails**'} |"
    failed = sum(not oracle.is_met for oracle in oracles)
    yield ""
    yield f"{len(oracles)} figures of {len({o.number for o in oracles})} oracles, {failed} fail."


def main() -> int:
    oracles = list_oracles()
    print("\n".join(format_oracles(oracles)))
    return 0 if all(oracle.is_met for oracle in oracles) else 1


if __name__ == "__main__":
    raise SystemExit(main())
