"""The activity per second of ActiPASS and of acti-motus becomes postures that leave the diary whole."""

from datetime import datetime

import pytest

from acromion.fusion.diary import DiaryEntry, read_diary
from acromion.fusion.errors import UnusableDiary
from acromion.fusion.exposure.periods import place_diary
from acromion.fusion.shifts import find_by_diary
from tests.workbooks import write

HOUR_US = 3_600_000_000
ACTIPASS = "DateTime,Activity,Steps,SVM,Event,TimeInBed,SleepInterval\n"
START = datetime.fromisoformat("2026-03-02T08:00:00")


def describe(content: str) -> list[tuple[str, str, str, str]]:
    return [(str(e.start), str(e.end), e.kind, e.label) for e in read_diary(content.encode())]


def describe_short(content: str) -> list[tuple[str, str, str]]:
    return [(start[-8:], end[-8:], label) for start, end, _, label in describe(content)]


def count_seconds(*activities: str) -> str:
    """Return the lines of acti-motus from 08:00:00, one for each second."""
    rows = (f"2026-03-02 08:00:{second:02d},{activity}" for second, activity in enumerate(activities))
    return "\n".join(("datetime,activity", *rows))


def test_the_numbers_of_actipass_are_sitting_lying_and_on_the_feet() -> None:
    # 740043 is 2 March 2026 for MATLAB (datenum); 1/3 of a day is 08:00; a second is 0.0000115740741 of a day
    codes = (0, 1, 2, 11, 3, 4, 5, 6, 7, 8, 9, 12, 2)
    rows = "".join(f"{740043 + 1 / 3 + k / 86400:.9f},{code},0,1.01,,0,0\n" for k, code in enumerate(codes))

    assert describe(ACTIPASS + rows) == [
        ("2026-03-02T08:00:01", "2026-03-02T08:00:04", "posture", "seated"),
        ("2026-03-02T08:00:04", "2026-03-02T08:00:09", "posture", "upright"),
        ("2026-03-02T08:00:12", "2026-03-02T08:00:13", "posture", "seated"),
    ]


def test_actipass_may_write_the_time_as_text() -> None:
    rows = "02-Mar-2026 08:00:00,2,0,1,,0,0\n02-Mar-2026 08:00:01,2,0,1,,0,0\n"

    assert describe_short(ACTIPASS + rows) == [("08:00:00", "08:00:02", "seated")]


def test_the_words_of_actimotus() -> None:
    seated, upright = (
        ("lie", "sit"),
        ("stand", "shuffle", "slow-walk", "walk", "fast-walk", "run", "stairs", "squat"),
    )
    neither = ("non-wear", "kneel", "bicycle", "row")

    table = count_seconds(*seated, *upright, *neither)

    assert describe_short(table) == [("08:00:00", "08:00:02", "seated"), ("08:00:02", "08:00:10", "upright")]


def test_actimotus_states_its_offset() -> None:
    table = "datetime,activity,steps\n2026-03-02 07:00:00+00:00,sit,0\n"

    (entry,) = read_diary(table.encode())
    assert entry.start == "2026-03-02T07:00:00+00:00"


def test_seconds_without_a_row_have_no_posture() -> None:
    table = "datetime,activity\n2026-03-02 08:00:00,sit\n2026-03-02 08:00:09,sit\n"

    assert describe_short(table) == [("08:00:00", "08:00:01", "seated"), ("08:00:09", "08:00:10", "seated")]


def test_a_table_of_activities_may_be_a_workbook() -> None:
    content = write(("datetime", "activity"), (datetime.fromisoformat("2026-03-02T08:00:00"), "sit"))

    assert [(e.kind, e.label, e.end) for e in read_diary(content)] == [
        ("posture", "seated", "2026-03-02T08:00:01")
    ]


@pytest.mark.parametrize(
    ("table", "line", "cure"),
    [
        ("datetime,activity\n2026-03-02 08:00:00,2\n", 2, "activity"),  # whose numbers are these?
        ("datetime,activity\n2026-03-02 08:00:00,dance\n", 2, "activity"),
        (ACTIPASS + "740043.3,13,0,1,,0,0\n", 2, "activity"),
        ("datetime,activity\n2026-03-02 08:00:01,sit\n2026-03-02 08:00:00,sit\n", 3, "not later"),
        ("datetime,activity\nsoon,sit\n", 2, "second"),
        ("datetime,activity\n2026-03-02 08:00:00,sit\n2026-03-02 08:00:01+01:00,sit\n", 3, "second"),
        ("datetime,activity\n2026-03-02 08:00:00,non-wear\n", 1, "activity"),
    ],
)
def test_a_table_that_is_not_understood_is_refused_with_its_line(table: str, line: int, cure: str) -> None:
    with pytest.raises(UnusableDiary) as refusal:
        read_diary(table.encode())

    assert (refusal.value.facts["line"], refusal.value.facts["cure"]) == (line, cure)


def make_posture(start: str, end: str, label: str) -> DiaryEntry:
    return DiaryEntry(f"2026-03-02T{start}", f"2026-03-02T{end}", "posture", label)


def test_a_measured_posture_leaves_the_tasks_whole_and_applies_before_a_stated_one() -> None:
    stated = DiaryEntry("08:00", "08:30", "seated"), DiaryEntry("08:30", "09:00", "task", "Painting")

    placed = place_diary((*stated, make_posture("08:20:00", "08:40:00", "upright")), START, HOUR_US)

    assert [period.kind for period in placed.periods] == ["task"]
    assert [(p.kind, p.start_us, p.end_us) for p in placed.postures] == [
        ("seated", 0, 1_800_000_000),
        ("upright", 1_200_000_000, 2_400_000_000),
    ]


def test_postures_before_and_after_the_recording_are_ignored_without_a_caveat() -> None:
    every = make_posture("06:00:00", "07:00:00", "seated"), make_posture("08:10:00", "12:00:00", "upright")

    placed = place_diary(every, START, HOUR_US)

    assert placed.flags == ()
    assert [(p.start_us, p.end_us) for p in placed.measured] == [(600_000_000, HOUR_US)]


def test_postures_of_another_day_are_refused() -> None:
    other = DiaryEntry("2026-03-03T08:00:00", "2026-03-03T09:00:00", "posture", "seated", line=2)

    with pytest.raises(UnusableDiary) as refusal:
        place_diary((DiaryEntry("08:00", "09:00", "work"), other), START, HOUR_US)

    assert (refusal.value.facts["line"], refusal.value.facts["why"]) == (2, "outside recording")


def test_a_row_without_an_end_does_not_end_at_a_posture() -> None:
    rows = DiaryEntry("08:00", None, "task"), make_posture("08:20:00", "08:40:00", "upright")

    (task,) = place_diary(rows, START, HOUR_US).periods

    assert task.end_us == HOUR_US


def test_postures_are_no_shift() -> None:
    postures = make_posture("06:00:00", "22:00:00", "seated")
    work = DiaryEntry("2026-03-02T08:00:00", "2026-03-02T09:00:00", "work")

    (shift,) = find_by_diary((work, postures), START, 24 * HOUR_US)

    assert (shift.start.hour, shift.end.hour) == (8, 9)


def test_a_row_of_a_diary_may_state_a_posture() -> None:
    (row,) = read_diary(b"start,end,kind,label\n08:00,09:00,posture,debout\n")

    assert (row.kind, row.label) == ("posture", "upright")
    with pytest.raises(UnusableDiary):
        read_diary(b"start,end,kind,label\n08:00,09:00,posture,dancing\n")
