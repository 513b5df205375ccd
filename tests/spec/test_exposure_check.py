"""The table of oracles in docs/reference/exposure-check.md is that of the code."""

import pytest

from benchmarks.exposure_check import DOCUMENT, find_part, replace_part
from benchmarks.exposure_oracles import list_oracles, tell_oracles
from benchmarks.exposure_oracles_table import Oracle

ORACLES = list_oracles()


def test_every_oracle_is_met() -> None:
    assert [oracle.name for oracle in ORACLES if not oracle.is_met] == []


def read_rows(lines: list[str]) -> list[list[str]]:
    return [[cell.strip() for cell in line.strip("| ").split("|")] for line in lines if "| met" in line]


def test_the_document_says_what_the_code_gives() -> None:
    written = read_rows(find_part(DOCUMENT.read_text("utf-8"), "oracles").splitlines())
    now = read_rows(list(tell_oracles(ORACLES)))

    assert [row[:3] for row in written] == [row[:3] for row in now]
    assert [float(row[3]) for row in written] == pytest.approx([float(row[3]) for row in now], abs=1e-5)


def test_a_figure_that_fails_is_told_to_fail() -> None:
    told = list(tell_oracles([Oracle("1", "a share", 0.5, 0.6, 0.01)]))

    assert "**fails**" in told[2]
    assert told[-1] == "1 figures of 1 oracles, 1 fail."


def test_a_part_is_replaced_by_itself() -> None:
    document = "a\n<!-- cost -->\nold\n<!-- end of cost -->\nb\n<!-- oracles -->\n<!-- end of oracles -->\n"

    changed = replace_part(replace_part(document, "oracles", "x | 1"), "cost", "new\nlines")
    assert (find_part(changed, "cost"), find_part(changed, "oracles")) == ("new\nlines", "x | 1")
    assert changed.startswith("a\n")
