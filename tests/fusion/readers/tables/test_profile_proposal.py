"""What a mapping form is told of a table, and what it may answer."""

import pytest

from acromion.fusion.errors import UnknownColumns, UnknownFormat
from acromion.fusion.readers import ColumnProfile, check_profile, propose_profile
from tests.fusion.readers.tables.table_builder import CANON, line, table

UNNAMED = table(range(0, 2_000_000, 10_000), "k,p,q,r,u,v,w").encode()
ANSWERED = ColumnProfile(("p", "q", "r"), ("u", "v", "w"), "g", "dps", time="k", time_unit="us")


def test_a_header_with_units_gives_the_whole_profile() -> None:
    proposal = propose_profile(CANON.encode())

    assert proposal.profile == ColumnProfile(
        ("acc_x_g", "acc_y_g", "acc_z_g"),
        ("gyr_x_dps", "gyr_y_dps", "gyr_z_dps"),
        "g",
        "dps",
        time="time_us",
        time_unit="us",
    )


def test_of_names_that_say_nothing_the_time_is_found_by_its_steps() -> None:
    proposal = propose_profile(UNNAMED)

    assert proposal.columns == ("k", "p", "q", "r", "u", "v", "w")
    assert (proposal.time, proposal.time_unit) == ("k", "us")
    assert (proposal.acceleration, proposal.angular_rate, proposal.profile) == (None, None, None)


def test_without_a_header_columns_are_named_by_number() -> None:
    rows = "".join(f"{0.01 * k:.2f},{line(k)}\n" for k in range(200))

    proposal = propose_profile(rows.encode())

    assert (proposal.time, proposal.time_unit) == (1, "s")
    assert proposal.rows[1] == ("0.01", *line(1).split(","))


def test_what_the_form_answers_fits_the_table() -> None:
    check_profile(UNNAMED, ANSWERED)


def test_a_column_that_is_not_there_is_named() -> None:
    with pytest.raises(UnknownColumns) as refusal:
        check_profile(UNNAMED, ColumnProfile(("p", "q", "zz"), ("u", "v", "w")))

    assert str(refusal.value.facts["list"]).startswith("zz")


def test_a_column_named_twice_is_refused() -> None:
    with pytest.raises(UnknownColumns):
        check_profile(UNNAMED, ColumnProfile(("p", "q", "r"), ("r", "v", "w")))


def test_text_without_rows_of_numbers_has_no_profile() -> None:
    with pytest.raises(UnknownFormat):
        propose_profile(b"Dear reader,\nno numbers here.\n")
