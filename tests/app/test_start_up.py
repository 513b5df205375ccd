"""A process that only takes requests does not carry the science."""

import subprocess
import sys

import pytest


@pytest.mark.parametrize("module", ["app.main", "app.cli", "app.jobs.worker"])
def test_taking_requests_loads_no_compiler(module: str) -> None:
    heavy = {"numba", "scipy", "pyarrow", "typst"}
    program = f"import sys, {module}; print(*sorted({heavy} & set(sys.modules)))"

    loaded = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)

    assert loaded.stdout.strip() == ""


@pytest.mark.parametrize("module", ["app.report.render.write", "app.report.pair", "app.report.change"])
def test_writing_a_report_loads_no_compiler(module: str) -> None:
    heavy = {"numba", "scipy", "pandas", "pyarrow"}
    program = f"import sys, {module}; print(*sorted({heavy} & set(sys.modules)))"

    loaded = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)

    assert loaded.stdout.strip() == ""


def test_the_road_leaves_out_packages_that_take_long_to_load() -> None:
    heavy = {"pandas", "scipy.signal", "scipy.ndimage", "scipy.stats", "scipy.sparse"}
    program = f"import sys, app.roads.analyse; print(*sorted({heavy} & set(sys.modules)))"

    loaded = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)

    assert loaded.stdout.strip() == ""


def test_writing_the_tables_does_not_load_pandas() -> None:
    program = (
        "import sys, numpy; from app.report.export.parquet import *; from app.report.export.all import *;"
        "encode_parquet([]); lay_numbers(numpy.zeros(1)); lay_flags(numpy.ones(1, bool));"
        "print('pandas' in sys.modules)"
    )

    loaded = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)

    assert loaded.stdout.strip() == "False"
