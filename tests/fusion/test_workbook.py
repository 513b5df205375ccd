"""A diary in Excel is read like one in CSV; wrong ones are refused, each with its reason and its place."""

import io
import zipfile
from datetime import date, datetime, time, timedelta

import openpyxl
import pytest
import xlsxwriter
from openpyxl.utils.datetime import CALENDAR_MAC_1904

from acromion.fusion.diary import DiaryEntry, read_diary
from acromion.fusion.errors import UnusableDiary, split_facts
from acromion.fusion.workbook import MOST_BYTES, MOST_UNPACKED_BYTES
from tests.workbooks import save, write

DAY = "2026-03-02"
MOMENT = datetime.fromisoformat(f"{DAY}T10:20")
HEAD = ("start", "end", "kind")
SHEET = "xl/worksheets/sheet1.xml"


def change(content: bytes, name: str, old: bytes, new: bytes) -> bytes:
    """Return the workbook with another text in one of its parts."""
    body = io.BytesIO()
    with (
        zipfile.ZipFile(io.BytesIO(content)) as before,
        zipfile.ZipFile(body, "w", zipfile.ZIP_DEFLATED) as after,
    ):
        for member in before.infolist():
            part = before.read(member)
            after.writestr(member.filename, part.replace(old, new, 1) if member.filename == name else part)
    return body.getvalue()


def list_times(content: bytes) -> list[tuple[object, object]]:
    return [(entry.start, entry.end) for entry in read_diary(content)]


# Times as Excel stores them.


@pytest.mark.parametrize(
    "cell",
    [
        time(10, 20),
        0.430555555555556,
        "10:20",
        "10h20",
        1020,
        timedelta(hours=10, minutes=20),
        datetime.fromisoformat("1900-01-01T10:20"),
    ],
    ids=[
        "time",
        "fraction without a format",
        "text",
        "French text",
        "number",
        "duration",
        "with the year 1900",
    ],
)
def test_a_time_of_day_is_a_clock_time_however_excel_stores_it(cell: object) -> None:
    assert list_times(write(("start", "kind"), (cell, "work"))) == [("10:20:00", None)]


@pytest.mark.parametrize(
    "cell",
    [MOMENT, 46083.430555555555, "2026-03-02 10:20"],
    ids=["date", "number", "text"],
)
def test_a_date_with_a_time_is_a_dated_clock_time(cell: object) -> None:
    assert list_times(write(("start", "kind"), (cell, "work"))) == [(f"{DAY}T10:20:00", None)]


def test_a_workbook_of_a_mac_that_counts_from_1904_has_the_same_dates() -> None:
    book = openpyxl.Workbook()
    book.epoch = CALENDAR_MAC_1904
    sheet = book.active
    assert sheet is not None
    sheet.append(("start", "kind"))
    sheet.append((MOMENT, "work"))

    assert list_times(save(book)) == [(f"{DAY}T10:20:00", None)]


def test_a_fraction_in_a_column_of_seconds_is_seconds() -> None:
    assert list_times(write(("start_s", "end_s", "kind"), (0.5, 90, "work"))) == [(0.5, 90.0)]


@pytest.mark.parametrize(
    "row", [("0,4306", "", "work"), (0.916667, 1.25, "work")], ids=["text", "over a day"]
)
def test_a_fraction_of_a_day_that_may_be_a_clock_time_is_refused(row: tuple[object, ...]) -> None:
    """1.25 is 06:00 on the next day, or 01:25."""
    with pytest.raises(UnusableDiary) as refusal:
        read_diary(write(HEAD, row))

    assert (refusal.value.facts["line"], refusal.value.facts["why"]) == (2, "fraction")


@pytest.mark.parametrize(("stored", "end"), [(0.375, "09:00:00"), ("", None)])
def test_a_formula_has_the_value_that_excel_stored(stored: float | str, end: str | None) -> None:
    body = io.BytesIO()
    with xlsxwriter.Workbook(body) as book:
        sheet = book.add_worksheet()
        for place, name in enumerate(HEAD):
            sheet.write_string(0, place, name)
        sheet.write_string(1, 0, "08:00")
        sheet.write_formula(1, 1, "=A2+1/24", value=stored)
        sheet.write_string(1, 2, "work")

    content = body.getvalue() if stored else change(body.getvalue(), SHEET, b'r="B2"', b'r="B2" t="str"')
    assert list_times(content) == [("08:00:00", end)]


# Where the table is.


def test_rows_above_the_header_and_other_sheets_are_ignored_and_rows_still_counted() -> None:
    content = write(
        ("Diary of the week",), (), ("start", "end", "kind"), ("08:00", "09:00", "work"), Notes=[("Fill in",)]
    )

    assert read_diary(content) == (DiaryEntry("08:00:00", "09:00:00", "work", line=4),)


def test_a_zero_in_the_last_column_is_a_value() -> None:
    (entry,) = read_diary(write((*HEAD, "left_out"), ("08:00", "09:00", "seated", 0)))

    assert entry.left_out is False


def test_a_hidden_sheet_is_not_read() -> None:
    book = openpyxl.load_workbook(io.BytesIO(write(("start", "kind"), ("08:00", "work"))))
    book.copy_worksheet(book.worksheets[0]).sheet_state = "hidden"

    assert [entry.file for entry in read_diary(save(book))] == [""]


def test_one_sheet_for_many_recordings_has_columns_of_subject_and_date() -> None:
    content = write(
        ("Subject", "Date", "Start", "End", "Kind"),
        ("S01", date(2026, 3, 2), time(8), time(16), "shift"),
        ("S02", date(2026, 3, 3), time(22), time(6), "shift"),
    )

    assert [(e.file, e.start, e.end) for e in read_diary(content)] == [
        ("S01", f"{DAY}T08:00:00", f"{DAY}T16:00:00"),
        ("S02", "2026-03-03T22:00:00", "2026-03-04T06:00:00"),
    ]


def test_a_sheet_for_each_recording_is_named_after_its_file_or_subject() -> None:
    rows = [("start", "kind"), ("08:00", "work")]
    content = write(("Instructions",), S01=rows, S02=rows)

    assert [(e.file, e.start) for e in read_diary(content)] == [("S01", "08:00:00"), ("S02", "08:00:00")]


# Layouts of other programs.


def test_the_diary_of_actipass_is_read() -> None:
    content = write(
        ("ID", "Date", "Time", "Event", "Comment"),
        ("101", date(2026, 3, 2), time(7, 50), "Start", ""),
        ("101", date(2026, 3, 2), time(7, 55), "Ref", "standing"),
        ("101", date(2026, 3, 2), time(8), "Work", ""),
        ("101", date(2026, 3, 2), time(16), "Leisure", ""),
        ("101", date(2026, 3, 2), time(22), "Stop", ""),
    )

    assert [(e.file, e.start, e.end, e.kind) for e in read_diary(content)] == [
        ("101", f"{DAY}T08:00:00", None, "work"),
        ("101", f"{DAY}T16:00:00", f"{DAY}T22:00:00", "outside"),
    ]


def test_the_setup_of_acti4_is_read() -> None:
    sensors = ("Position", "File", "Start", "Stop", "Down", "D:HH:MM:SS", "Hz", "Serial No.")
    day = "02/03/2026/"
    rows = [
        sensors,
        ("Arm", "101_arm.gt3x", "02-Mar-2026 07:00:00", " ", " ", "0:10:00:00", "100", "X"),
        ("Type", "Weekday", "Start", "Stop"),
        ("A1. Work", "1", f"{day}08:00:00", f"{day}16:00:00"),
        ("E.1101 Actigraph(s) worn/not worn", "1", f"{day}10:00:00", f"{day}10:30:00"),
        ("E.0111 Actigraph(s) worn/not worn", "1", f"{day}11:00:00", f"{day}11:30:00"),
        ("F. Reference", "1", f"{day}07:10:00", f"{day}07:11:00"),
    ]

    entries = read_diary(write(("ID", "AH"), **{"101": rows, "102": rows}))

    assert [(e.file, e.start, e.end, e.kind) for e in entries[:2]] == [
        ("101", f"{DAY}T08:00:00", f"{DAY}T16:00:00", "work"),
        ("101", f"{DAY}T10:00:00", f"{DAY}T10:30:00", "not_worn"),
    ]
    assert [entry.file for entry in entries] == ["101", "101", "102", "102"]


def test_the_log_diary_of_actilife_is_read() -> None:
    header = b"Subject Name,On Date,On Time,Off Date,Off Time,Category\n"
    text = header + b"S01,2026-03-02,22:00,2026-03-03,06:00,Night\n"

    (entry,) = read_diary(text)

    assert (entry.file, entry.start, entry.end, entry.label) == (
        "S01", f"{DAY}T22:00:00", "2026-03-03T06:00:00", "Night",
    )  # fmt: skip


def test_of_the_advanced_sleep_log_of_ggir_the_time_not_worn_and_the_naps_are_read() -> None:
    text = (
        b"ID,D1_date,D1_wakeup,D1_inbed,D1_nap_start,D1_nap_end,D1_nonwear1_off,D1_nonwear1_on\n"
        b"123,02-03-2026,09:00:00,22:00:00,11:15:00,11:45:00,23:50:00,00:10:00\n"
    )

    assert [(e.kind, e.start, e.end) for e in read_diary(text)] == [
        ("outside", f"{DAY}T11:15:00", f"{DAY}T11:45:00"),
        ("not_worn", f"{DAY}T23:50:00", "2026-03-03T00:10:00"),
    ]


# Ten wrong diaries.

GOOD = write(HEAD, ("08:00", "09:00", "work"))
ENTITY = b'<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa">]><worksheet'


def pack(**members: bytes) -> bytes:
    body = io.BytesIO()
    with zipfile.ZipFile(body, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return body.getvalue()


WRONG = {
    "old Excel, or with a password": (b"\xd0\xcf\x11\xe0" + bytes(600), "old workbook", None),
    "another zip": (pack(word=b"text"), "workbook", None),
    "cut off": (GOOD[: len(GOOD) // 2], "workbook", None),
    "too large": (b"PK\x03\x04" + bytes(MOST_BYTES), "workbook size", None),
    "unpacks to too much": (pack(a=bytes(MOST_UNPACKED_BYTES + 1)), "workbook size", None),
    "entities": (change(GOOD, SHEET, b"<worksheet", ENTITY), "workbook", None),
    "row beyond the last": (change(GOOD, SHEET, b'r="2"', b'r="99999999999"'), "workbook size", None),
    "a value far below": (change(GOOD, SHEET, b'r="2"', b'r="600000"'), "workbook size", None),
    "many long sheets": (
        write(HEAD, **{f"d{k}": [*[HEAD] * 2, *[()] * 30_000, HEAD] for k in range(20)}),
        "workbook size",
        None,
    ),
    "a cell of a whole book": (
        change(GOOD, SHEET, b">work<", b">%b<" % (b"w" * 40_000)),
        "workbook size",
        None,
    ),
    "too many columns": (write(HEAD, ("08:00", "09:00", "work", *[""] * 300, "x")), "workbook size", None),
    "formula without a value": (write(HEAD, ("08:00", "=A2+1/24", "work")), "formula", None),
    "no header": (write(("08:00", "09:00", "work"), ("09:00", "10:00", "work")), "header", 1),
    "a night too long": (
        write(("date", *HEAD), (date(2026, 3, 2), time(12), time(11, 30), "break")),
        "end first",
        2,
    ),
    "a failed formula": (write(HEAD, ("#REF!", "09:00", "work")), "time", 2),
}


@pytest.mark.parametrize(("content", "why", "line"), WRONG.values(), ids=WRONG)
def test_a_wrong_workbook_is_refused_with_its_reason_and_row(
    content: bytes, why: str, line: int | None
) -> None:
    with pytest.raises(UnusableDiary) as refusal:
        read_diary(content)

    assert (refusal.value.facts["why"], refusal.value.facts.get("line")) == (why, line)


def test_a_row_without_values_at_the_end_of_the_sheet_is_nothing() -> None:
    formatted = b'<row r="1048576" ht="30"></row></sheetData>'

    assert read_diary(change(GOOD, SHEET, b"</sheetData>", formatted)) == read_diary(GOOD)


def test_every_wrong_row_of_every_sheet_is_named_at_once() -> None:
    content = write(
        HEAD, ("noon", "", "work"), ("08:00", "09:00", "wrok"), Friday=[HEAD, ("08:00", "09:00", "brake")]
    )

    with pytest.raises(UnusableDiary) as refusal:
        read_diary(content)

    rows = split_facts(refusal.value.facts)
    assert [(row["sheet"], row["line"], row["why"]) for row in rows] == [
        ("Sheet", 2, "time"),
        ("Sheet", 3, "kind"),
        ("Friday", 2, "kind"),
    ]
