"""What people see of the pose: in the report, in results.json and on the command line."""

from dataclasses import replace
from pathlib import Path
from typing import Literal

import pytest

from app.batch.folder import Task
from app.batch.run import Outcome
from app.cli.output import format_question
from app.report.export.results import build_results, encode_results
from app.report.findings import (
    CalibrationFacts,
    Findings,
    PartFacts,
    QuestionFacts,
    RepeatFacts,
    StillFacts,
)
from app.report.model import Report, format_brief
from app.report.render.html import render_html
from app.request import ReportRequest
from app.web.pairs import align_request
from fusion.conventions import CalibrationState, PoseHeld
from fusion.recording import QualityFlag
from tests.app.analysis_factory import make_analysis, make_calibration, make_subject
from tests.app.report.report_reading import plain, report_of, section_of

BIAS_DPS = (0.31, -0.12, 0.07)
AGAIN = RepeatFacts(7242.0, 8.0, apart_deg=3.5)


def still_at(start_s: float) -> StillFacts:
    return StillFacts(start_s, 10.0)


def with_calibration(calibration: CalibrationFacts, *, slip_times_s: tuple[float, ...] = ()) -> Findings:
    return replace(make_analysis(), calibration=replace(calibration, slip_times_s=slip_times_s))


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
    findings = with_calibration(open_calibration())
    flags = (QualityFlag("W-WHICH-POSE", facts={"apart_deg": 34}),)
    return replace(findings, quality=replace(findings.quality, flags=flags, reasons=("W-WHICH-POSE",)))


def steps_of(findings: Findings) -> tuple[str, ...]:
    profile = report_of(analysis=findings).profile
    assert profile is not None
    return tuple(step.replace("’", "'") for step in profile.next_steps)


def told_of_method(report: Report) -> dict[str, str]:
    return {pair.name: plain(pair.value) for pair in section_of(report, "method").pairs}


def calibration_of(findings: Findings) -> dict[str, object]:
    calibration = build_results(findings, make_subject())["calibration"]
    assert isinstance(calibration, dict)
    return calibration


# The report.


def test_the_report_says_how_the_axis_was_found_and_how_sure_it_is() -> None:
    told = told_of_method(report_of())

    assert told["Axis of the arm"] == (
        "from the pose held at the start of wear, as the person who asked for the report stated"
    )
    assert told["Standard deviation of the axis"] == "5.0°"


def test_the_report_names_the_sensors_axis_and_no_pose() -> None:
    report = report_of(analysis=with_axis("-y"))

    told = told_of_method(report)
    assert "the sensor's −y axis, strapped along the arm" in told["Axis of the arm"]
    assert "Calibration pose" not in told
    assert "Calibration window" not in told


def test_an_axis_has_not_the_error_of_the_n_pose() -> None:
    assert report_of(analysis=with_axis("y")).pose_caution == ""


def test_every_pose_held_again_stands_with_its_time_and_its_angle() -> None:
    told = told_of_method(
        report_of(analysis=with_calibration(replace(make_calibration(), repeats=(AGAIN,), repeat_deg=3.5)))
    )

    assert told["Pose held again"] == "09:58:54 (3.5° from the first)"
    assert told["Largest angle between the poses"] == "3.5°"


def test_a_slip_that_a_person_reported_stands_with_its_time() -> None:
    told = told_of_method(report_of(analysis=with_calibration(make_calibration(), slip_times_s=(3600.0,))))

    assert told["Sensor slipped, as reported"] == "08:58:12"


def test_a_time_without_a_slip_stands_with_its_time() -> None:
    findings = with_calibration(replace(make_calibration(), no_slip_times_s=(3600.0,)))

    told = told_of_method(report_of(analysis=findings))

    assert told["No slip of the sensor, as reported"] == "08:58:12"


STATES = {
    "given": "given (07:58:54, 6.2\u202fs)",
    "held_at_start": "held at the start, as stated (07:58:54, 6.2\u202fs)",
    "assumed": "assumed (07:58:54, 6.2\u202fs), not confirmed",
    "none": "none found",
}


@pytest.mark.parametrize("state", STATES)
def test_page_1_and_the_answer_say_how_the_pose_is_known(state: CalibrationState) -> None:
    report = report_of(analysis=with_calibration(replace(make_calibration(), state=state)))

    assert plain(report.pose_state) == plain(f"Calibration pose: {STATES[state]}.")
    assert report.pose_state in format_brief(report).decode().splitlines()


def test_poses_that_agree_are_counted_with_their_largest_angle_rounded_up() -> None:
    repeated = replace(make_calibration(), state="repeated", repeats=(AGAIN, AGAIN), repeat_deg=3.2)

    told = report_of(analysis=with_calibration(repeated)).pose_state

    assert told == "Calibration pose: given 3 times, agreeing within 4°."


def test_given_poses_that_disagree_stand_with_their_times() -> None:
    given = replace(make_calibration(), state="given", repeats=(AGAIN,))

    told = report_of(analysis=with_calibration(given)).pose_state

    assert plain(told) == "Calibration pose: given (07:58:54, 6.2 s; 09:58:54, 8 s)."


def test_an_axis_is_stated_in_place_of_the_pose() -> None:
    assert report_of(analysis=with_axis("-y")).pose_state == "Calibration pose: sensor axis −y, as stated."


def test_ready_angles_have_no_pose_to_tell_of() -> None:
    report = report_of(analysis=make_analysis(calibrated=False))

    assert (report.pose_state, report.needs_pose) == ("", "")


def test_of_an_assumed_pose_the_first_step_is_to_confirm_it() -> None:
    assert steps_of(with_calibration(replace(make_calibration(), state="assumed")))[0] == (
        "Confirm the pose: was it held at 07:58:54?"
    )


def test_without_a_pose_the_first_step_is_to_give_one_or_the_axis() -> None:
    assert steps_of(with_calibration(replace(make_calibration(), state="none")))[0] == (
        "Give a time at which the arm hung still, or the sensor's axis along the arm."
    )


@pytest.mark.parametrize(
    ("kind", "step"),
    [
        ("slip", "Say whether the sensor slipped between 10:00 and 10:02."),
        ("put_back", "Say whether the sensor was put back in the same place at 10:02."),
    ],
)
def test_whether_the_sensor_moved_is_asked_as_a_step(kind: Literal["slip", "put_back"], step: str) -> None:
    question = QuestionFacts(kind, 7308.0, 7428.0, 23.0)

    assert steps_of(with_calibration(replace(make_calibration(), questions=(question,))))[0] == step


def with_flag(findings: Findings, flag: QualityFlag) -> Findings:
    return replace(findings, quality=replace(findings.quality, flags=(flag,)))


def test_a_pose_after_a_stated_slip_is_asked_for_as_a_step() -> None:
    left_out = QualityFlag("W-REMOUNT", spans_s=((7248.0, 7368.0), (7368.0, 20_000.0)))

    assert steps_of(with_flag(with_calibration(make_calibration()), left_out))[0] == (
        "Name a pose held after 10:00."
    )


def test_a_slip_after_which_a_pose_was_named_asks_for_nothing() -> None:
    left_out = QualityFlag("W-REMOUNT", spans_s=((7248.0, 7368.0),))

    steps = steps_of(with_flag(with_calibration(make_calibration()), left_out))

    assert not any(step.startswith("Name a pose") for step in steps)


def test_a_pose_that_was_not_held_as_stated_is_asked_for_as_the_first_step() -> None:
    assumed = with_calibration(replace(make_calibration(), state="assumed"))

    (step, *_) = steps_of(with_flag(assumed, QualityFlag("W-NOT-HELD")))

    assert plain(step) == (
        "Say when the pose was held: the arm was not still within 60 s of the start of wear."
    )


def test_a_report_that_needs_the_pose_says_so_before_every_figure() -> None:
    report = report_of(analysis=asked())
    page, answer = render_html(report).decode(), format_brief(report).decode()

    assert report.needs_pose == (
        "Needs the pose: was it held at 08:00:00, 08:02:00 or 08:05:00? These lie up to 34° apart. "
        "Ranges, where given, cover all of them."
    )
    assert page.index(report.needs_pose) < page.index('class="tiles"')
    assert '<p class="value"><small>Needs the pose</small> 32.5' in page
    assert answer.splitlines()[0] == f"{report.needs_pose} {report.pose_state}"
    assert steps_of(asked())[0] == "Say when the calibration pose was held."


def test_of_many_stretches_the_report_names_six() -> None:
    proposals = tuple(still_at(108.0 + 30.0 * k) for k in range(9))
    findings = with_calibration(replace(open_calibration(), proposals=proposals))

    told = report_of(analysis=findings).needs_pose

    assert told.count("08:0") == 6
    assert "08:02:30 or 3 more times?" in told


def test_candidates_that_agree_need_no_pose() -> None:
    agreeing = replace(open_calibration(), spread_deg=6.0, needs_pose=False)

    assert report_of(analysis=with_calibration(agreeing)).needs_pose == ""


def test_the_limits_say_that_a_slip_without_walking_cannot_be_seen() -> None:
    sensor, ready = report_of(), report_of(analysis=make_analysis(calibrated=False))

    assert "slips on the arm while nobody walks cannot be seen" in " ".join(sensor.limits.paragraphs)
    assert "slips" not in " ".join(ready.limits.paragraphs)


@pytest.mark.parametrize(
    ("state", "walking_deg", "note"),
    [
        ("given", 42.0, "In walking the arm hung 42° from this pose."),
        ("assumed", 42.0, "In walking the arm hung 42° from this pose."),
        (
            "axis",
            174.5,
            (
                "In walking the arm hung 174° from the axis that was given. "
                "Check which axis it was, and its sign."
            ),
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


def test_an_axis_that_was_given_stands_in_place_of_the_pose() -> None:
    told = calibration_of(with_axis("y"))

    names = ("pose", "start_s", "duration_s", "score", "axis", "sigma_deg")
    assert [told[name] for name in names] == [None, None, None, None, "y", 8.0]


def test_a_pose_held_again_says_how_far_it_lies_from_the_first() -> None:
    told = calibration_of(with_calibration(replace(make_calibration(), repeats=(AGAIN,))))

    assert told["repeats"] == [{"start_s": 7242.0, "duration_s": 8.0, "apart_deg": 3.5}]


def test_a_stretch_that_no_pose_reads_is_a_part() -> None:
    part = PartFacts(3600.0, 7242.0, valid=False, pose_index=None)

    told = calibration_of(with_calibration(replace(make_calibration(), parts=(part,))))

    assert told["parts"] == [{"start_s": 3600.0, "end_s": 7242.0, "valid": False, "pose_index": None}]


def test_what_is_not_known_of_the_pose_is_in_results_json() -> None:
    question = QuestionFacts("slip", 7200.0, 7320.0, apart_deg=23.0)
    told = calibration_of(
        with_calibration(
            replace(
                make_calibration(),
                state="assumed",
                proposals=(still_at(108.0),),
                spread_deg=11.5,
                questions=(question,),
            )
        )
    )

    assert [told[name] for name in ("state", "proposals", "spread_deg", "questions")] == [
        "assumed",
        [{"start_s": 108.0, "duration_s": 10.0}],
        11.5,
        [{"kind": "slip", "start_s": 7200.0, "end_s": 7320.0, "apart_deg": 23.0}],
    ]


# Two days, analysed alike.

WINDOWS_S = ((5.0, 15.0), (20.0, 30.0))


def test_a_day_analysed_like_one_without_a_pose_takes_its_axis_and_drops_the_windows() -> None:
    before = ReportRequest("a.gt3x", calibration_windows_s=WINDOWS_S)

    asked = align_request(before, ReportRequest("b.gt3x", arm_axis="+y"))

    assert (asked.file_name, asked.arm_axis, asked.calibration_windows_s) == ("a.gt3x", "+y", ())


def test_windows_of_two_points_are_no_poses_held_again() -> None:
    before = ReportRequest("a.gt3x", pose="two-point", calibration_windows_s=WINDOWS_S)

    assert align_request(before, ReportRequest("b.gt3x")).calibration_windows_s == ()


def test_windows_of_the_same_pose_are_kept() -> None:
    before = ReportRequest("a.gt3x", calibration_windows_s=WINDOWS_S)

    assert align_request(before, ReportRequest("b.gt3x")).calibration_windows_s == WINDOWS_S


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


def test_where_no_pose_was_held_at_the_start_the_candidates_are_left(tmp_path: Path) -> None:
    choices = format_question([outcome_of(asked(), tmp_path, "start")])[1:]

    assert len(choices) == 3
    assert all(choice.startswith("  --calibration") for choice in choices)


def test_of_several_recordings_the_command_line_asks_in_one_line(tmp_path: Path) -> None:
    outcomes = [outcome_of(asked(), tmp_path)] * 2

    assert format_question(outcomes) == ["If everyone held the pose at the start, add --pose-held start"]


def test_several_recordings_are_not_asked_about_what_was_said(tmp_path: Path) -> None:
    assert format_question([outcome_of(asked(), tmp_path, "start")] * 2) == []


@pytest.mark.parametrize("count", [1, 2])
def test_the_command_line_asks_nothing_where_the_pose_is_known(count: int, tmp_path: Path) -> None:
    assert format_question([outcome_of(make_analysis(), tmp_path)] * count) == []


def test_a_recording_without_a_clock_is_asked_about_in_elapsed_time(tmp_path: Path) -> None:
    findings = asked()
    clockless = replace(findings, recording=replace(findings.recording, start=None))

    assert "at 0:01:48" in format_question([outcome_of(clockless, tmp_path)])[2]
