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


@pytest.mark.parametrize("module", ["app.report.writing", "app.report.both_arms", "app.report.before_after"])
def test_writing_a_report_loads_no_compiler(module: str) -> None:
    heavy = {"numba", "scipy", "pandas", "pyarrow"}
    program = f"import sys, {module}; print(*sorted({heavy} & set(sys.modules)))"

    loaded = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)

    assert loaded.stdout.strip() == ""
