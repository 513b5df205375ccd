"""A process that only takes requests does not carry the science."""

import subprocess
import sys

import pytest

COMPILED = {"numba", "scipy", "pyarrow", "typst"}
OF_THE_COMMAND = {"numpy", "pydantic", "yaml", "jinja2", "xlsxwriter", "psutil", "sqlalchemy", "asyncio"}
SLOW = {
    *("pandas", "scipy.linalg", "scipy.special", "scipy.signal", "scipy.ndimage", "scipy.stats"),
    *("pyarrow.compute", "pyarrow.dataset", "http.client", "unittest", "numpy.testing"),
    *("pydantic", "sqlalchemy"),
}

WRITE_TABLES = (
    "import numpy; from app.report.export.parquet import *; from app.report.export.all import *;"
    "encode_parquet([]); lay_numbers(numpy.zeros(1)); lay_flags(numpy.ones(1, bool))"
)


@pytest.mark.parametrize(
    "steps",
    [
        [
            ("import app.start", {"typer", "app.cli", "app.settings", "numpy"}),
            ("import app.cli", COMPILED | OF_THE_COMMAND),
            ("import app.batch.tables", {"numpy", "pydantic"}),
            ("import app.main, app.jobs.worker", COMPILED),
        ],
        [
            ("import app.report.render.write, app.report.pairs", {"numba", "scipy", "pandas", "pyarrow"}),
            ("import app.roads.analyse", SLOW),
            ("import app.jobs.children.preloaded", SLOW),
            (WRITE_TABLES, {"pandas"}),
        ],
    ],
    ids=["command and server", "analysis"],
)
def test_a_process_loads_only_what_it_needs(steps: list[tuple[str, set[str]]]) -> None:
    """Each step adds to what the process has loaded."""
    look = "print(*sorted({heavy} & set(sys.modules)))"
    program = "\n".join(f"{step}\n{look.format(heavy=heavy)}" for step, heavy in steps)

    done = subprocess.run(
        [sys.executable, "-c", f"import sys\n{program}"], capture_output=True, text=True, check=True
    )

    assert done.stdout.splitlines() == [""] * len(steps)
