"""The generated pages of docs/reference and docs/guide are those of the code, and are known as generated."""

import re

import pytest

from benchmarks.reference import DOCS, build_pages, write_api, write_cli
from tests.docs.test_plain_words import list_written

PAGES = build_pages()


@pytest.mark.parametrize("name", PAGES)
def test_a_page_is_current(name: str) -> None:
    assert (DOCS / name).read_text("utf-8") == PAGES[name], "run python -m benchmarks.reference"


def test_every_page_of_the_reference_is_generated() -> None:
    generated = [path for folder in ("reference", "guide") for path in (DOCS / folder).rglob("*.md")]

    assert len(generated) == 21
    assert set(generated) & set(list_written()) == set()


@pytest.mark.parametrize("name", ["run", "serve", "trail show", "account add"])
def test_a_command_has_its_options(name: str) -> None:
    part = write_cli().split(f"## acromion {name}\n")[1].split("\n## ")[0]

    assert f"```text\nacromion {name} " in part
    assert "| `--" in part


def test_an_operation_has_its_parameters_its_body_and_its_answer() -> None:
    part = write_api().split("### POST /analyses\n")[1].split("\n### ")[0]

    assert "Body: `application/json` [AnalysisWish](#analysiswish)." in part
    assert "Responses: 202" in part


def test_every_link_of_the_docs_also_leads_to_a_file_of_the_repository() -> None:
    pages = [page for page in DOCS.rglob("*.md") if page.parent != DOCS / "site"]
    dead = [
        (page.relative_to(DOCS).as_posix(), link)
        for page in pages
        for link in re.findall(r'(?:\]\(|src=")([^)"#\s]+)', page.read_text("utf-8"))
        if not re.match(r"[a-z]+:", link) and not (page.parent / link).exists()
    ]

    assert dead == []
