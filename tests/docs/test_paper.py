"""The paper and the page of validation give the figures of the validation tables; citations are complete."""

import re

import pytest

from tests import ROOT

DOCS = ROOT / "docs"
PAPER = (DOCS / "paper.md").read_text("utf-8")
VALIDATION = (DOCS / "validation.md").read_text("utf-8")
TABLES = (DOCS / "reference" / "validation.md").read_text("utf-8")
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


ROWS = {
    "paper": read_rows(PAPER),
    "validation": [row for row in read_rows(VALIDATION) if row[2].startswith("<=")],
}
"""The rows with a goal; other tables of the page have none."""


@pytest.mark.parametrize("row", [row for rows in ROWS.values() for row in rows], ids=" ".join)
def test_a_row_of_a_page_is_in_the_tables(row: Row) -> None:
    assert row in list_single(read_rows(TABLES))


def test_the_pages_have_a_table_of_figures() -> None:
    assert {page: len(rows) for page, rows in ROWS.items()} == {"paper": 7, "validation": 8}


@pytest.mark.parametrize("page", [PAPER, VALIDATION])
def test_the_goals_met_are_those_of_the_tables(page: str) -> None:
    told = re.findall(r"goals for the angle, (\d+ of \d+) are met", " ".join(page.split()))

    assert told == re.findall(r"goals for the angle, (\d+ of \d+) are met", " ".join(TABLES.split()))


def list_figures(text: str) -> set[str]:
    """Return the numbers with decimals, which name what was measured."""
    return set(re.findall(r"\d+\.\d+", text))


def test_every_measured_figure_of_the_page_is_in_the_tables() -> None:
    """A few come from elsewhere: a goal's bound in seconds, figures of runs that the tables leave out."""
    others = {"0.02", "1.00", "2.0", "0.302", "0.305", "0.65", "0.20", "0.3"}

    assert list_figures(VALIDATION.split("## Simulated shifts")[1]) - list_figures(TABLES) - others == set()


def test_every_work_that_is_cited_is_in_the_bibliography_and_the_other_way_round() -> None:
    held = set(re.findall(r"@\w+\{(\w+),", (DOCS / "paper.bib").read_text("utf-8")))

    assert set(re.findall(r"@(\w+)", PAPER.partition("# Summary")[2])) == held


def test_the_paper_has_the_parts_that_the_journal_asks_for() -> None:
    head = PAPER.split("---")[1]

    for name in ("title:", "tags:", "authors:", "affiliations:", "date:", "bibliography: paper.bib"):
        assert name in head
    for part in ("# Summary", "# Statement of need", "# Acknowledgements", "# References"):
        assert part in PAPER
