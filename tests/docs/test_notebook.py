"""The notebook: it runs, and is kept without what it printed."""

import nbformat
import pytest

from benchmarks.site.notebook import run_notebook
from tests import ROOT

NOTEBOOK = ROOT / "docs" / "code" / "recording_to_figure.ipynb"


@pytest.fixture(scope="module")
def kept() -> nbformat.NotebookNode:
    notebook: nbformat.NotebookNode = nbformat.read(NOTEBOOK, as_version=4)  # type: ignore[no-untyped-call]
    return notebook


def test_the_notebook_is_kept_without_outputs(kept: nbformat.NotebookNode) -> None:
    assert [cell.id for cell in kept.cells if cell.get("outputs") or cell.get("execution_count")] == []


def test_the_notebook_ends_with_the_share_of_the_report_and_a_count_within_a_tenth_of_a_point_of_it() -> None:
    *_, last = (cell for cell in run_notebook(NOTEBOOK).cells if cell.cell_type == "code")

    reported, counted = (float(word) for word in last.outputs[0].text.split() if word[0].isdigit())
    assert abs(reported - counted) < 0.1
