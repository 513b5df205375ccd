"""A process that only takes requests does not carry the science."""

import subprocess
import sys

import pytest


def find_loaded(module: str, heavy: set[str]) -> str:
    """Name the heavy modules that a new process has after importing ``module``."""
    program = f"import sys, {module}; print(*sorted({heavy} & set(sys.modules)))"
    return subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    ).stdout.strip()


@pytest.mark.parametrize("module", ["app.main", "app.cli", "app.jobs.worker"])
def test_taking_requests_loads_no_compiler(module: str) -> None:
    assert find_loaded(module, {"numba", "scipy", "pyarrow", "typst"}) == ""


def test_the_command_line_loads_no_numpy_before_the_child_runs() -> None:
    heavy = {"numpy", "pydantic", "yaml", "jinja2", "xlsxwriter", "psutil", "sqlalchemy", "asyncio"}

    assert find_loaded("app.cli", heavy) == ""


def test_writing_the_tables_of_a_run_loads_no_numpy() -> None:
    assert find_loaded("app.cli, app.batch.tables", {"numpy", "pydantic"}) == ""


def test_starting_the_fork_server_loads_nothing_of_the_command_line() -> None:
    assert find_loaded("app.start", {"typer", "app.cli", "app.settings", "numpy"}) == ""


@pytest.mark.parametrize("module", ["app.report.render.write", "app.report.pairs"])
def test_writing_a_report_loads_no_compiler(module: str) -> None:
    assert find_loaded(module, {"numba", "scipy", "pandas", "pyarrow"}) == ""


@pytest.mark.parametrize("module", ["app.roads.analyse", "app.jobs.children.preloaded"])
def test_the_road_leaves_out_packages_that_take_long_to_load(module: str) -> None:
    heavy = {"pandas", "scipy.linalg", "scipy.special", "scipy.signal", "scipy.ndimage", "scipy.stats"}
    heavy |= {"pyarrow.compute", "pyarrow.dataset", "http.client", "unittest", "numpy.testing"}
    heavy |= {"pydantic", "sqlalchemy"}

    assert find_loaded(module, heavy) == ""


def test_writing_the_tables_does_not_load_pandas() -> None:
    program = (
        "import sys, numpy; from app.report.export.parquet import *; from app.report.export.all import *;"
        "encode_parquet([]); lay_numbers(numpy.zeros(1)); lay_flags(numpy.ones(1, bool));"
        "print('pandas' in sys.modules)"
    )

    loaded = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)

    assert loaded.stdout.strip() == "False"
