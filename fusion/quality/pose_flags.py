"""What is not known of the pose, and when the sensor may have moved on the arm."""

from collections.abc import Iterator, Mapping

from fusion.caveats import Caveat
from fusion.pose.calibrate import CalibratedSamples, Calibration
from fusion.pose.rules import RULES
from fusion.pose.windows import TABLE_SWAY_DPS, StillPeriod
from fusion.recording import MICROSECONDS, QualityFlag, flag_stretches
from fusion.settings import AnalysisSettings


def flag_pose(samples: CalibratedSamples, settings: AnalysisSettings) -> tuple[QualityFlag, ...]:
    """Return the caveats of a calibration."""
    return (*_flag_state(samples.calibration, settings), *_flag_moves(samples))


def flag_window(
    caveat: Caveat, still: StillPeriod, facts: Mapping[str, str | float] | None = None
) -> QualityFlag:
    """Return one flag for a calibration window, with its place."""
    return QualityFlag(caveat, 1, still.duration_s, still.start_s, still.end_s, dict(facts or {}))


def _flag_state(calibration: Calibration, settings: AnalysisSettings) -> Iterator[QualityFlag]:
    """Flag what is not known of the pose."""
    state, facts = calibration.state, {"deg": round(calibration.sigma_deg, 1)}
    if state in {"axis", "none"}:
        yield QualityFlag(Caveat.AXIS if state == "axis" else Caveat.NO_STILL, facts=facts)
    spans_s = [(still.start_s, still.end_s) for still in calibration.proposals]
    if calibration.needs_pose:
        yield flag_stretches(Caveat.WHICH_POSE, spans_s, {"apart_deg": round(calibration.spread_deg)})
    elif state == "assumed":
        yield flag_stretches(Caveat.POSE_ASSUMED, spans_s)
    if state == "assumed" and calibration.pose == "side-lean":  # nobody said that the trunk was leaning
        yield flag_window(Caveat.LEAN, calibration.windows[0])
    if state in {"assumed", "none"} and settings.pose_held == "start":
        yield QualityFlag(Caveat.NOT_HELD)
    for still in calibration.windows if state != "none" else ():
        if settings.calibration_windows_s and still.duration_s < RULES.length_s - 1e-6:
            yield flag_window(Caveat.POSE_SHORT, still)
        if still.is_moving or still.sway_dps < TABLE_SWAY_DPS:
            yield flag_window(Caveat.POSE_UNSTEADY, still, {"what": "moving" if still.is_moving else "table"})


def _flag_moves(samples: CalibratedSamples) -> Iterator[QualityFlag]:
    """Flag when the sensor may have moved, poses that disagree, and what a slip that was named left out."""
    questions = (*samples.calibration.questions, *samples.calibration.differ)
    codes = {"slip": Caveat.SLIP, "put_back": Caveat.PUT_BACK, "poses": Caveat.POSES_DIFFER}
    for kind, code in codes.items():
        asked = [question for question in questions if question.kind == kind]
        apart_deg = round(max((question.apart_deg for question in asked), default=0.0))
        if asked:
            spans_s = [(question.first_s, question.end_s) for question in asked]
            yield flag_stretches(code, spans_s, {"apart_deg": apart_deg} if apart_deg else {})
    end_s = samples.recording.duration_us / MICROSECONDS
    left_out = [
        (max(part.start_s, 0.0), min(part.end_s, end_s))
        for part in samples.axis_parts
        if part.arm_axis is None
    ]
    if left_out:
        yield flag_stretches(Caveat.REMOUNT, left_out)
