"""The settings of a study: written out, read back, and every slip in them named."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from acromion.app.batch.settings_file import DIARY_HINT, encode_settings, read_settings
from acromion.app.batch.stated import format_stated
from acromion.app.errors import UnusableSettings
from acromion.app.request import ReportRequest
from acromion.fusion.diary import DiaryEntry

MOMENTS = st.floats(0, 86_400).map(lambda s: round(s, 3)) | st.times().map(
    lambda t: t.replace(microsecond=0).isoformat()
)
ENTRIES = st.builds(
    DiaryEntry,
    start=MOMENTS,
    end=st.none() | MOMENTS,
    kind=st.sampled_from(["task", "break", "shift", "not_worn"]),
    label=st.text(st.characters(exclude_categories=["C", "Z"]), max_size=20),
    left_out=st.none() | st.booleans(),
)
REQUESTS = st.builds(
    ReportRequest,
    file_name=st.just("a.gt3x"),
    side=st.sampled_from([None, "left", "right"]),
    method=st.sampled_from(["smoothed", "published", "live"]),
    pose=st.sampled_from(["n-pose", "side-lean", "two-point"]),
    calibration_windows_s=st.lists(st.sampled_from([(0.0, 5.0), (12.5, 20.25)]), max_size=2).map(tuple),
    arm_axis=st.sampled_from([None, "+y", "-x"]),
    slip_times_s=st.lists(st.sampled_from([0.0, 3600.5]), max_size=2).map(tuple),
    no_slip_times_s=st.lists(st.sampled_from([0.0, 3600.5]), max_size=2).map(tuple),
    pose_held=st.sampled_from([None, "start", "no"]),
    rate_hz=st.none() | st.floats(1, 10_000),
    time_zone=st.sampled_from(["", "Europe/Paris", "UTC-05:00"]),
    clock_offset_s=st.sampled_from([0.0, -3720.0, 1.5]),
    languages=st.sampled_from([("en",), ("fr",)]),
    kinds=st.sampled_from([("html",), ("pdf",), ("html", "pdf")]),
    paper=st.sampled_from(["a4", "letter"]),
    appendix=st.booleans(),
    diary=st.lists(ENTRIES, max_size=3).map(tuple),
    profile=st.sampled_from(["", '{"acceleration": ["ax", "ay", "az"]}']),
)


def refusal(content: bytes) -> UnusableSettings:
    with pytest.raises(UnusableSettings) as caught:
        read_settings(content)
    return caught.value


@given(REQUESTS)
def test_what_is_written_is_read_back(request_: ReportRequest) -> None:
    values = read_settings(encode_settings(request_))

    assert replace(ReportRequest("a.gt3x"), **values) == request_


@pytest.mark.parametrize("label", ["0E0", "08", "1e5", "+7", "07:30", "yes", "2026-03-02"])
def test_a_label_that_looks_like_another_value_stays_text(label: str) -> None:
    request = ReportRequest("a.gt3x", diary=(DiaryEntry(0.0, None, "task", label),))

    assert read_settings(encode_settings(request))["diary"][0].label == label


def test_only_the_names_in_the_file_are_set() -> None:
    assert read_settings(b"pose: side-lean\n") == {"pose": "side-lean"}


def test_an_empty_file_sets_nothing() -> None:
    assert read_settings(b"# nothing yet\n") == {}


def test_a_clock_time_without_quotes_is_a_clock_time() -> None:
    values = read_settings(b"diary: [{start: 10:30, end: 11h00, kind: break}]\n")

    assert values["diary"] == (DiaryEntry("10:30:00", "11:00:00", "break"),)


@pytest.mark.parametrize(("text", "held"), [("no", "no"), ('"no"', "no"), ("start", "start"), ("", None)])
def test_a_pose_that_was_not_held_needs_no_quotes(text: str, held: str | None) -> None:
    assert read_settings(f"pose_held: {text}\n".encode()) == {"pose_held": held}


def test_a_name_that_is_not_known_is_refused_with_the_nearest_one() -> None:
    assert refusal(b"metod: live\n").facts["nearest"] == "method"


@pytest.mark.parametrize(
    ("line", "allowed"),
    [
        ("method: kalman", "smoothed|published|live"),
        ("pose: t-pose", "n-pose|side-lean|two-point"),
        ("side: up", "left|right|trunk"),
        ("lang: it", "en|fr|fr-CA"),
        ("report: [docx]", "[html, pdf]"),
        ("appendix: perhaps", "true|false"),
        ("rate_hz: 0", "1 to 10000"),
        ("calibration: [[10, 5]]", "[[START_S,END_S]]"),
        ("calibration: [5, 10]", "[[START_S,END_S]]"),
        ("axis: up", "x, y, z, -x, -y, -z"),
        ("pose_held: end", "start|no"),
        ("slip_at: [noon]", "[SECONDS]"),
        ("diary: [{start: 25:99, kind: break}]", DIARY_HINT),
        ("diary: [{start_s: 5, kind: lunch}]", DIARY_HINT),
        ("diary: [{start: 5, kind: break}]", DIARY_HINT),
        ("diary: [{end: 10:30, kind: break}]", DIARY_HINT),
    ],
)
def test_a_value_that_cannot_be_is_refused_with_what_is_allowed(line: str, allowed: str) -> None:
    assert refusal(line.encode()).facts["allowed"] == allowed


def test_what_is_no_yaml_is_refused_with_its_line() -> None:
    assert refusal(b"method: live\npose: [\n").facts["line"] == 3


def test_a_list_is_no_settings_file() -> None:
    assert refusal(b"- method\n").facts["why"] == "yaml"


def test_code_in_the_file_is_not_run() -> None:
    assert refusal(b"method: !!python/object/apply:os.getcwd []\n").facts["why"] == "yaml"


def test_a_row_of_the_summary_states_what_differs_from_the_defaults_and_no_word_of_the_diary() -> None:
    diary = (DiaryEntry(0, 60, "task", "Mrs Smith"),)
    request = ReportRequest("a.gt3x", "S01", "left", pose_held="start", slip_times_s=(7.0,), diary=diary)

    assert format_stated(ReportRequest("a.gt3x", "S01", "left")) == "{}"
    assert format_stated(request) == '{"pose_held": "start", "slip_at": [7.0], "diary_rows": 1}'
