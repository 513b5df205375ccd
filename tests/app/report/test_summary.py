"""summary.csv: one row for each recording, safe to open in a spreadsheet."""

import csv
import io
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from app.report.export.columns import encode_summary, summarise_failure
from app.report.export.csv import FRENCH_EXCEL, Origin, encode_table
from app.report.figures import SUMMARY

FAILED = Origin("left.gt3x", "S012", "left", "p1/left.gt3x", "left")
NAMES = [column.name for column in SUMMARY]


def read_rows(encoded: bytes) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(encoded.decode("utf-8"), newline="")))


def test_a_failed_recording_keeps_its_row_with_its_code_and_empty_figures() -> None:
    (row,) = read_rows(encode_summary([summarise_failure(FAILED, "E-EMPTY")]))

    assert (row["error_code"], row["time_above_60_percent"]) == ("E-EMPTY", "")


def test_each_column_stands_once_and_the_ends_of_a_range_beside_its_figure() -> None:
    assert len(set(NAMES)) == len(NAMES)
    assert {"time_above_60_percent_low", "elevation_p90_deg_high"} <= set(NAMES)


@given(st.sampled_from("=+-@\t\r"), st.text(max_size=20))
def test_no_text_cell_can_become_a_formula(start: str, rest: str) -> None:
    encoded = encode_table(["subject"], [{"subject": start + rest}])

    assert encoded.decode("utf-8").splitlines()[1].lstrip('"')[0] == "'"


def test_a_negative_number_stays_a_number() -> None:
    row: dict[str, Any] = {"bias_deg": -1.5}

    assert encode_table(["bias_deg"], [row]) == b"bias_deg\n-1.5\n"


def test_a_french_excel_gets_semicolons_commas_and_a_mark() -> None:
    encoded = encode_table(["subject", "angle_deg"], [{"subject": "S1", "angle_deg": 12.5}], FRENCH_EXCEL)

    assert encoded == "\ufeffsubject;angle_deg\r\nS1;12,5\r\n".encode()


def test_the_decimal_sign_of_text_is_left_alone() -> None:
    assert b"1.5 m" in encode_table(["label"], [{"label": "1.5 m"}], FRENCH_EXCEL)


@given(st.sampled_from(";,\t\n"), st.sampled_from("=+-@"), st.text(max_size=5))
def test_no_part_of_a_text_becomes_a_formula_for_a_reader_of_another_dialect(
    gap: str, start: str, rest: str
) -> None:
    text = encode_table(["label"], [{"label": f"a{gap}{start}{rest}"}]).decode("utf-8")

    assert f"{gap}{start}" not in text
