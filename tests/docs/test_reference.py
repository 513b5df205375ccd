"""The generated pages of docs/reference are those of the code, and are known as generated."""

import pytest

from benchmarks.reference import REFERENCE, build_pages, write_api, write_cli
from tests import ROOT
from tests.docs.test_plain_words import GENERATED, list_written

PAGES = build_pages()


@pytest.mark.parametrize("name", PAGES)
def test_a_page_is_current(name: str) -> None:
    assert (REFERENCE / name).read_text("utf-8") == PAGES[name], "run python -m benchmarks.reference"


def test_every_page_of_the_reference_is_generated() -> None:
    assert [path for path in list_written() if path.parent == ROOT / "docs" / "reference"] == []
    assert all(path.read_text("utf-8").startswith(GENERATED) for path in REFERENCE.glob("*.md"))


@pytest.mark.parametrize("name", ["run", "serve", "trail show", "account add"])
def test_a_command_has_its_options(name: str) -> None:
    part = write_cli().split(f"## acromion {name}\n")[1].split("\n## ")[0]

    assert f"```text\nacromion {name} " in part
    assert "| `--" in part


def test_an_operation_has_its_parameters_its_body_and_its_answer() -> None:
    part = write_api().split("### POST /analyses\n")[1].split("\n### ")[0]

    assert "Body: `application/json` [AnalysisWish](#analysiswish)." in part
    assert "Responses: 202" in part
