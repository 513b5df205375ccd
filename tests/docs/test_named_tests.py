"""Tests named in the docs exist; the table of ASVS 5.0 has a line for each requirement of levels 1 and 2."""

import re

import pytest

from tests import ROOT

PAGE = (ROOT / "docs" / "asvs_rest.md").read_text("utf-8")
SECTIONS = """
    1.1 2, 1.2 9, 1.3 11, 1.4 3, 1.5 2, 2.1 3, 2.2 3, 2.3 4, 2.4 1, 3.2 2, 3.3 4, 3.4 6, 3.5 5, 3.7 2, 4.1 3,
    4.2 1, 4.3 2, 4.4 4, 5.1 1, 5.2 3, 5.3 2, 5.4 3, 8.1 2, 8.2 3, 8.3 1, 8.4 1, 11.1 2, 11.2 3, 11.3 3,
    11.4 4, 11.5 1, 11.6 1, 12.1 3, 12.2 2, 12.3 4, 13.1 1, 13.2 5, 13.3 2, 13.4 5, 14.1 2, 14.2 4, 14.3 3,
    15.1 3, 15.2 3, 15.3 7, 16.1 1, 16.2 5, 16.3 4, 16.4 3, 16.5 3, 17.1 1, 17.2 4, 17.3 2
"""
"""Each section with the number of its requirements of levels 1 and 2, which come before those of level 3."""


def test_each_requirement_has_one_line() -> None:
    sections = [section.split() for section in SECTIONS.split(",")]
    wanted = [f"{section}.{number + 1}" for section, count in sections for number in range(int(count))]

    lines = re.findall(r"^\| ([\d.]+) \| [12] \|", PAGE, re.MULTILINE)

    assert lines == wanted


@pytest.mark.parametrize("page", ["asvs.md", "asvs_rest.md", "behaviours.md", "intended-use.md"])
def test_every_test_that_a_table_names_exists(page: str) -> None:
    code = "\n".join(path.read_text("utf-8") for path in (ROOT / "tests").rglob("test_*.py"))
    written = set(re.findall(r"^(?:async )?def (test_\w+)", code, re.MULTILINE))

    named = set(re.findall(r"\b(test_\w+)\b(?!\.py)", (ROOT / "docs" / page).read_text("utf-8")))

    assert named
    assert named - written == set()


def test_a_line_without_a_test_says_why() -> None:
    marks = re.compile(r"†|–|\*\*(paper|missed|rule|tried|review)\*\*")
    lines = re.findall(r"^\| [\d.]+ \| [12] \| (.*) \| \|$", PAGE, re.MULTILINE)

    assert [line for line in lines if not marks.search(line)] == []
