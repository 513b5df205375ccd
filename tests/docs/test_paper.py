"""The paper says of validation what the page of validation says, and cites what its bibliography holds."""

import re

import pytest

from tests import ROOT

DOCS = ROOT / "docs"
PAPER = (DOCS / "paper.md").read_text("utf-8")
VALIDATION = (DOCS / "validation.md").read_text("utf-8")
Row = tuple[str, str, str, str]


def read_rows(text: str) -> list[Row]:
    """Give figure, of, goal and reached of each row, without the marks of a goal that is missed."""
    found = re.findall(r"^\| (.+?) \| (.+?) \| ([<\d].*?) \| (.+?) \|", text, re.MULTILINE)
    return [(figure, of, goal, reached.replace("**", "")) for figure, of, goal, reached in found]


def list_single(rows: list[Row]) -> set[Row]:
    """Split a row of several data sets into one for each; rows of other tables are left out."""
    return {
        (figure, one, goal, value)
        for figure, of, goal, reached in rows
        if of.count("; ") == reached.count("; ")
        for one, value in zip(of.split("; "), reached.split("; "), strict=True)
    }


@pytest.mark.parametrize("row", read_rows(PAPER), ids=" ".join)
def test_a_row_of_the_paper_stands_in_validation(row: Row) -> None:
    assert row in list_single(read_rows(VALIDATION))


def test_the_paper_has_a_table_of_figures() -> None:
    assert len(read_rows(PAPER)) == 7


def test_the_goals_met_are_those_of_validation() -> None:
    told = re.findall(r"goals for the angle, (\d+ of \d+) are met", " ".join(PAPER.split()))

    assert told == re.findall(r"goals for the angle, (\d+ of \d+) are met", " ".join(VALIDATION.split()))


def test_every_work_that_is_cited_is_in_the_bibliography_and_the_other_way_round() -> None:
    held = set(re.findall(r"@\w+\{(\w+),", (DOCS / "paper.bib").read_text("utf-8")))

    assert set(re.findall(r"@(\w+)", PAPER.partition("# Summary")[2])) == held


def test_the_paper_has_the_parts_that_the_journal_asks_for() -> None:
    head = PAPER.split("---")[1]

    for name in ("title:", "tags:", "authors:", "affiliations:", "date:", "bibliography: paper.bib"):
        assert name in head
    for part in ("# Summary", "# Statement of need", "# Acknowledgements", "# References"):
        assert part in PAPER
