"""A diary is read in the forms people already have, and a slip in it is named with its line and its cure."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from acromion.fusion.diary import DiaryEntry, parse_clock, read_diary, read_tasks
from acromion.fusion.errors import UnusableDiary
from tests.clock_spellings import FRACTIONS, READ, REFUSED


def refuse(text: str) -> dict[str, object]:
    with pytest.raises(UnusableDiary) as refusal:
        read_diary(text.encode())
    return dict(refusal.value.facts)


@pytest.mark.parametrize(
    "text",
    [
        "start,end,kind,label\n07:58,12:00,task,Painting\n12:00,12:30,break,\n",
        "\ufeffdébut;fin;genre;libellé\n7 h 58;12h00;tâche;Painting\n12:00;12:30;pause;\n",
        "start,end,kind,label\r\n07:58,12:00,task,Painting\r\n12:00,12:30,break,\r\n",
        "start,end,kind,label\r07:58,12:00,task,Painting\r12:00,12:30,break,\r",
    ],
    ids=["our own", "a French spreadsheet", "lines of Windows", "lines of an old Mac"],
)
def test_our_own_form_gives_start_end_kind_and_label_however_it_is_written(text: str) -> None:
    assert read_diary(text.encode()) == (
        DiaryEntry("07:58:00", "12:00:00", "task", "Painting", line=2),
        DiaryEntry("12:00:00", "12:30:00", "break", line=3),
    )


def test_in_the_sequential_form_an_event_lasts_until_the_next_or_the_event_end() -> None:
    entries = read_diary(b"time,event\n08:00,Painting\n10:00,break\n10:15,Sanding\n10:30,end\n")

    assert [(e.start, e.end, e.kind, e.label) for e in entries] == [
        ("08:00:00", None, "task", "Painting"),
        ("10:00:00", None, "break", "break"),
        ("10:15:00", "10:30:00", "task", "Sanding"),
    ]


def test_a_quote_that_is_never_closed_is_refused_with_its_line_and_not_told_whole() -> None:
    facts = refuse('start,end,kind\n"08:00,09:00,task' + "x" * 200_000)

    assert (facts["line"], facts["why"]) == (2, "time")
    assert len(str(facts["value"])) < 1000


def test_seconds_may_have_a_decimal_comma_and_the_encoding_be_that_of_windows() -> None:
    (entry,) = read_diary("début_s;fin_s;genre\n12,5;60.25;retiré\n".encode("cp1252"))

    assert (entry.start, entry.end, entry.kind) == (12.5, 60.25, "not_worn")


@pytest.mark.parametrize(("text", "time"), READ.items())
def test_a_clock_time_is_read_in_every_spelling(text: str, time: str) -> None:
    assert parse_clock(text) == time


SPELLINGS = ("{h:02}:{m:02}", "{h}:{m:02}", "{h:02}.{m:02}", "{h:02},{m:02}", "{h:02}{m:02}", "{h:02}h{m:02}",
             "{h} h {m:02}", "{h}h{m:02}min", "{h:02}:{m:02}:00", "{h:02}.{m:02}.00", "{h:02}{m:02}00",
             "{h}h{m:02}m00", "2026-03-02 {h:02}.{m:02}")  # fmt: skip


@given(st.integers(0, 23), st.integers(0, 59), st.sampled_from(SPELLINGS))
def test_every_spelling_of_every_minute_of_the_day_is_that_minute(
    hour: int, minute: int, spelling: str
) -> None:
    assert parse_clock(spelling.format(h=hour, m=minute))[-8:] == f"{hour:02}:{minute:02}:00"


@pytest.mark.parametrize("text", REFUSED)
def test_what_is_no_clock_time_is_refused_and_never_seconds(text: str) -> None:
    with pytest.raises(UnusableDiary) as refusal:
        parse_clock(text, 7)

    assert refusal.value.facts == {"line": 7, "why": "time", "cure": "time", "value": text}


@pytest.mark.parametrize("text", [*FRACTIONS, "2026-03-02 0.43"])
def test_a_fraction_of_a_day_is_refused_with_its_own_cure(text: str) -> None:
    with pytest.raises(UnusableDiary) as refusal:
        parse_clock(text)

    assert (refusal.value.facts["cure"], refusal.value.facts["value"]) == ("fraction", text)


@pytest.mark.parametrize("cell", ["07:58", "soon", "-5", "1e3"])
def test_a_column_of_seconds_takes_nothing_else(cell: str) -> None:
    assert refuse(f"start_s,kind\n{cell},work\n")["cure"] == "seconds"


def test_clock_times_and_seconds_may_stand_in_one_file_but_not_in_one_row() -> None:
    header = "start,end,start_s,end_s,kind\n"
    entries = read_diary(f"{header}10h20,10h50,,,break\n,,600,660.5,task\n".encode())

    assert [(e.start, e.end) for e in entries] == [("10:20:00", "10:50:00"), (600.0, 660.5)]
    assert refuse(f"{header}10h20,,600,,break\n")["why"] == "two times"


def test_a_time_may_have_its_date_and_a_row_be_for_one_file() -> None:
    (entry,) = read_diary(b"file,start,end,kind\na.gt3x,2026-03-02 7:58,2026-03-02T09:00:30,work\n")

    assert (entry.file, entry.start, entry.end) == ("a.gt3x", "2026-03-02T07:58:00", "2026-03-02T09:00:30")


@pytest.mark.parametrize(("word", "left_out"), [("oui", True), ("no", False), ("", None)])
def test_a_row_may_say_itself_whether_it_is_left_out(word: str, left_out: bool | None) -> None:
    (entry,) = read_diary(f"start_s,end_s,kind,left_out\n1,2,seated,{word}\n".encode())

    assert entry.left_out is left_out


def test_remarks_and_empty_lines_are_passed_over_and_lines_still_counted() -> None:
    (entry,) = read_diary(b"# my day\n\nstart_s,end_s,kind\n\n1,2,work\n")

    assert entry.line == 5


@pytest.mark.parametrize(
    ("text", "line", "why"),
    [
        ("", 1, "empty"),
        ("start,end,kind\n", 1, "empty"),
        ("kind,label\nwork,a\n", 1, "header"),
        ("start_s,start_s,kind\n1,2,work\n", 1, "header"),
        ("start_s,end_s,kind\n1,2,work\n3,4,wrk\n", 3, "kind"),
        ("start,end,kind\n25:00,26:00,work\n", 2, "time"),
        ("start,end,kind\n,9:00,work\n", 2, "time"),
        ("start,end,kind\n10,20,10,50,break\n", 2, "time"),
        ("start_s,end_s,kind\n,60,work\n", 2, "time"),
        ("end_s,kind\n60,work\n", 1, "header"),
        ("start_s,end_s,kind,left_out\n1,2,work,perhaps\n", 2, "yes or no"),
        ("time,event\n08:00,end\n", 2, "end alone"),
        ("start_s,end_s,kind\n" + "1,2,work\n" * 10_000, 10_001, "too many rows"),
        ("ID,date,work\nA,04-23-2017,8:00\n", 2, "time"),
    ],
    ids=lambda value: str(value)[-24:],
)
def test_a_slip_is_named_with_its_line_and_its_reason(text: str, line: int, why: str) -> None:
    facts = refuse(text)

    assert (facts["line"], facts["why"]) == (line, why)


LOG = """ID,date,work,travelhome,home,date,work,break
S012,23-04-2017,07:45:30,17:00,17:30,24-04-2017,07:50:00,
"""


def test_the_activity_log_of_ggir_is_read() -> None:
    entries = read_diary(LOG.encode())

    assert [(e.start, e.end, e.kind, e.label) for e in entries] == [
        ("2017-04-23T07:45:30", "2017-04-23T17:00:00", "work", "work"),
        ("2017-04-23T17:00:00", "2017-04-23T17:30:00", "task", "travelhome"),
        ("2017-04-23T17:30:00", "2017-04-24T00:00:00", "task", "home"),
        ("2017-04-24T07:50:00", "2017-04-25T00:00:00", "work", "work"),
    ]


def test_an_activity_log_of_several_recordings_is_told_apart_by_their_ids() -> None:
    entries = read_diary(b"ID;date;work;break\nA;2017-04-23;8:00;9:00\nB;23/04/2017;8:30;\n")

    assert [(e.file, str(e.start)[-8:], str(e.end)[-8:]) for e in entries] == [
        ("A", "08:00:00", "09:00:00"),
        ("A", "09:00:00", "00:00:00"),
        ("B", "08:30:00", "00:00:00"),
    ]


def test_an_activity_log_of_one_recording_is_for_that_recording_only() -> None:
    (entry,) = read_diary(b"ID,date,work\n1111,2017-04-23,08:00\n")

    assert entry.file == "1111"


@pytest.mark.parametrize(
    ("event", "kind"),
    [("NW", "not_worn"), ("ForcedNW", "not_worn"), ("Bed", "outside"), ("Night", "outside")],
)
def test_the_keywords_of_actipass_for_nonwear_and_bedtime_are_no_tasks(event: str, kind: str) -> None:
    entries = read_diary(f"ID,Date,Time,Event\nA,2026-03-02,07:20,{event}\n".encode())

    assert [entry.kind for entry in entries] == [kind]


def test_lying_is_a_posture_that_counts_as_seated() -> None:
    (entry,) = read_diary(b"start,end,kind,label\n08:00,09:00,posture,lying\n")

    assert entry.label == "seated"


ON_OFF = "Subject Name,On Date,On Time,Off Date,Off Time,Category\n"


def test_a_date_whose_day_and_month_cannot_be_told_apart_is_refused() -> None:
    facts = refuse(f"{ON_OFF}P9,3/2/2026,07:10,3/2/2026,07:30,Break\n")

    assert (facts["line"], facts["why"]) == (2, "day or month")


@pytest.mark.parametrize("text", ["02-Mar-2026", "2026/03/02", "02.03.2026", "02-03-2026", "2-3-2026"])
def test_a_date_is_read_as_other_programs_write_it(text: str) -> None:
    (entry,) = read_diary(f"{ON_OFF}P9,{text},07:10,{text},07:30,Break\n".encode())

    assert entry.start == "2026-03-02T07:10:00"


def test_another_date_of_the_table_shows_that_the_month_is_first() -> None:
    entries = read_diary(
        f"{ON_OFF}P9,3/2/2026,07:10,3/2/2026,07:30,Break\nP9,3/13/2026,07:10,3/13/2026,07:30,Break\n".encode()
    )

    assert [entry.start for entry in entries] == ["2026-03-02T07:10:00", "2026-03-13T07:10:00"]


def test_every_line_that_cannot_be_read_is_told_with_its_text() -> None:
    facts = refuse("start_s,end_s,kind,label\n1,2,wrk,Boxes\n3,4,work,\nnoon,5,work,\n")

    assert (facts["line"], facts["text"], facts["why"], facts["value"]) == (
        2,
        "1, 2, wrk, Boxes",
        "kind",
        "wrk",
    )
    assert (facts["line_2"], facts["text_2"], facts["cure_2"]) == (4, "noon, 5, work", "seconds")


def test_twenty_slips_are_told_and_the_others_counted() -> None:
    facts = refuse("start_s,end_s,kind\n" + "1,2,wrk\n" * 23)

    assert (facts["line_20"], facts["more"]) == (21, 3)
    assert "line_21" not in facts


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"], ids=["unix", "windows", "old mac"])
@pytest.mark.parametrize("delimiter", [",", ";"])
def test_the_lines_of_a_list_of_tasks_may_end_as_on_any_system(end: str, delimiter: str) -> None:
    rows = ("name,start_s,end_s", "reach,0,10", "carry,10,20")

    tasks = read_tasks("".join(row + end for row in rows).replace(",", delimiter).encode())

    assert [(task.name, task.start_s, task.end_s) for task in tasks] == [
        ("reach", 0.0, 10.0),
        ("carry", 10.0, 20.0),
    ]


QUOTES = {
    "never closed": ('09:00,10:00,task,"Boxes\n10:00,11:00,break,\n', 2),
    "closed by the next": ('09:00,10:00,task,"Boxes\n10:00,11:00,task,"Lifts\n', 2),
    "in the last line": ('08:00,09:00,work,\n09:00,10:00,task,"Boxes\n', None),
    "in the middle": ('09:00,10:00,task,12" pipe\n10:00,11:00,break,\n', None),
    "two lines in a cell": ('09:00,10:00,task,"Boxes\nand lifts"\n10:00,11:00,break,\n', None),
}


@pytest.mark.parametrize(("rows", "line"), QUOTES.values(), ids=QUOTES)
def test_an_open_quotation_mark_swallows_no_line(rows: str, line: int | None) -> None:
    text = f"start,end,kind,label\n{rows}".encode()
    if line is None:
        assert len(read_diary(text)) == 2
        return
    with pytest.raises(UnusableDiary) as refusal:
        read_diary(text)
    assert (refusal.value.facts["line"], refusal.value.facts["why"]) == (line, "open quote")


def test_an_activity_log_of_many_columns_counts_each_activity_as_a_row() -> None:
    head = ["id", "date", *(f"activity {k}" for k in range(300))]
    row = ["S01", "2026-03-02", *(f"{k // 60:02}:{k % 60:02}" for k in range(300))]
    text = "\n".join(",".join(cells) for cells in (head, *[row] * 60))

    with pytest.raises(UnusableDiary) as refusal:
        read_diary(text.encode())

    assert refusal.value.facts["why"] == "too many rows"
