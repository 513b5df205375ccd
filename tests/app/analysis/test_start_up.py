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


COMPILED = {"numba", "scipy", "pyarrow", "typst"}
OF_THE_COMMAND = {"numpy", "pydantic", "yaml", "jinja2", "xlsxwriter", "psutil", "sqlalchemy", "asyncio"}
SLOW = {
    *("pandas", "scipy.linalg", "scipy.special", "scipy.signal", "scipy.ndimage", "scipy.stats"),
    *("pyarrow.compute", "pyarrow.dataset", "http.client", "unittest", "numpy.testing"),
    *("pydantic", "sqlalchemy"),
}


@pytest.mark.parametrize(
    ("modules", "heavy"),
    [
        ("app.main, app.jobs.worker", COMPILED),
        ("app.cli", COMPILED | OF_THE_COMMAND),
        ("app.cli, app.batch.tables", {"numpy", "pydantic"}),
        ("app.start", {"typer", "app.cli", "app.settings", "numpy"}),
        ("app.report.render.write, app.report.pairs", {"numba", "scipy", "pandas", "pyarrow"}),
        ("app.roads.analyse", SLOW),
        ("app.jobs.children.preloaded", SLOW),
    ],
)
def test_a_process_loads_only_what_it_needs(modules: str, heavy: set[str]) -> None:
    assert find_loaded(modules, heavy) == ""


def test_writing_the_tables_does_not_load_pandas() -> None:
    program = (
        "import sys, numpy; from app.report.export.parquet import *; from app.report.export.all import *;"
        "encode_parquet([]); lay_numbers(numpy.zeros(1)); lay_flags(numpy.ones(1, bool));"
        "print('pandas' in sys.modules)"
    )

    loaded = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)

    assert loaded.stdout.strip() == "False"
