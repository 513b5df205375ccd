"""Layouts of single tables as people post them: which rows count, and what a refusal asks for."""

import pytest

from fusion.errors import UnknownColumns
from fusion.readers import ColumnProfile, propose_profile
from tests.fusion.readers.tables.table_builder import line, read_text
from tests.fusion.readers.tables.test_real_layouts import CHANNELS, ROWS, check_whole, make_rows, read_with

UNNAMED = ColumnProfile(("p", "q", "r"), ("u", "v", "w"), "g", "dps", time="k", time_unit="ms")
NUMBERED = ColumnProfile((2, 3, 4), (5, 6, 7), "g", "dps", time=1, time_unit="ms")


# A column of words is never a reason to leave a row out.


def make_noted(after: str, noted: str, header: str = "k,p,q,r,u,v,w,remark\n") -> str:
    """Write a remark in the last quarter of the rows, beyond the head that shows the columns."""
    rows = (f"{10 * k},{line(k)}{noted if 900 <= k < 1190 else after}\n" for k in range(ROWS))
    return header + "".join(rows)


@pytest.mark.parametrize("header", ["k,p,q,r,u,v,w,remark\n", "k,p,q,r,u,v,w\n", ""])
@pytest.mark.parametrize("noted", [",walk", ',"walk, fast"', ",7"])
def test_a_remark_in_some_rows_loses_no_row(header: str, noted: str) -> None:
    profile = UNNAMED if header else NUMBERED

    check_whole(read_with(make_noted(",", noted, header), profile))


def test_a_remark_is_not_read_under_a_known_header() -> None:
    recording = read_text(make_noted(",", ",walk", f"time_ms,{CHANNELS},remark\n"))

    check_whole(recording)
    assert recording.understood["ignored"] == "remark"


def test_the_form_shows_a_column_that_is_empty_in_the_first_rows() -> None:
    proposal = propose_profile(make_noted(",", ",walk").encode())

    assert proposal.columns == ("k", "p", "q", "r", "u", "v", "w", "remark")


# Rows with fewer fields than the header has names.

NARROW = f"n,time_ms,{CHANNELS}\n" + make_rows("{ms},{row}")


def test_rows_with_fewer_fields_than_names_are_a_matter_for_a_person() -> None:
    with pytest.raises(UnknownColumns) as refusal:
        read_text(NARROW)

    assert refusal.value.facts == {"list": f"n,time_ms,{CHANNELS}", "why": "narrow rows", "line": 2}
    assert propose_profile(NARROW.encode()).columns == ("",) * 7
    check_whole(read_with(NARROW, NUMBERED))


def test_last_fields_that_some_rows_lack_are_not_needed() -> None:
    rows = (f"{10 * k},{line(k)}{',25.0' if k % 10 == 0 else ''}\n" for k in range(ROWS))

    check_whole(read_text(f"time_ms,{CHANNELS},temperature\n" + "".join(rows)))


def test_a_row_that_was_cut_before_its_last_reading_is_left_out() -> None:
    lines = (f"time_ms,{CHANNELS},temperature\n" + make_rows("{ms},{row},25.0")).splitlines()
    lines[600] = lines[600].rsplit(",", 2)[0]

    flags = {flag.code: flag.count for flag in read_text("\n".join(lines) + "\n").flags}

    assert flags["W-ROWS-DROPPED"] == 1
