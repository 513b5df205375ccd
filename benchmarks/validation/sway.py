"""Compare a table with a resting arm: the sway of every recorded still period."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.io import loadmat

from acromion.fusion.errors import FusionError
from acromion.fusion.pose.calibrate import (
    TABLE_SWAY_DPS,
    find_still_stretches,
    measure_stretch,
    measure_window,
    reduce_recording,
)
from acromion.fusion.readers import read_recording
from acromion.fusion.recording import Float64Array, Recording, Segment
from acromion.fusion.sensor.self_calibration import calibrate_accelerometer
from acromion.fusion.sensor.stillness import find_still_moments
from benchmarks.validation.document import Goal, Section, draw_table, judge
from benchmarks.validation.invariance import STANDARD_GRAVITY
from benchmarks.validation.real_clips import Clip, compute_readings, load_clip
from benchmarks.validation.skin_clips import load_skin_library
from tests.validation.broad import load_trials

DESKS = ("gt9x/*.gt3x", "gt9x/*.csv", "other_layouts/xio_seconds*.csv")
BODIES = ("upper_arm", "forearm", "hand", "upper_back", "lower_back", "hip", "head")
WINDOW_S, STEP_S, RATE_HZ = 3.0, 0.5, 100.0

PROSE = f"""\
The sway of a still period is the typical distance of the angular rate, averaged over quarter seconds, from
its median. With less than {TABLE_SWAY_DPS:g} deg/s a still period counts as a table and cannot be the pose.
*Desk*: real sensors at rest (GT9X, another logger, the rests of BROAD). *Body*: the still periods of a
standing person with 16 sensors (another model, 100 s). *Motion capture*: the calmest {WINDOW_S:g} s of each
clip with a rest, without sensor noise: plates on the skin of seated people; the 28 clips of walking and
working people have no rest. One person and a few clips are little evidence."""


def compare_sway(folder: Path) -> Section:
    """Return the sway of desks, worn sensors and recorded motion."""
    title = "A table and a resting arm"
    if not (folder / "upper_arm").is_dir():
        return Section(title, ("Skipped: upper_arm is missing.",))
    desks = [sway for recording in _read_desks(folder) for sway in _measure_stills(recording)]
    bodies = {part: list(_measure_body(folder, part)) for part in BODIES}
    library = load_skin_library(folder / "skin_motion", is_rigid=False)
    clips = [clip for every in library.values() for clip in every]
    clips += [load_clip(path, "l") for path in sorted((folder / "real_motion").glob("*.npz"))]
    calmest = [sway for sway in map(_find_calmest, clips) if np.isfinite(sway)]
    found = {"desk": desks, **{f"body: {part}": sways for part, sways in bodies.items()}}
    found["motion capture"] = calmest
    rows = [
        [name, str(len(sways)), f"{min(sways):.3f}", f"{np.median(sways):.3f}", f"{max(sways):.3f}"]
        for name, sways in found.items()
        if sways
    ]
    goals: list[Goal] = [
        judge("the desk that sways most, deg/s", max(desks), TABLE_SWAY_DPS),
        judge(
            "limit, against the upper arm that sways least, deg/s", TABLE_SWAY_DPS, min(bodies["upper_arm"])
        ),
    ]
    header = ("recorded", "stillnesses", "least deg/s", "median", "most")
    return Section(title, (PROSE, draw_table(header, rows)), tuple(goals))


def _read_desks(folder: Path) -> Iterator[Recording]:
    for path in (path for pattern in DESKS for path in sorted(folder.glob(pattern))):
        yield read_recording(path)
    for trial in load_trials(folder / "broad"):
        yield _record(trial.acc_g, trial.gyr_dps, trial.rate_hz)


def _measure_body(folder: Path, part: str) -> Iterator[float]:
    stored = loadmat(folder / "upper_arm" / "full_body_example_data.mat")
    for name in (name for name in stored if name.startswith(part)):
        worn = stored[name][0, 0]
        yield from _measure_stills(_record(worn["acc"] / STANDARD_GRAVITY, np.degrees(worn["gyr"]), RATE_HZ))


def _record(acc_g: Float64Array, gyr_dps: Float64Array, rate_hz: float) -> Recording:
    segment = Segment(0, rate_hz, acc_g.astype(np.float32), gyr_dps.astype(np.float32))
    return Recording("other", "0" * 64, None, None, segment.duration_us, (segment,))


def _measure_stills(recording: Recording) -> list[float]:
    blocks = reduce_recording(recording)
    stretches_s = find_still_stretches(blocks, calibrate_accelerometer(find_still_moments(blocks)))
    return [measure_stretch(recording, stretch_s).sway_dps for stretch_s in stretches_s]


def _find_calmest(clip: Clip) -> float:
    state = compute_readings(clip, RATE_HZ)
    recording = _record(state.acc_g, state.gyr_dps, RATE_HZ)
    last_s = len(state.acc_g) / RATE_HZ - WINDOW_S
    return min((_measure(recording, start_s) for start_s in np.arange(0.0, last_s, STEP_S)), default=np.inf)


def _measure(recording: Recording, start_s: float) -> float:
    """Return the sway of a window; infinite if it cannot be a pose."""
    try:
        return measure_window(recording, (start_s, start_s + WINDOW_S)).sway_dps
    except FusionError:
        return np.inf
