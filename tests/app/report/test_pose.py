"""What people see of the pose: in the report, in results.json and on the command line."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from acromion.app.batch.folder import Task
from acromion.app.batch.run import Outcome
from acromion.app.cli.output import format_question
from acromion.app.http.pages.pairs import align_request
from acromion.app.report.export.results import encode_results
from acromion.app.report.findings import (
    CalibrationFacts,
    Findings,
    QuestionFacts,
    RepeatFacts,
    StillFacts,
    build_findings,
)
from acromion.app.report.model import Report, format_brief
from acromion.app.report.render.html import render_html
from acromion.app.request import ReportRequest
from acromion.fusion.conventions import CalibrationState, PoseHeld
from acromion.fusion.pipeline import analyse
from acromion.fusion.pose.wear import Question
from acromion.fusion.recording import QualityFlag, Recording, Segment
from acromion.fusion.simulation.shift import simulate_shift
from tests.app.analysis_factory import make_analysis, make_calibration, make_subject
from tests.app.report.report_reading import plain, report_of, section_of
from tests.simulated_shifts import play_shift

BIAS_DPS = (0.31, -0.12, 0.07)
AGAIN = RepeatFacts(7242.0, 8.0, apart_deg=3.5)


def still_at(start_s: float) -> StillFacts:
    return StillFacts(start_s, 10.0)


def with_calibration(calibration: CalibrationFacts, *flags: QualityFlag) -> Findings:
    findings = replace(make_analysis(), calibration=calibration)
    return replace(findings, quality=replace(findings.quality, flags=flags or findings.quality.flags))


def with_pose(*flags: QualityFlag, **changes: Any) -> Findings:
    """The findings of the shift, whose pose is known otherwise."""
    return with_calibration(replace(make_calibration(), **changes), *flags)


def with_axis(axis: str) -> Findings:
    return with_calibration(CalibrationFacts(None, "axis", 8.0, None, None, None, BIAS_DPS, axis=axis))


def open_calibration() -> CalibrationFacts:
    """Nobody said which of three stretches was the pose; the first is in use, another lies 34 deg away."""
    first, *others = (still_at(start_s) for start_s in (108.0, 228.0, 408.0))
    known = replace(make_calibration(), state="assumed", proposals=(first, *others))
    return replace(
        known, start_s=first.start_s, duration_s=first.duration_s, spread_deg=34.2, needs_pose=True
    )


def asked() -> Findings:
    """The findings of such a recording."""
    findings = with_calibration(open_calibration(), QualityFlag("W-WHICH-POSE", facts={"apart_deg": 34}))
    return replace(findings, quality=replace(findings.quality, reasons=("W-WHICH-POSE",)))


def steps_of(findings: Findings) -> tuple[str, ...]:
    profile = report_of(analysis=findings).profile
    assert profile is not None
    return tuple(step.replace("’", "'") for step in profile.next_steps)


def told_of_method(report: Report) -> dict[str, str]:
    return {pair.name: plain(pair.value) for pair in section_of(report, "full-method").pairs}


# The report.


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        (
            {},
            {
                "Arm axis": "from the pose held at the start of wear, "
                "as stated by the person who requested the report",
                "Standard deviation of the axis": "5.0°",
            },
        ),
        (
            {"repeats": (AGAIN,), "repeat_deg": 3.5},
            {"Pose held again": "09:58:54 (3.5° from the first)", "Largest angle between the poses": "3.5°"},
        ),
        ({"slip_times_s": (3600.0,)}, {"Sensor slipped, as stated": "08:58:12"}),
        ({"no_slip_times_s": (3600.0,)}, {"No sensor slip, as stated": "08:58:12"}),
    ],
    ids=["axis", "held again", "slip", "no slip"],
)
def test_the_chapter_on_the_method_says_what_is_known_of_the_pose(
    changes: dict[str, Any], told: dict[str, str]
) -> None:
    assert told.items() <= told_of_method(report_of(analysis=with_pose(**changes))).items()


def test_the_report_names_the_sensors_axis_and_no_pose() -> None:
    report = report_of(analysis=with_axis("-y"))

    told = told_of_method(report)
    assert "the sensor's −y axis, strapped along the arm" in told["Arm axis"]
    assert "Calibration pose" not in told
    assert "Calibration window" not in told
    assert report.pose_caution == ""  # an axis does not have the error of the N-pose


@pytest.mark.parametrize(
    ("findings", "told"),
    [
        (with_pose(state="given"), "stated by the user (07:58:54, 6.2 s)"),
        (with_pose(state="held_at_start"), "held at the start, as stated (07:58:54, 6.2 s)"),
        (with_pose(state="assumed"), "assumed (07:58:54, 6.2 s), not confirmed"),
        (with_pose(state="none"), "none found"),
        (
            with_pose(state="repeated", repeats=(AGAIN, AGAIN), repeat_deg=3.2),  # rounded up
            "stated by the user 3 times, agreeing within 4°",
        ),
        (with_pose(state="given", repeats=(AGAIN,)), "stated by the user (07:58:54, 6.2 s; 09:58:54, 8 s)"),
        (with_axis("-y"), "sensor axis −y, as stated"),
    ],
    ids=["given", "at the start", "assumed", "none", "agreeing", "disagreeing", "axis"],
)
def test_page_1_and_the_answer_say_how_the_pose_is_known(findings: Findings, told: str) -> None:
    report = report_of(analysis=findings)

    error = "; may read up to 15° low" if report.pose_caution else ""
    assert plain(report.pose_state) == f"Calibration pose: {told}{error}."
    assert report.pose_state in format_brief(report).decode().splitlines()


MOVED_S = (7308.0, 7428.0, 23.0)


def test_a_question_keeps_its_kind_both_times_and_the_angle() -> None:
    day = play_shift(simulate_shift("gt9x", 0.05, seed=3))
    segment = Segment(0, day.rate_hz, day.acc_g, day.gyr_dps)
    found = analyse(Recording("gt9x", "0" * 64, day.start, None, segment.duration_us, (segment,)))
    assert found.calibration is not None
    asking = replace(found.calibration, questions=(Question("slip", *MOVED_S),))

    calibration = build_findings(replace(found, calibration=asking)).calibration

    assert calibration is not None
    assert calibration.questions == (QuestionFacts("slip", *MOVED_S),)


@pytest.mark.parametrize(
    ("findings", "step"),
    [
        (with_pose(state="assumed"), "Confirm the pose: was it held at 07:58:54?"),
        (
            with_pose(state="none"),
            "Enter a time when the arm hung still, or the sensor axis along the arm.",
        ),
        (
            with_pose(questions=(QuestionFacts("slip", *MOVED_S),)),
            "State whether the sensor slipped between 10:00 and 10:02.",
        ),
        (
            with_pose(questions=(QuestionFacts("put_back", *MOVED_S),)),
            "State whether the sensor was put back in the same place at 10:02.",
        ),
        (
            with_pose(QualityFlag("W-REMOUNT", spans_s=((7248.0, 7368.0), (7368.0, 20_000.0)))),
            "Enter a pose held after 10:00.",
        ),
        (
            with_pose(QualityFlag("W-NOT-HELD"), state="assumed"),
            "State when the pose was held: the arm was not still within 60 s of the start of wear.",
        ),
        (asked(), "State when the pose was held."),
    ],
    ids=["assumed", "none", "slip", "put back", "after a slip", "not held", "open"],
)
def test_what_is_not_known_of_the_pose_is_the_first_step(findings: Findings, step: str) -> None:
    assert plain(steps_of(findings)[0]) == step


def test_a_slip_after_which_a_pose_was_named_asks_for_nothing() -> None:
    steps = steps_of(with_pose(QualityFlag("W-REMOUNT", spans_s=((7248.0, 7368.0),))))

    assert not any(step.startswith("Enter a pose") for step in steps)


def test_ready_angles_and_candidates_that_agree_need_no_pose() -> None:
    ready = report_of(analysis=make_analysis(calibrated=False))
    agreeing = with_calibration(replace(open_calibration(), spread_deg=6.0, needs_pose=False))

    assert (ready.pose_state, ready.needs_pose, report_of(analysis=agreeing).needs_pose) == ("", "", "")


def test_a_report_that_needs_the_pose_says_so_before_every_figure() -> None:
    report = report_of(analysis=asked())
    page, answer = render_html(report).decode(), format_brief(report).decode()

    assert report.needs_pose == (
        "When was the calibration pose held: 08:00:00, 08:02:00 or 08:05:00? "
        "These positions differ by up to 34°. Any ranges cover all of them."
    )
    assert page.index(report.needs_pose) < page.index('class="tiles"')
    assert '<p class="value"><small>Needs the pose</small> 32.5' in page
    assert answer.splitlines()[0] == f"{report.needs_pose} {report.pose_state}"


def test_of_many_stretches_the_report_names_six() -> None:
    proposals = tuple(still_at(108.0 + 30.0 * k) for k in range(9))
    findings = with_calibration(replace(open_calibration(), proposals=proposals))

    told = report_of(analysis=findings).needs_pose

    assert told.count("08:0") == 6
    assert "08:02:30 or 3 more times?" in told


def test_the_limits_say_that_a_slip_without_walking_cannot_be_seen() -> None:
    sensor, ready = report_of(), report_of(analysis=make_analysis(calibrated=False))

    assert "slip shows only if the wearer walked before and after it" in " ".join(sensor.limits.paragraphs)
    assert "slip" not in " ".join(ready.limits.paragraphs)


@pytest.mark.parametrize(
    ("state", "walking_deg", "note"),
    [
        ("given", 42.0, "While walking, the arm hung 42° from this pose."),
        ("assumed", 42.0, "While walking, the arm hung 42° from this pose."),
        (
            "axis",
            174.5,
            ("While walking, the arm hung 174° from the stated axis. Check which axis it was, and its sign."),
        ),
        ("given", 30.0, ""),
        ("given", None, ""),
        ("none", 42.0, ""),
    ],
)
def test_walking_beyond_30_deg_of_the_axis_is_noted(
    state: CalibrationState, walking_deg: float | None, note: str
) -> None:
    calibration = replace(make_calibration(), state=state, walking_apart_deg=walking_deg)

    assert report_of(analysis=with_calibration(calibration)).walking_note == note


# results.json and the stored findings.


# Two days, analysed alike.


@pytest.mark.parametrize(
    ("like", "kept"),
    [({}, True), ({"arm_axis": "+y"}, False), ({"pose": "two-point"}, False)],
    ids=["same pose", "axis", "two points"],
)
def test_a_day_analysed_like_another_keeps_its_windows_only_for_the_same_pose(
    like: dict[str, Any], kept: bool
) -> None:
    windows_s = ((5.0, 15.0), (20.0, 30.0))
    pose = like.pop("pose", "n-pose")

    day = align_request(
        ReportRequest("a.gt3x", pose=pose, calibration_windows_s=windows_s), ReportRequest("b.gt3x", **like)
    )

    assert (day.file_name, day.arm_axis) == ("a.gt3x", like.get("arm_axis"))
    assert day.calibration_windows_s == (windows_s if kept else ())


# The command line.


def outcome_of(findings: Findings, folder: Path, pose_held: PoseHeld | None = None) -> Outcome:
    (folder / "results.json").write_bytes(encode_results(findings, make_subject()))
    request = ReportRequest("shift.gt3x", languages=("en",), pose_held=pose_held)
    return Outcome(Task(Path("shift.gt3x"), request, folder))


def test_the_command_line_asks_with_the_option_that_answers(tmp_path: Path) -> None:
    question, *choices = format_question([outcome_of(asked(), tmp_path)])

    assert question.startswith("shift.gt3x: which one was the calibration pose?")
    assert choices == [
        "  --pose-held start   held at the start of wear",
        "  --calibration 108.00,118.00   the arm held still at 08:00:00 (in use)",
        "  --calibration 228.00,238.00   the arm held still at 08:02:00",
        "  --calibration 408.00,418.00   the arm held still at 08:05:00",
    ]


def test_for_a_shift_that_was_cut_out_the_answer_is_a_row_of_the_diary(tmp_path: Path) -> None:
    """Seconds of --calibration count from the start of the file."""
    outcome = outcome_of(asked(), tmp_path, "start")
    request = replace(outcome.task.request, shift="2026-03-02T08:00:00/2026-03-02T09:00:00")

    choices = format_question([replace(outcome, task=replace(outcome.task, request=request))])[1:]

    row = "2026-03-03 08:02:00.000-05:00,2026-03-03 08:02:10.000-05:00,pose"
    assert choices[1] == f"  --diary with the row {row}   the arm held still at 08:02:00"


def test_if_no_pose_was_held_at_the_start_the_candidates_are_left(tmp_path: Path) -> None:
    choices = format_question([outcome_of(asked(), tmp_path, "start")])[1:]

    assert [choice[:15] for choice in choices] == ["  --calibration"] * 3


@pytest.mark.parametrize(
    ("pose_held", "question"),
    [(None, ["If everyone held the pose at the start, add --pose-held start"]), ("start", [])],
)
def test_of_several_recordings_the_command_line_asks_in_one_line_what_was_not_said(
    tmp_path: Path, pose_held: PoseHeld | None, question: list[str]
) -> None:
    assert format_question([outcome_of(asked(), tmp_path, pose_held)] * 2) == question


def test_the_command_line_asks_nothing_if_the_pose_is_known(tmp_path: Path) -> None:
    known = outcome_of(make_analysis(), tmp_path)

    assert [format_question([known] * count) for count in (1, 2)] == [[], []]


def test_a_recording_without_a_clock_is_asked_about_in_elapsed_time(tmp_path: Path) -> None:
    findings = asked()
    clockless = replace(findings, recording=replace(findings.recording, start=None))

    assert "at 0:01:48" in format_question([outcome_of(clockless, tmp_path)])[2]
