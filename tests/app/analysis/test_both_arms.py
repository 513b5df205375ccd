"""Both arms of one shift on one clock: the figures over the shared time, and what is not known."""

import io
import json
import re
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pypdf import PdfReader

from acromion.app.analysis.pair import (
    find_offset_s,
    make_report_of_two,
    pair_analyses,
    read_analysed,
    widen_unconfirmed,
)
from acromion.app.errors import CannotPair
from acromion.app.report.export.angles import write_elevation
from acromion.app.report.export.results import encode_results
from acromion.app.report.findings import FinishedAnalysis
from acromion.app.report.model import Report, format_brief
from acromion.app.report.pairs import ArmPair, OnePerson, PairClock, build_pair, describe_pair
from acromion.app.report.render.pdf import render_pdf
from acromion.app.report.words.wording import LANGUAGES, Language
from acromion.app.request import PairRequest
from acromion.fusion.comparison.arms import ArmShare, PairedArms, TrunkRelative, pair_arms
from acromion.fusion.comparison.movement import ClockMatch
from acromion.fusion.conventions import MethodName
from acromion.fusion.elevation import Elevation, ElevationSegment
from acromion.fusion.exposure.types import Interval
from acromion.fusion.recording import Span
from tests.app.analysis_factory import START, make_analysis, make_exposure, make_subject
from tests.app.report.report_reading import plain, section_of

NO_TRUNK = TrunkRelative("no trunk sensor")
SHARED = PairedArms(
    3600.0,
    ArmShare({10: 5.0, 50: 20.0, 90: 40.0, 99: 80.0}, {30: 30.0, 60: 4.0, 90: 1.0}),
    ArmShare({10: 6.0, 50: 30.0, 90: 60.0, 99: 100.0}, {30: 50.0, 60: 10.0, 90: 3.0}),
    2.5,
    2.5,
    1.5,
)


def kept_of(
    side: str, start: datetime | None = START, sha256: str = "", subject: str = "S012"
) -> FinishedAnalysis:
    findings = make_analysis(start=start)
    recording = replace(findings.recording, sha256=sha256 or side * 8)
    return FinishedAnalysis(replace(findings, recording=recording), make_subject(subject, side=side))


def make_pair(offset_s: float = 0.0, trunk: TrunkRelative = NO_TRUNK) -> ArmPair:
    return ArmPair(kept_of("left"), kept_of("right"), PairClock(offset_s, "clocks"), SHARED, (trunk, trunk))


def report_of(pair: ArmPair, language: Language = "en") -> Report:
    return build_pair(pair, language)


def keep(
    folder: Path, side: str, angle_deg: float = 40.0, *, method: MethodName = "smoothed", **known: Any
) -> Path:
    """Leave a finished analysis of 60 s at one angle."""
    folder.mkdir()
    kept = kept_of(side, **known)
    assert kept.findings.method is not None
    findings = replace(kept.findings, exclusions=(), method=replace(kept.findings.method, name=method))
    (folder / "results.json").write_bytes(encode_results(findings, kept.subject))
    angles = np.full(6000, angle_deg, np.float32)
    segment = ElevationSegment(0, 100.0, angles, np.ones(6000, bool))
    write_elevation(Elevation((segment,), None), folder / "elevation.parquet")
    return folder


Changes = tuple[dict[str, Any], ...]
"""What is known otherwise of the left arm, the right arm and, if there is a third, the trunk."""


def keep_arms(folder: Path, changes: Changes = ({}, {})) -> tuple[Path, ...]:
    sides: tuple[dict[str, Any], ...] = (
        {"side": "left", "angle_deg": 40.0},
        {"side": "right", "angle_deg": 70.0},
        {"side": "trunk", "angle_deg": 15.0},
    )
    return tuple(
        keep(folder / name, **(side | more)) for name, side, more in zip("lrt", sides, changes, strict=False)
    )


def code(*codes: str) -> Changes:
    return tuple({"subject": each} for each in codes)


def pair(folder: Path, folders: tuple[Path, ...], *asked: Any, **more: Any) -> dict[str, Any]:
    """Return the document of the report of two."""
    request = PairRequest("pair", *asked, **({"languages": ("en",), "kinds": ()} | more))
    make_report_of_two(folders, request, folder)
    document: dict[str, Any] = json.loads((folder / "pair.json").read_bytes())
    return document


RANGED = replace(
    SHARED,
    intervals={
        "left_time_above_60_percent": Interval(2.5, 6.0),
        "right_to_left_time_above_60": Interval(1.2, 4.125),
        "both_above_60_percent": Interval(1.0, 4.5),
    },
)


def test_the_ranges_stand_behind_the_figures_under_those_of_the_table_and_in_the_document() -> None:
    pair = replace(make_pair(), shared=RANGED)
    report = report_of(pair)
    sentences, rows = [plain(s) for s in report.sentences], section_of(report, "figures").tables[0].rows

    assert "above 60° for 4.0 % (2.5–6.0 %) and the right arm for 10.0 % of" in sentences[0]
    assert "(right/left ratio 2.50, range 1.20–4.12)" in sentences[0]
    assert sentences[2] == "Both arms were above 60° at the same time for 2.5 % (1.0–4.5 %) of that time."
    ranged = ["Time above 60°", "4.0 % (2.5–6.0 %)", "10.0 %", "2.5 % (1.0–4.5 %)", "2.50 (1.20–4.12)"]
    assert [plain(cell) for cell in rows[1]] == ranged
    assert describe_pair(pair)["intervals"]["left_time_above_60_percent"] == [2.5, 6.0]


def test_an_arm_whose_pose_nobody_confirmed_is_as_uncertain_as_in_its_own_report() -> None:
    pair = make_pair()
    own = make_exposure(above_60_interval=Interval(0.0, 40.7))
    findings = pair.left.findings
    assert findings.calibration is not None
    assumed = replace(findings, exposure=own, calibration=replace(findings.calibration, state="assumed"))
    left = replace(pair.left, findings=assumed)
    right_range = Interval(8.0, 12.0)
    known = {**RANGED.intervals, "right_time_above_60_percent": right_range}

    shared = widen_unconfirmed(replace(SHARED, intervals=known), left, pair.right)

    assert shared.intervals == {
        "left_time_above_60_percent": Interval(0.0, 40.7),
        "right_time_above_60_percent": right_range,
    }
    report = report_of(replace(pair, left=left, shared=shared))
    first = format_brief(report).decode().splitlines()[0]
    assert first.startswith("Left arm: calibration pose assumed, not confirmed.")
    assert report.range_note.endswith("Figures of both arms together have no range.")


@pytest.mark.parametrize(
    ("shared", "told"),
    [
        (RANGED, "95 % ranges in brackets"),
        (
            replace(SHARED, shared_s=1799.0),
            "Less than half an hour was analysed for both arms together",
        ),
        (SHARED, "No range is given"),
    ],
    ids=["known", "short", "unknown"],
)
def test_what_the_ranges_hold_is_said(shared: PairedArms, told: str) -> None:
    assert told in plain(report_of(replace(make_pair(), shared=shared)).range_note)


def test_the_answer_tells_both_arms_and_the_time_at_once() -> None:
    assert [plain(s) for s in report_of(make_pair()).sentences] == [
        (
            "In the 1 h analysed for both arms, the left arm was above 60° for 4.0 % and the right "
            "arm for 10.0 % of the time (right/left ratio 2.50); above 90° for 1.0 % and 3.0 %."
        ),
        (
            "Whole recordings, compared with the proposed 10 % of a working day above 60°: left arm: cannot "
            "tell; right arm: cannot tell."
        ),
        "Both arms were above 60° at the same time for 2.5 % of that time.",
        "The median elevation was 20° on the left and 30° on the right.",
    ]


def test_each_arm_is_compared_with_the_levels_as_in_its_own_report() -> None:
    pair = make_pair()
    own = make_exposure(above_60_interval=Interval(6.0, 9.5, 6.0, 9.9))
    kept = replace(pair.left, findings=replace(pair.left.findings, exposure=own))
    pair = replace(pair, left=kept)

    _, _, left, right, *_ = section_of(report_of(pair), "levels").tables[0].rows
    document = describe_pair(pair)["levels"]

    told = [plain(cell) for cell in left]
    assert told == ["Time above 60°", "left", "at most 10 %", "7.6 %", "6.0–9.5 %", "9.9 %", "below"]
    assert [plain(cell) for cell in right[3:]] == ["7.6 %", "–", "–", "cannot tell"]
    assert [document[side][1]["standing"] for side in ("left", "right")] == ["below", "cannot tell"]


def test_the_bars_show_the_figures_of_the_answer_and_not_those_of_each_own_day() -> None:
    chart = report_of(make_pair()).figures[0]

    shares = [[plain(cell) for cell in row[1:]] for row in chart.table.rows]
    assert shares == [["70 %", "26 %", "3 %", "1 %"], ["50 %", "40 %", "7 %", "3 %"]]
    assert chart.note == "Each bar covers the time analysed for both arms."


def test_that_only_the_clocks_give_the_offset_is_said() -> None:
    later, earlier = (report_of(make_pair(offset_s)) for offset_s in (80.0, -80.0))

    shown = [{row.name: plain(row.value) for row in report.header} for report in (later, earlier)]
    assert shown[0]["Right arm started later"] == shown[1]["Left arm started later"] == "1 min 20 s"
    assert plain(earlier.pose_caution).startswith(
        "The right recording started 1 min 20 s before the left. This comes from the clocks"
    )


def test_the_quality_of_each_arm_is_named_and_no_ratio_if_the_left_arm_was_never_up() -> None:
    report = report_of(replace(make_pair(), shared=replace(SHARED, ratio_above_60=None)))

    row = next(row for row in report.sections[-1].tables[0].rows if row[0] == "Data quality")
    assert set(row[1:]) <= {"good", "use with care", "poor"}
    assert "ratio" not in report.sentences[0]


def test_both_days_lie_on_the_clock_of_the_one_that_began_first() -> None:
    rows = report_of(make_pair(-3600.0)).figures[1].table.rows

    left, right = (next(row for row in rows if row[0] == name) for name in ("Left arm", "Right arm"))
    assert (left[1], right[1]) == ("07:58", "06:58")


def test_without_a_trunk_sensor_the_report_says_what_is_missing() -> None:
    section = next(s for s in report_of(make_pair()).sections if s.key == "trunk")

    assert section.paragraphs[0].startswith("The trunk was not measured")
    assert section.tables == ()


def test_with_a_trunk_sensor_the_limits_stand_beside_the_figures() -> None:
    measured = TrunkRelative("sagittal plane only", 60.0, {10: 1.0, 50: 12.0, 90: 30.0, 99: 50.0})

    report = report_of(make_pair(trunk=measured))

    section = next(s for s in report.sections if s.key == "trunk")
    assert "12.1° off" in section.paragraphs[0]
    assert section.paragraphs[1].startswith("No range is given: the error of a sensor on the trunk")
    assert section.tables[0].rows[0][2:] == ("1.0°", "12.0°", "30.0°", "50.0°")
    assert "the trunk was not measured" not in report.limits.paragraphs[0]


@pytest.mark.parametrize(
    ("start", "offset_s"),
    [(START + timedelta(seconds=80), 80.0), (START.replace(tzinfo=None) + timedelta(seconds=5), 5.0)],
    ids=["zones", "one without a zone"],
)
def test_the_clocks_of_the_devices_give_the_offset(start: datetime, offset_s: float) -> None:
    assert find_offset_s(kept_of("left"), kept_of("right", start)) == offset_s


@pytest.mark.parametrize(
    ("changes", "asked", "why"),
    [
        (({}, {"start": None}), {}, "offset"),
        (({"sha256": "a"}, {"sha256": "a"}), {}, "same"),
        (({"side": "right", "sha256": "a"}, {"side": "left"}), {}, "side"),
        (({}, {}), {"offset_s": 7200.0}, "apart"),
        (code("P7", "S012", "S012"), {}, "subjects"),
        (code("", "S012", "P7"), {"same_subject": True}, "subjects"),
        *((code(*nobody), {}, "person") for nobody in (("NA", "NA"), ("S012", "S012", ""))),
        (({}, {"method": "published"}), {}, "methods"),
        (({}, {"sha256": "a"}, {"sha256": "a"}), {}, "same"),  # an arm taken for the trunk
    ],
)
def test_what_is_no_pair_is_refused(
    changes: Changes, asked: dict[str, Any], why: str, tmp_path: Path
) -> None:
    with pytest.raises(CannotPair) as refused:
        pair(tmp_path, keep_arms(tmp_path, changes), **asked)

    assert refused.value.facts == {"why": why}


def test_a_folder_without_a_finished_analysis_is_refused(tmp_path: Path) -> None:
    with pytest.raises(CannotPair) as refused:
        pair(tmp_path, (tmp_path, tmp_path))

    assert refused.value.facts == {"why": "kept"}


@pytest.mark.parametrize(
    ("codes", "stated", "one_person"),
    [(("S012", "S012"), True, "codes"), (("S012", "S012", ""), True, "person")],
)
def test_who_says_that_all_are_of_one_person_stands_in_the_document(
    codes: tuple[str, ...], stated: bool, one_person: str, tmp_path: Path
) -> None:
    document = pair(tmp_path, keep_arms(tmp_path, code(*codes)), same_subject=stated)

    assert document["one_person"] == one_person


@pytest.mark.parametrize(
    ("one_person", "told"),
    [
        ("codes", "Both recordings started at the same moment."),
        ("person", "A subject code is missing; the person who requested the report states that all"),
    ],
)
def test_a_missing_code_is_said_beside_the_answer(one_person: OnePerson, told: str) -> None:
    assert plain(report_of(replace(make_pair(), one_person=one_person)).pose_caution).startswith(told)


def test_two_finished_analyses_of_two_methods_make_every_product_if_that_is_asked_for(tmp_path: Path) -> None:
    folders = keep_arms(tmp_path, ({}, {"method": "published"}))
    out = tmp_path / "out"
    out.mkdir()

    make_report_of_two(folders, PairRequest("pair", languages=("fr",), mixed_methods=True), out)

    made = {path.name for path in out.iterdir()}
    assert made == {"pair.json", "answer.fr.txt", "report.fr.html", "report.fr.pdf"}


def test_the_trunk_is_taken_off_each_arm(tmp_path: Path) -> None:
    pair(tmp_path, keep_arms(tmp_path, ({}, {}, {})), kinds=("html",))

    page = (tmp_path / "report.en.html").read_text("utf-8")
    assert "25.0°" in page
    assert "55.0°" in page


def test_the_clock_of_the_trunk_is_set_by_the_devices_or_by_a_person(tmp_path: Path) -> None:
    folders = keep_arms(tmp_path, ({}, {}, {"start": START + timedelta(seconds=20)}))

    clocks = [pair(tmp_path, folders, None, offset_s)["trunk_clock"] for offset_s in (None, 5.0)]

    assert [(clock["offset_s"], clock["from"]) for clock in clocks] == [(20.0, "clocks"), (5.0, "person")]


@pytest.mark.parametrize(
    ("language", "name", "quality"), [("en", "Trunk", "use with care"), ("fr", "Tronc", "prudence")]
)
def test_the_file_and_quality_of_the_trunk_stand_beside_those_of_the_arms(
    tmp_path: Path, language: Language, name: str, quality: str
) -> None:
    left, right, trunk = keep_arms(tmp_path, ({}, {}, {"sha256": "7" * 64}))
    made = pair_analyses((left, right), trunk, PairRequest("pair"))

    (table,) = section_of(report_of(made, language), "provenance").tables

    assert table.columns[3] == name
    assert [table.rows[k][3] for k in (1, 5)] == ["7" * 16 + "…", quality]
    assert describe_pair(made)["trunk"]["sha256"] == "7" * 64


def test_a_pose_of_the_trunk_that_nobody_confirmed_is_named(tmp_path: Path) -> None:
    left, right, trunk = keep_arms(tmp_path, ({}, {}, {}))
    made = pair_analyses((left, right), trunk, PairRequest("pair"))
    assert made.trunk_source is not None
    findings = made.trunk_source.findings
    assert findings.calibration is not None
    assumed = replace(findings, calibration=replace(findings.calibration, state="assumed"))

    report = report_of(replace(made, trunk_source=replace(made.trunk_source, findings=assumed)))

    told = section_of(report, "trunk").paragraphs[2]
    assert told.startswith("Trunk: calibration pose assumed, not confirmed.")


def test_a_corrected_offset_of_the_right_arm_moves_it_against_the_trunk_too(tmp_path: Path) -> None:
    relative = pair(tmp_path, keep_arms(tmp_path, ({}, {}, {})), 20.0)["trunk_relative"]

    assert relative["left"]["shared_s"] - relative["right"]["shared_s"] == pytest.approx(20.0)


def test_what_a_report_leaves_out_is_not_paired(tmp_path: Path) -> None:
    folder = keep(tmp_path / "l", "left", 40.0)
    kept = kept_of("left")
    findings = replace(kept.findings, exclusions=(Span(0, 10_000_000, "break"),))

    elevation = read_analysed(folder, FinishedAnalysis(findings, kept.subject))

    assert sum(int(segment.valid.sum()) for segment in elevation.segments) == 5000


def test_a_hole_in_the_file_of_angles_ends_the_run(tmp_path: Path) -> None:
    runs = tuple(
        ElevationSegment(start, 100.0, np.full(200, 5.0, np.float32), np.ones(200, bool))
        for start in (0, 5_000_000)
    )
    write_elevation(Elevation(runs, None), tmp_path / "elevation.parquet")
    kept = kept_of("left")

    elevation = read_analysed(tmp_path, FinishedAnalysis(replace(kept.findings, exclusions=()), kept.subject))

    assert [(s.start_us, len(s), round(s.rate_hz, 6)) for s in elevation.segments] == [
        (0, 200, 100.0),
        (5_000_000, 200, 100.0),
    ]


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_first_page_stands_alone_on_letter_paper(language: Language) -> None:
    trunk = TrunkRelative("sagittal plane only", 60.0, {10: 1.0, 50: 12.0, 90: 30.0, 99: 50.0})
    report = report_of(make_pair(-80.0, trunk), language)

    document = render_pdf(report, {}, "letter")

    first = re.sub(r"\s", "", PdfReader(io.BytesIO(document)).pages[0].extract_text())
    assert re.sub(r"\s", "", report.intended_use.paragraphs[0])[-40:] in first


# ------------------------------------------------------------------ the clocks by the shared movement


def test_a_drift_moves_the_right_arm_over_the_whole_time() -> None:
    """After 1 h at 1000 ppm the right clock is 3.6 s ahead: its last rise is that of the left."""
    rows = np.arange(3600 * 20)
    left = np.where((rows >= 3500 * 20) & (rows < 3510 * 20), 90.0, 0.0)
    right = np.where((rows >= 3503.5 * 20) & (rows < 3513.51 * 20), 90.0, 0.0)
    first, second = (
        Elevation((ElevationSegment(0, 20.0, deg.astype(np.float32), np.ones(len(deg), bool)),), None)
        for deg in (left, right)
    )

    shared = pair_arms(first, second, drift_ppm=1000.0)

    assert shared.both_above_60_percent == pytest.approx(shared.left.time_above_percent[60], rel=0.02)


def test_movement_that_was_not_stored_refuses_the_match_and_says_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(CannotPair) as refusal:
        pair(tmp_path, keep_arms(tmp_path), clock="signals")

    assert refusal.value.facts == {
        "why": "no movement stored",
        "place": "clock right",
        "cure": "state the offset",
    }


MATCH = ClockMatch(31.5, 48.0, 0.021, 12, 20)


@pytest.mark.parametrize(
    ("clock", "told"),
    [
        (PairClock(0.0, "clocks"), "nothing else confirms it"),
        (PairClock(31.0, "clocks", MATCH), "confirms it to within 0.5 s"),
        (PairClock(0.0, "clocks", MATCH), "contradicts it by up to 31.5 s: it gives 31.5 s at the start"),
        # 48 ppm over 28,000 s are 1.3 s
        (PairClock(31.5, "clocks", MATCH, 28_000.0), "contradicts it by up to 1.3 s"),
        (PairClock(31.5, "signals", MATCH), "12 minutes agree), to within 0.02 s"),
    ],
    ids=["clocks", "confirmed", "doubtful", "drift", "signals"],
)
def test_the_report_says_how_certain_the_offset_is(clock: PairClock, told: str) -> None:
    assert told in " ".join(report_of(replace(make_pair(), clock=clock)).pose_caution.split())
