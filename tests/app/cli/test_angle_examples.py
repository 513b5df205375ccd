"""The examples of ``docs/batch.md`` read the angle of a finished analysis, as they stand there."""

import contextlib
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from acromion.app.report.export.angles import write_elevation
from acromion.fusion.elevation import Elevation, ElevationSegment
from tests import ROOT

PAGE = ROOT / "docs" / "batch.md"
EXAMPLES = re.findall(r"```python\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)


@pytest.fixture
def angle_folder(tmp_path: Path) -> Path:
    """A folder with four rows at 100 Hz: 10 deg, no sample, 70 deg, and 80 deg that is not trusted."""
    angle = np.array([10.0, 40.0, 70.0, 80.0], np.float32)
    valid = np.array([True, False, True, False])
    segment = ElevationSegment(0, 100.0, angle, valid, bridged=((1, 2),))
    write_elevation(Elevation((segment,), None), tmp_path / "elevation.parquet")
    return tmp_path


def run_example(of: str, folder: Path) -> dict[str, Any]:
    """Run the example that imports a package, in the folder; return its variables."""
    (example,) = (body for body in EXAMPLES if f"import {of}" in body)
    names: dict[str, Any] = {}
    with contextlib.chdir(folder):
        exec(example, names)
    return names


def test_our_own_example_gives_seconds_and_degrees(angle_folder: Path) -> None:
    table = run_example("read_elevation", angle_folder)["angles"]

    assert table["time_s"].tolist() == pytest.approx([0.0, 0.01, 0.02, 0.03])
    assert table["elevation_deg"].tolist() == pytest.approx([10.0, np.nan, 70.0, 80.0], nan_ok=True)
    assert table["valid"].tolist() == [True, False, True, False]


def test_the_example_with_pandas_does(angle_folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names = run_example("pandas", angle_folder)

    assert (names["time_s"].tolist(), names["elevation_deg"].tolist()) == ([0.0, 0.02], [10.0, 70.0])
    assert capsys.readouterr().out == "50.0 % above 60°\n"
