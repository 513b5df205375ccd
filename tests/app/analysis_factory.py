"""An analysis made by hand, so that the report can be tested without files or fusion.

A full shift of 7 h 59 min with two breaks, one hole, a heavy quarter of an hour and plausible figures; all
of them hang together (bins add up, time adds up), for the report prints sums.
"""

from collections.abc import Mapping
from dataclasses import replace
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from acromion.app.report.findings import CalibrationFacts, Findings, MethodFacts, RecordingFacts
from acromion.app.report.single.report import ReportSubject, Software
from acromion.fusion.exposure.types import (
    Cycles,
    ElevationBin,
    Entries,
    Episodes,
    Eva,
    Exposure,
    Interval,
    MinuteProfile,
    PartExposure,
    PeakWindow,
    Recovery,
    TimeAbove,
    Velocity,
)
from acromion.fusion.quality import Quality, TimeAccount
from acromion.fusion.recording import MICROSECONDS, QualityFlag, Span

RECORDED_S = 28740.0
BREAKS_S = ((7200.0, 8100.0), (14400.0, 16200.0))
HOLE_S = (20400.0, 20940.0)
BIN_EDGES_DEG = (0, 20, 30, 45, 60, 80, 90, 120, 150, 180)
BIN_PERCENT = (46.2, 21.3, 16.1, 8.8, 4.3, 1.2, 1.6, 0.4, 0.1)
START = datetime.fromisoformat("2026-03-03T07:58:12-05:00")
SHA256 = "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08"
ANALYSED_S = RECORDED_S - 900 - 1800 - 540


def make_subject(
    subject: str = "S012", file_name: str = "S012_right.gt3x", side: str | None = "right"
) -> ReportSubject:
    """Whose arm it is."""
    software, report_id = Software("0.1.0", "a1b2c3d4e5f6"), f"{subject}{side}".encode().hex()[:16]
    return ReportSubject(file_name, subject, side, software, report_id=report_id)  # type: ignore[arg-type]


def make_analysis(
    *,
    start: datetime | None = START,
    exposure: Exposure | None = None,
    quality: Quality | None = None,
    calibrated: bool = True,
) -> Findings:
    """Return an analysed shift."""
    recording = RecordingFacts(
        device="gt9x",
        sha256=SHA256,
        start=start,
        time_zone="UTC-05:00",
        duration_us=round(RECORDED_S * MICROSECONDS),
        rate_hz=100.0,
        serial_hash="3f2a9c01b7de",
    )
    exclusions = tuple(Span(_us(a), _us(b - a), "break") for a, b in BREAKS_S)
    time = TimeAccount(_us(RECORDED_S), _us(ANALYSED_S), _us(540), _us(2700))
    return Findings(
        recording=recording,
        calibration=make_calibration() if calibrated else None,
        method=make_method() if calibrated else None,
        exclusions=exclusions,
        time=time,
        exposure=exposure or make_exposure(),
        quality=quality or make_quality(),
    )


def make_calibration() -> CalibrationFacts:
    """An N-pose that a person said was held at the start of wear."""
    return CalibrationFacts(
        pose="n-pose",
        state="held_at_start",
        sigma_deg=5.0,
        start_s=42.5,
        duration_s=6.2,
        score=0.93,
        gyro_bias_dps=(0.31, -0.12, 0.07),
        walking_apart_deg=12.0,
    )


def make_method() -> MethodFacts:
    """An estimator with three parameters."""
    return MethodFacts("smoothed", "1", {"low_pass_hz": 0.5, "rest_threshold_dps": 2.0, "window_s": 30.0})


def make_quality(verdict: str = "caution") -> Quality:
    """A verdict with three caveats."""
    flags = (
        QualityFlag("W-GAP", 1, 540.0, HOLE_S[0], HOLE_S[1]),
        QualityFlag("W-NPOSE", 1, 0.0, 42.5, 42.5),
        QualityFlag("W-SEC-COUNT", 2571, 2571.0, 11.0, 28712.0),
    )
    return Quality(verdict, () if verdict == "good" else ("W-GAP",), flags)  # type: ignore[arg-type]


def make_exposure(*, above_60_interval: Interval | None = None) -> Exposure:
    """Figures of the shift; an interval on time above 60 deg where asked."""
    percent = {30: 32.5, 60: 7.6, 90: 2.1}
    return Exposure(
        analysed_s=ANALYSED_S,
        bins=_make_bins(),
        time_above=tuple(
            TimeAbove(c, ANALYSED_S * p / 100, p, above_60_interval if c == 60 else None)
            for c, p in percent.items()
        ),
        percentiles_deg={
            1: 3.1,
            5: 6.2,
            10: 8.4,
            25: 14.0,
            50: 21.6,
            75: 34.9,
            90: 54.2,
            95: 68.8,
            99: 101.3,
        },
        entries=(Entries(30, 1204, 169.98), Entries(60, 214, 30.21, 13.4), Entries(90, 61, 8.61)),
        recovery=Recovery(31.2, 22.4, 38.5, 27.1, 744.0),
        cycles=(Cycles(10, 30, 2210.5), Cycles(30, 60, 871.0), Cycles(60, 90, 160.5), Cycles(90, None, 44.0)),
        episodes=(
            Episodes(30, 1160, 212.4, 3.9, 18720.0, 4),
            Episodes(60, 201, 48.3, 4.2, 9840.0, 1),
            Episodes(90, 58, 19.7, 2.8, 18800.0, 0),
        ),
        velocity_dps=_make_velocities(),
        elevation_p99_deg=101.3,
        peak_windows=(
            PeakWindow(60, 18725.0, 88.3),
            PeakWindow(900, 18420.0, 41.2),
            PeakWindow(3600, 16800.0, 19.4),
        ),
        eva=_make_eva(),
        by_hour=_make_hours(),
        by_period=(),
        minutes=make_minutes(),
        histogram_s=_make_histogram(),
        quarter_hours=(
            PeakWindow(900, 18420.0, 41.2),
            PeakWindow(900, 8100.0, 22.5),
            PeakWindow(900, 25200.0, 9.0),
        ),
    )


def with_diary(exposure: Exposure) -> Exposure:
    """Add a diary: ceilings for 21 min above 60 deg, shelves twice for 19 min together, a till for 42 s.

    The ranges of ceilings and shelves overlap.
    """
    periods = (
        _make_period("Shelves", 0.0, 7200.0, 5.0),
        _make_period("Ceilings", 8100.0, 14400.0, 20.0),
        _make_period("Till", 16200.0, 20400.0, 1.0),
        _make_period("Shelves", 20940.0, 28740.0, 10.0),
    )
    pooled = replace(
        periods[0],
        end_s=28740.0,
        analysed_s=15000.0,
        time_above_percent={30: 30.0, 60: 7.6, 90: 1.0},
        periods=2,
    )
    ends = ((5.0, 10.0), (15.0, 25.0), (0.5, 2.0))
    tasks = tuple(
        replace(task, intervals={"time_above_60_percent": Interval(*each)})
        for task, each in zip((pooled, *periods[1:3]), ends, strict=True)
    )
    return replace(exposure, by_period=periods, by_task=tasks)


def _make_period(label: str, start_s: float, end_s: float, above_60_percent: float) -> PartExposure:
    return PartExposure(
        label=label,
        start_s=start_s,
        end_s=end_s,
        analysed_s=end_s - start_s,
        percentiles_deg={10: 8.0, 50: 21.0, 90: 55.0},
        time_above_percent={30: 30.0, 60: above_60_percent, 90: 1.0},
        entries_above_60_per_h=30.0,
        kind="task",
        recorded_s=end_s - start_s,
    )


def make_minutes() -> MinuteProfile:
    """The day in minutes: a slow wave with noise of a fixed seed, NaN in breaks and in the hole."""
    starts = np.arange(0.0, RECORDED_S, 60.0)
    rng = np.random.default_rng(7)
    load = 16 + 9 * np.sin(starts / 2100) ** 2 + rng.gamma(2.0, 2.2, len(starts))
    load[(starts >= 18420) & (starts < 19320)] += 32
    columns = [load * 0.45, load, load * 1.9 + rng.gamma(2.0, 5.0, len(starts))]
    idle = np.zeros(len(starts), bool)
    for a, b in (*BREAKS_S, HOLE_S):
        idle |= (starts >= a) & (starts < b)
    low, middle, high = (np.where(idle, np.nan, column) for column in columns)
    return MinuteProfile(starts, low, middle, np.minimum(high, 172), np.where(idle, 0.0, 60.0))


def with_velocity(exposure: Exposure, kind: str, velocity: Velocity | None) -> Exposure:
    """Replace one kind of speed."""
    kinds: Mapping[str, Velocity | None] = {**exposure.velocity_dps, kind: velocity}
    return replace(exposure, velocity_dps=dict(kinds))


def _make_bins() -> tuple[ElevationBin, ...]:
    edges = zip(BIN_EDGES_DEG[:-1], BIN_EDGES_DEG[1:], BIN_PERCENT, strict=True)
    return tuple(ElevationBin(a, b, ANALYSED_S * p / 100, p) for a, b, p in edges)


def _make_histogram() -> NDArray[np.float64]:
    """A distribution with the percentiles above: straight between them."""
    angles = [0, 3.1, 6.2, 8.4, 14.0, 21.6, 34.9, 54.2, 68.8, 101.3, 180]
    below = np.interp(np.arange(1801) / 10, angles, [0, 1, 5, 10, 25, 50, 75, 90, 95, 99, 100])
    return np.asarray(np.diff(below) / 100 * ANALYSED_S)


def _make_velocities() -> dict[str, Velocity | None]:
    return {
        "inclination": Velocity(1.2, 14.8, 62.0, 140.2, 25.1),
        "generalised": Velocity(2.3, 27.9, 98.4, 201.7, 41.0),
        "generalised_accelerometer": Velocity(2.0, 41.3, 120.4, 260.9, 58.2),
        "gyroscope": Velocity(3.0, 33.1, 118.9, 260.3, 49.8),
    }


def _make_eva() -> Eva:
    percent = np.full((5, 9), 100 / 45)
    return Eva((0, 20, 30, 60, 90, 180), (0, 1, 3, 7, 15, 31, 63, 127, 255, None), percent)


def _make_hours() -> tuple[PartExposure, ...]:
    first_full = 108.0
    starts = [0.0, *(first_full + 3600.0 * k for k in range(8))]
    ends = [*starts[1:], RECORDED_S]
    return tuple(
        PartExposure(
            label=f"{7 + k:02d}",
            start_s=a,
            end_s=b,
            analysed_s=min(3600.0, b - a),
            percentiles_deg={10: 7.0 + k % 3, 50: 20.0 + k, 90: 50.0 + 2 * k},
            time_above_percent={30: 28.0 + k, 60: 5.0 + k % 5, 90: 1.0 + 0.4 * k},
            entries_above_60_per_h=22.0 + 3 * (k % 4),
        )
        for k, (a, b) in enumerate(zip(starts, ends, strict=True))
    )


def _us(seconds: float) -> int:
    return round(seconds * MICROSECONDS)
