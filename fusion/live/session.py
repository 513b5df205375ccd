"""One person's session: frames in; angle, time above 60 deg, rises and losses so far out.

The angle is bit-identical to that of :class:`acromion.fusion.live.LiveElevation` with the session's axis. A
gap of at most 50 ms is bridged for the filter only, as in a file. A longer one ends the segment: the
direction is estimated again and the gyroscope's bias is kept. Nothing is counted in a gap or in the first 3 s
of a segment, where the filter has few samples (as in :func:`acromion.fusion.elevation.estimate_elevation`).
"""

from array import array
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import IO, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from acromion.fusion.elevation import Elevation, measure_elevation
from acromion.fusion.orientation.live import LiveParameters, LiveVertical
from acromion.fusion.pose.rules import RULES, window_rejection_reason
from acromion.fusion.readers.samples import open_rows
from acromion.fusion.recording import LONGEST_BRIDGE_US, MICROSECONDS, Float64Array, IntArray, Recording
from acromion.fusion.sensor.model import RADIANS, check_arrays, check_direction, check_gravity

# The angle alone, for other programs.


class LiveElevation:
    """Arm elevation for real-time feedback.

    Pass samples one at a time or in chunks of any size: the result does not depend on the chunks. Without
    ``arm_axis`` the arm is assumed to hang at the first still moment (the N-pose); until then the elevation
    is NaN.
    """

    def __init__(self, rate_hz: float, arm_axis: ArrayLike | None = None) -> None:
        """Reset the state; ``arm_axis``, shape (3,): unit vector towards the shoulder, in the sensor's frame.

        Raises UnusableArrays.
        """
        self._rate_hz = rate_hz
        self._vertical = LiveVertical(rate_hz)
        self._arm_axis: Float64Array | None = None if arm_axis is None else check_direction(arm_axis)

    def update(self, acc_g: ArrayLike, gyr_dps: ArrayLike) -> NDArray[np.float32]:
        """Process the next samples, shapes (n, 3) or (3,), g and deg/s; return their elevation, (n,), deg.

        A chunk may be empty. A rejected chunk changes nothing. At the first still moment the acceleration
        must be about 1 g long, which detects other units.

        Raises UnusableArrays.
        """
        acc, gyr = check_arrays(np.atleast_2d(acc_g), np.atleast_2d(gyr_dps), self._rate_hz)
        if self._arm_axis is not None:
            return measure_elevation(self._vertical.update(acc, gyr), self._arm_axis)
        return self._wait_for_rest(acc, gyr)

    @property
    def has_rested(self) -> bool:
        """Whether a still moment has determined the gyroscope's bias; until then the angle may drift."""
        return self._vertical.has_rested

    def _wait_for_rest(self, acc: NDArray[np.generic], gyr: NDArray[np.generic]) -> NDArray[np.float32]:
        """Process sample by sample, so that the arm axis is set at the same sample for any chunks."""
        waiting = np.full(len(acc), np.nan, dtype=np.float32)
        for row in range(len(acc)):
            up = self._vertical.update(acc[row], gyr[row])
            if self._vertical.has_rested:
                check_gravity(np.asarray(acc[row : row + 1], dtype=np.float64))
                self._arm_axis = up[0]
                waiting[row] = 0.0
                waiting[row + 1 :] = self.update(acc[row + 1 :], gyr[row + 1 :]) if row + 1 < len(acc) else []
                break
        return waiting


# A session.

HOLD_S = RULES.length_s
"""How long the pose is held."""
HYSTERESIS_DEG = 5.0
"""A rise starts this much above the threshold and ends this much below it, as in the report."""
RISE_DEG = 60.0
THRESHOLDS_DEG = (30.0, 60.0, 90.0)
SETTLE_S = LiveParameters().time_constant_s
HOLE_PERIODS = 1.5

PoseState = Literal["none", "countdown", "holding", "held"]
Samples = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class Frames:
    """Samples as they arrived.

    ``time_us``: shape (n,): the stream's clock, microseconds; starts at 0 and never goes back.
    ``counter``: shape (n,): increases by one for each measured sample; skipped values were lost.
    ``acc_g``, ``gyr_dps``: shape (n, 3), float32, one right-handed frame, g and deg/s.
    """

    time_us: IntArray
    counter: IntArray
    acc_g: Samples
    gyr_dps: Samples

    def __len__(self) -> int:
        return len(self.time_us)

    def cut(self, first: int, stop: int) -> "Frames":
        """Return the rows [first, stop)."""
        rows = slice(first, stop)
        return Frames(self.time_us[rows], self.counter[rows], self.acc_g[rows], self.gyr_dps[rows])


@dataclass(frozen=True, slots=True, eq=False)
class LiveRows:
    """The angle of each frame, shape (n,), NaN until an axis is known; ``valid``: whether it is counted."""

    time_us: IntArray
    elevation_deg: Samples
    valid: NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class LiveStatus:
    """The state of a session.

    ``elapsed_s``: from the first frame to the last, plus one period.
    ``elevation_deg``: of the last frame; None if not known.
    ``above_s``: seconds at or above each of :data:`THRESHOLDS_DEG`.
    ``counted_s``: seconds whose angle is counted.
    ``rises``: entries above 60 deg, hysteresis 5 deg on each side.
    ``frames``, ``lost``, ``holes``, ``missing_s``: frames received; frames that the counter skipped; number
    of gaps, and their total duration.
    ``has_rested``: whether a still moment has determined the gyroscope's bias.
    ``is_frame_doubtful``: whether gravity turns against the gyroscope (:class:`FrameWatch`): the angle is
    then wrong while the arm moves.
    ``pose``, ``pose_left_s``, ``pose_refused``, ``still_g``: state of the pose; seconds until it starts or
    has been held; why the last one was rejected (:func:`acromion.fusion.pose.rules.window_rejection_reason`,
    "hole"); the largest standard deviation of an accelerometer axis in the last second.
    """

    elapsed_s: float
    elevation_deg: float | None
    above_s: tuple[float, ...]
    counted_s: float
    rises: int
    frames: int
    lost: int
    holes: int
    missing_s: float
    has_rested: bool
    is_frame_doubtful: bool
    pose: PoseState
    pose_left_s: float
    pose_refused: str
    still_g: float


class LiveSession:
    """Processes frames in chunks of any size; the result does not depend on the chunks."""

    def __init__(self, rate_hz: float, arm_axis: ArrayLike | None = None) -> None:
        """Reset the state; ``arm_axis``, shape (3,): unit vector towards the shoulder, in the sensor's frame.

        Without it there is no angle until a pose has been held (:meth:`ask_pose`).

        Raises UnusableArrays.
        """
        self.rate_hz = rate_hz
        self.pose_window_s: tuple[float, float] | None = None
        self._period_us = MICROSECONDS / rate_hz
        self._vertical = LiveVertical(rate_hz)
        self._arm_axis: Float64Array | None = None if arm_axis is None else check_direction(arm_axis)
        self._settle_rows = round(SETTLE_S * rate_hz)
        self._segment_rows = 0
        self._first_us = 0
        self._last: Frames | None = None
        self._frames = self._lost = self._holes = 0
        self._missing_us = 0
        self._above_rows = [0] * len(THRESHOLDS_DEG)
        self._counted_rows = self._rises = 0
        self._is_above: bool | None = None
        self._elevation_deg = np.nan
        self._pose = _Pose()
        self._recent = np.empty((0, 3), np.float32)
        self._frame = FrameWatch(rate_hz)

    @property
    def arm_axis(self) -> Float64Array | None:
        """The axis in use."""
        return self._arm_axis

    def ask_pose(self, countdown_s: float = 5.0) -> None:
        """Ask for the pose: after a countdown the arm is held still for :data:`HOLD_S`.

        The current axis stays in use until a pose is accepted.
        """
        start_us = (int(self._last.time_us[-1]) if self._last else 0) + round(countdown_s * MICROSECONDS)
        self._pose = _Pose(start_us)

    def take(self, frames: Frames) -> LiveRows:
        """Process the next frames, in order.

        Raises UnusableArrays: values that are not finite, or other shapes; the state is then unchanged.
        """
        check_arrays(frames.acc_g, frames.gyr_dps, 1.0)
        elevation_deg = np.full(len(frames), np.nan, np.float32)
        valid = np.zeros(len(frames), np.bool_)
        if len(frames) == 0:
            return LiveRows(frames.time_us, elevation_deg, valid)
        if self._last is None:
            self._first_us = int(frames.time_us[0])
        for first, stop in self._find_runs(frames):
            run = frames.cut(first, stop)
            self._handle_gap(run)
            elevation_deg[first:stop], valid[first:stop] = self._fuse(run)
            self._count(elevation_deg[first:stop][valid[first:stop]])
            self._last = run.cut(len(run) - 1, len(run))
        self._frames += len(frames)
        self._elevation_deg = float(elevation_deg[-1]) if valid[-1] else np.nan
        self._recent = np.concatenate([self._recent, frames.acc_g])[-round(self.rate_hz) :]
        return LiveRows(frames.time_us, elevation_deg, valid)

    def status(self) -> LiveStatus:
        """Return the state of the session."""
        last_us = int(self._last.time_us[-1]) if self._last else self._first_us
        elapsed_us = last_us - self._first_us + self._period_us if self._last else 0.0
        pose, left_us = self._pose.describe(last_us, is_known=self._arm_axis is not None)
        still_g = float(self._recent.astype(np.float64).std(axis=0).max()) if len(self._recent) else 0.0
        return LiveStatus(
            elapsed_s=elapsed_us / MICROSECONDS,
            elevation_deg=None if np.isnan(self._elevation_deg) else self._elevation_deg,
            above_s=tuple(rows / self.rate_hz for rows in self._above_rows),
            counted_s=self._counted_rows / self.rate_hz,
            rises=self._rises,
            frames=self._frames,
            lost=self._lost,
            holes=self._holes,
            missing_s=self._missing_us / MICROSECONDS,
            has_rested=self._vertical.has_rested,
            is_frame_doubtful=self._frame.is_doubtful,
            pose=pose,
            pose_left_s=left_us / MICROSECONDS,
            pose_refused=self._pose.refused,
            still_g=still_g,
        )

    def _find_runs(self, frames: Frames) -> Iterator[tuple[int, int]]:
        """Yield rows [first, stop) without a gap between them, split where a pose ends."""
        steps_us = np.diff(frames.time_us)
        limit_us = LONGEST_BRIDGE_US + HOLE_PERIODS * self._period_us
        is_cut = (np.diff(frames.counter) != 1) | (steps_us > limit_us)
        edges = {0, *(np.flatnonzero(is_cut) + 1).tolist(), len(frames)}
        if self._pose.is_open:
            edges.add(int(np.searchsorted(frames.time_us, self._pose.end_us)))
        yield from pairwise(sorted(edges))

    def _handle_gap(self, run: Frames) -> None:
        """Handle the gap between the last frame and this run."""
        if self._last is None:
            return
        step_us = int(run.time_us[0] - self._last.time_us[0])
        lost = max(0, int(run.counter[0] - self._last.counter[0]) - 1)
        if not lost and step_us <= LONGEST_BRIDGE_US + HOLE_PERIODS * self._period_us:
            return
        self._lost += lost
        self._holes += 1
        self._frame.break_off()
        self._missing_us += max(0, round(step_us - self._period_us))
        if lost and step_us <= LONGEST_BRIDGE_US:
            self._bridge(self._last, run, lost)
            return
        bias_dps = self._vertical.bias_dps if self._vertical.has_rested else None
        self._vertical = LiveVertical(self.rate_hz, bias_dps)
        self._segment_rows, self._is_above = 0, None
        self._pose.break_off(int(self._last.time_us[0] + HOLE_PERIODS * self._period_us))

    def _bridge(self, last: Frames, run: Frames, lost: int) -> None:
        """Pass interpolated rows to the filter, as the reader does in a file's segment."""
        between = []
        for before, after in ((last.acc_g, run.acc_g), (last.gyr_dps, run.gyr_dps)):
            rows = np.zeros((lost + 2, 3), np.float32)
            rows[0], rows[1] = before[0], after[0]
            open_rows(rows, 2, np.array([1]), np.array([lost]))
            between.append(rows[1:-1])
        self._vertical.update(*between)
        self._segment_rows += lost

    def _fuse(self, run: Frames) -> tuple[Samples, NDArray[np.bool_]]:
        self._end_pose(int(run.time_us[0]))
        self._pose.take(run)
        self._frame.take(run.acc_g, run.gyr_dps)
        up = self._vertical.update(run.acc_g, run.gyr_dps)
        is_settled = np.arange(self._segment_rows, self._segment_rows + len(run)) >= self._settle_rows
        self._segment_rows += len(run)
        if self._arm_axis is None:
            return np.full(len(run), np.nan, np.float32), np.zeros(len(run), np.bool_)
        elevation_deg = measure_elevation(up, self._arm_axis)
        return elevation_deg, is_settled & np.isfinite(elevation_deg)

    def _end_pose(self, now_us: int) -> None:
        """Check the pose when its time is over; an accepted pose sets the axis from here on."""
        if not self._pose.is_open or now_us < self._pose.end_us:
            return
        axis = self._pose.judge()
        if axis is not None:
            self._arm_axis = axis
            self._is_above = None
            first_us, end_us = self._pose.start_us - self._first_us, self._pose.end_us - self._first_us
            self.pose_window_s = (first_us / MICROSECONDS, end_us / MICROSECONDS)

    def _count(self, elevation_deg: Samples) -> None:
        if len(elevation_deg) == 0:
            return
        self._counted_rows += len(elevation_deg)
        for place, threshold_deg in enumerate(THRESHOLDS_DEG):
            self._above_rows[place] += int(np.count_nonzero(elevation_deg >= threshold_deg))
        high, low = elevation_deg > RISE_DEG + HYSTERESIS_DEG, elevation_deg < RISE_DEG - HYSTERESIS_DEG
        if self._is_above is None:
            self._is_above = bool(high[0])
        states = np.concatenate([[self._is_above], high[high | low]])
        self._rises += int(np.count_nonzero(~states[:-1] & states[1:]))
        self._is_above = bool(states[-1])


# Check from the motion whether gyroscope and accelerometer share one right-handed frame.
#
# Seen from a turning sensor, gravity turns backwards: ``da/dt = -(w x a)``. In a left-handed frame it turns
# forwards, and the live angle is wrong while the arm moves. The same equation corrects a file
# (:mod:`acromion.fusion.checks.physics`); a stream is only flagged.

BLOCK_S = 0.1
SLOWEST_DPS = 20.0
NEAR_1_G = 0.25
ENOUGH_G2 = 0.5
"""Sum of squares of the rotated gravity: about five seconds at 60 deg/s."""
LARGEST_SLOPE = -0.5
"""Gravity turning as predicted has the slope 1, in a left-handed frame -1."""
LEAST_EXPLAINED = 0.5
"""Share of the observed rotation that the reversed frame must explain: violent movement turns gravity in any
direction, but not consistently.
"""


class FrameWatch:
    """Compares the rotation of gravity with the gyroscope's prediction, in blocks of 0.1 s."""

    def __init__(self, rate_hz: float) -> None:
        self._rows = max(2, round(BLOCK_S * rate_hz))
        self._block_s = self._rows / rate_hz
        self._gathered = np.empty((0, 6))
        self._before: Float64Array | None = None
        self._agreed_g2 = self._foreseen_g2 = self._seen_g2 = 0.0

    @property
    def is_doubtful(self) -> bool:
        """Whether there was enough motion, and gravity turned in the opposite direction."""
        if self._foreseen_g2 < ENOUGH_G2 or self._agreed_g2 > LARGEST_SLOPE * self._foreseen_g2:
            return False
        return self._agreed_g2**2 > LEAST_EXPLAINED * self._foreseen_g2 * self._seen_g2

    def take(self, acc_g: Samples, gyr_dps: Samples) -> None:
        """Process the next samples of one unbroken run, shapes (n, 3)."""
        self._gathered = np.concatenate([self._gathered, np.hstack([acc_g, gyr_dps]).astype(np.float64)])
        whole = len(self._gathered) // self._rows
        blocks = self._gathered[: whole * self._rows].reshape(whole, self._rows, 6).mean(axis=1)
        self._gathered = self._gathered[whole * self._rows :]
        for block in blocks:
            if self._before is not None:
                self._compare(self._before, block)
            self._before = block

    def break_off(self) -> None:
        """Record a gap: the next samples do not continue the last ones."""
        self._gathered, self._before = np.empty((0, 6)), None

    def _compare(self, before: Float64Array, after: Float64Array) -> None:
        middle = 0.5 * (before + after)
        rate_dps, gravity_g = middle[3:], middle[:3]
        if np.linalg.norm(rate_dps) < SLOWEST_DPS or abs(np.linalg.norm(gravity_g) - 1.0) > NEAR_1_G:
            return
        foreseen_g = -np.cross(RADIANS * rate_dps, gravity_g) * self._block_s
        seen_g = after[:3] - before[:3]
        self._agreed_g2 += float(foreseen_g @ seen_g)
        self._seen_g2 += float(seen_g @ seen_g)
        self._foreseen_g2 += float(foreseen_g @ foreseen_g)


class _Pose:
    """The window in which a person holds the pose, and its samples."""

    def __init__(self, start_us: int | None = None) -> None:
        self.refused = ""
        self.is_open = start_us is not None
        self.start_us = start_us or 0
        self.end_us = self.start_us + round(HOLD_S * MICROSECONDS)
        self._is_broken = False
        self._acc: list[Samples] = []
        self._gyr: list[Samples] = []

    def take(self, run: Frames) -> None:
        if self.is_open:
            inside = run.time_us >= self.start_us
            self._acc.append(run.acc_g[inside])
            self._gyr.append(run.gyr_dps[inside])

    def break_off(self, from_us: int) -> None:
        """Record a gap from ``from_us`` on, longer than a bridge: it breaks a window that has started."""
        self._is_broken |= self.is_open and self.start_us < from_us < self.end_us

    def judge(self) -> Float64Array | None:
        """Return the axis; None if the window is rejected, by the rules for files."""
        self.is_open = False
        acc, gyr = (np.concatenate([*rows, np.empty((0, 3), np.float32)]) for rows in (self._acc, self._gyr))
        self._acc, self._gyr = [], []
        if self._is_broken or len(acc) == 0:
            self.refused = "hole"
            return None
        gravity_g = acc.mean(axis=0, dtype=np.float64)
        acc_sd_g, gyro_sd_dps = (float(rows.astype(np.float64).std(axis=0).max()) for rows in (acc, gyr))
        self.refused = window_rejection_reason(HOLD_S, acc_sd_g, gravity_g, gyro_sd_dps)
        return None if self.refused else np.asarray(gravity_g / np.linalg.norm(gravity_g))

    def describe(self, now_us: int, *, is_known: bool) -> tuple[PoseState, float]:
        """Return the state, and the microseconds until it changes."""
        if not self.is_open:
            return ("held" if is_known else "none"), 0.0
        if now_us < self.start_us:
            return "countdown", float(self.start_us - now_us)
        return "holding", float(self.end_us - now_us)


def replay_frames(recording: Recording, chunk_s: float) -> Iterator[Frames]:
    """Replay a recording in chunks, as a sensor would send its frames.

    The counter skips rows that the file lost; rows that bridge a gap of the file are not sent.
    """
    counter = 0
    reached_us = 0
    for segment in recording.segments:
        period_us = MICROSECONDS / segment.rate_hz
        counter += max(0, round((segment.start_us - reached_us) / period_us)) if counter else 0
        is_sent = np.ones(len(segment), np.bool_)
        for first, stop in segment.bridged:
            is_sent[first:stop] = False
        step = max(1, round(chunk_s * segment.rate_hz))
        for first in range(0, len(segment), step):
            rows = np.arange(first, min(first + step, len(segment)))
            rows = rows[is_sent[rows]]
            time_us = segment.start_us + np.rint(rows * period_us).astype(np.int64)
            yield Frames(time_us, counter + rows, segment.acc_g[rows], segment.gyr_dps[rows])
        counter += len(segment)
        reached_us = segment.end_us


# The difference between the live angle and that of the later report.

KEPT_HZ = 10.0
"""Rate at which the shown angle is stored: 8 h take 3.5 MB."""


class ShownAngles:
    """The angles of a session, thinned to :data:`KEPT_HZ`."""

    def __init__(self) -> None:
        self._time_us = array("q")
        self._angle_deg = array("f")
        self._next_us = 0

    def keep(self, rows: LiveRows) -> None:
        """Store the rows of the next frames."""
        step_us = round(MICROSECONDS / KEPT_HZ)
        for row in np.flatnonzero(rows.valid & (rows.time_us >= self._next_us)).tolist():
            time_us = int(rows.time_us[row])
            if time_us >= self._next_us:
                self._time_us.append(time_us)
                self._angle_deg.append(float(rows.elevation_deg[row]))
                self._next_us = time_us - time_us % step_us + step_us

    def write(self, file: IO[bytes]) -> None:
        """Write the times, and then the angles, for :meth:`load`."""
        file.write(self._time_us.tobytes() + self._angle_deg.tobytes())

    @classmethod
    def load(cls, content: bytes) -> Self:
        """Return the angles that :meth:`write` has written."""
        shown = cls()
        rows = len(content) // (shown._time_us.itemsize + shown._angle_deg.itemsize)
        shown._time_us.frombytes(content[: rows * shown._time_us.itemsize])
        shown._angle_deg.frombytes(content[rows * shown._time_us.itemsize :])
        return shown

    def read(self) -> tuple[Float64Array, Float64Array]:
        """Return the times, s, and the angles, deg, shapes (n,)."""
        return np.array(self._time_us) / MICROSECONDS, np.array(self._angle_deg, np.float64)


@dataclass(frozen=True, slots=True)
class LiveDifference:
    """Live angle compared with the report, at the same moments.

    ``compared_s``: seconds at which both are known.
    ``rmse_deg``, ``bias_deg``: root mean square and mean of live minus report.
    ``live_percent``, ``report_percent``: shares of that time below 30 deg, from 30, from 60 and from 90 deg
    on.
    """

    compared_s: float
    rmse_deg: float
    bias_deg: float
    live_percent: tuple[float, ...]
    report_percent: tuple[float, ...]


def compare_shown(shown: ShownAngles, elevation: Elevation) -> LiveDifference | None:
    """Compare the shown angle with the nearest row of the report; None if no moment has both."""
    time_s, live_deg = shown.read()
    report_deg = np.full(len(time_s), np.nan)
    for segment in elevation.segments:
        rows = np.rint((time_s - segment.start_us / MICROSECONDS) * segment.rate_hz).astype(np.int64)
        inside = (rows >= 0) & (rows < len(segment))
        angle_deg = np.where(segment.valid, segment.elevation_deg, np.nan)
        report_deg[inside] = angle_deg[rows[inside]]
    both = np.isfinite(report_deg)
    if not both.any():
        return None
    live_deg, report_deg = live_deg[both], report_deg[both]
    error_deg = live_deg - report_deg
    return LiveDifference(
        float(both.sum() / KEPT_HZ),
        float(np.sqrt(np.mean(error_deg**2))),
        float(error_deg.mean()),
        _divide(live_deg),
        _divide(report_deg),
    )


def _divide(angle_deg: Float64Array) -> tuple[float, ...]:
    edges_deg = (-np.inf, *THRESHOLDS_DEG, np.inf)
    return tuple(
        100.0 * float(np.mean((angle_deg >= low) & (angle_deg < high))) for low, high in pairwise(edges_deg)
    )
