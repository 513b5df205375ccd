"""summary.csv: one row for each recording, safe to open in a spreadsheet."""

import csv
import io
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from app.report.summary import (
    COLUMNS,
    encode_dictionary,
    encode_summary,
    encode_table,
    summarise_failure,
)

NAMES = [column.name for column in COLUMNS]


def read_rows(encoded: bytes) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(encoded.decode("utf-8"), newline="")))


def test_a_failed_recording_keeps_its_row_and_its_code() -> None:
    row = summarise_failure("left.gt3x", "S012", "E-EMPTY")

    assert read_rows(encode_summary([row]))[0]["error_code"] == "E-EMPTY"


def test_what_cannot_be_computed_is_empty() -> None:
    row = summarise_failure("left.gt3x", "S012", "E-EMPTY")

    assert read_rows(encode_summary([row]))[0]["time_above_60_percent"] == ""


def test_column_names_are_unique() -> None:
    assert len(set(NAMES)) == len(NAMES)


def test_every_column_is_explained_in_both_languages() -> None:
    explained = read_rows(encode_dictionary())

    assert [row["column"] for row in explained] == NAMES
    assert all(row["english"] and row["french"] for row in explained)


@given(st.sampled_from("=+-@\t\r"), st.text(max_size=20))
def test_no_text_cell_can_become_a_formula(start: str, rest: str) -> None:
    encoded = encode_table(["subject"], [{"subject": start + rest}])

    assert encoded.decode("utf-8").splitlines()[1].lstrip('"')[0] == "'"


def test_a_negative_number_stays_a_number() -> None:
    row: dict[str, Any] = {"bias_deg": -1.5}

    assert encode_table(["bias_deg"], [row]) == b"bias_deg\n-1.5\n"
