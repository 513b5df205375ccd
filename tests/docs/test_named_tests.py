"""Tests named in the docs exist; the table of ASVS 5.0 has a line for each requirement of levels 1 and 2."""

import csv
import re
from collections.abc import Iterator

import pytest

from tests import ROOT

with (ROOT / "docs" / "reference" / "asvs.csv").open(encoding="utf-8", newline="") as _file:
    ASVS = list(csv.DictReader(_file))
SECTIONS = """
    1.1 2, 1.2 9, 1.3 11, 1.4 3, 1.5 2, 2.1 3, 2.2 3, 2.3 4, 2.4 1, 3.2 2, 3.3 4, 3.4 6, 3.5 5, 3.7 2, 4.1 3,
    4.2 1, 4.3 2, 4.4 4, 5.1 1, 5.2 3, 5.3 2, 5.4 3, 6.1 3, 6.2 12, 6.3 4, 6.4 4, 6.5 5, 6.6 3, 6.8 4, 7.1 3,
    7.2 4, 7.3 2, 7.4 5, 7.5 2, 7.6 2, 8.1 2, 8.2 3, 8.3 1, 8.4 1, 9.1 3, 9.2 4, 10.1 2, 10.2 2, 10.3 4,
    10.4 11, 10.5 5, 10.6 2, 10.7 3, 11.1 2, 11.2 3, 11.3 3, 11.4 4, 11.5 1, 11.6 1, 12.1 3, 12.2 2, 12.3 4,
    13.1 1, 13.2 5, 13.3 2, 13.4 5, 14.1 2, 14.2 4, 14.3 3, 15.1 3, 15.2 3, 15.3 7, 16.1 1, 16.2 5, 16.3 4,
    16.4 3, 16.5 3, 17.1 1, 17.2 4, 17.3 2
"""
"""Each section with the number of its requirements of levels 1 and 2, which come before those of level 3."""

EVIDENCE = {"review", "trial", "site"}
"""What shows a requirement besides tests, linter rules and documents: reading the code, a trial, the site."""


def list_tests() -> set[str]:
    code = "\n".join(path.read_text("utf-8") for path in (ROOT / "tests").rglob("test_*.py"))
    return set(re.findall(r"^(?:async )?def (test_\w+)", code, re.MULTILINE))


def list_evidence() -> Iterator[tuple[str, str]]:
    for row in ASVS:
        for one in filter(None, row["shown by"].split("; ")):
            yield row["requirement"], one


def test_each_requirement_has_one_line() -> None:
    sections = [section.split() for section in SECTIONS.split(",")]
    wanted = [f"{section}.{number + 1}" for section, count in sections for number in range(int(count))]

    assert [row["requirement"] for row in ASVS] == wanted
    assert {row["level"] for row in ASVS} == {"1", "2"}


def test_every_test_that_the_intended_use_names_exists() -> None:
    page = (ROOT / "docs" / "it" / "intended-use.md").read_text("utf-8")

    named = set(re.findall(r"\b(test_\w+)\b(?!\.py)", page))

    assert named
    assert named - list_tests() == set()


def test_everything_that_shows_a_requirement_exists() -> None:
    tests = list_tests()

    unknown = [
        (requirement, one)
        for requirement, one in list_evidence()
        if one not in tests | EVIDENCE and not one.startswith("ruff S") and not (ROOT / one).is_file()
    ]

    assert unknown == []


@pytest.mark.parametrize("row", ASVS, ids=lambda row: row["requirement"])
def test_a_requirement_that_is_met_is_shown_and_another_says_why(row: dict[str, str]) -> None:
    assert row["state"] in {"met", "missed", "site", "not applicable"}
    assert row["shown by"] if row["state"] == "met" else row["note"]


def test_the_page_of_security_names_what_is_missed() -> None:
    page = (ROOT / "docs" / "it" / "security.md").read_text("utf-8")

    named = re.findall(r"^\| ([\d.]+) \| ([12]) \|", page, re.MULTILINE)

    assert named == [(row["requirement"], row["level"]) for row in ASVS if row["state"] == "missed"]
