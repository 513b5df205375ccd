"""What a process loads, compiles first, and calls its revision."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from acromion.app import version
from acromion.app.analysis.fork_server import LOCK, _lock_preparation, report_preparing
from acromion.app.request import Stage
from acromion.fusion import numba_kernels
from acromion.fusion.numba_kernels import DONE, USUAL_KERNELS
from tests import ROOT

COMPILED = {"numba", "scipy", "pyarrow", "typst"}
OF_THE_COMMAND = {"numpy", "pydantic", "yaml", "jinja2", "xlsxwriter", "psutil", "sqlalchemy", "asyncio"}
SLOW = {
    *("pandas", "scipy.linalg", "scipy.special", "scipy.signal", "scipy.ndimage", "scipy.stats"),
    *("pyarrow.compute", "pyarrow.dataset", "http.client", "unittest", "numpy.testing"),
    *("pydantic", "sqlalchemy"),
}

WRITE_TABLES = (
    "import numpy; from acromion.app.report.export.all import *;"
    "encode_parquet('summary', []); build_numbers(numpy.zeros(1)); build_flags(numpy.ones(1, bool))"
)


@pytest.mark.parametrize(
    "steps",
    [
        [
            ("import acromion.app.start", {"typer", "acromion.app.cli", "acromion.app.settings", "numpy"}),
            ("import acromion.app.cli", COMPILED | OF_THE_COMMAND),
            ("import acromion.app.batch.tables", {"numpy", "pydantic"}),
            ("import acromion.app.main, acromion.app.queue.worker", COMPILED),
        ],
        [
            (
                "import acromion.app.report.render.write, acromion.app.report.pairs",
                {"numba", "scipy", "pandas", "pyarrow"},
            ),
            ("import acromion.app.analysis.run", SLOW),
            ("import acromion.app.analysis.preloaded", SLOW),
            (WRITE_TABLES, {"pandas"}),
        ],
    ],
    ids=["command and server", "analysis"],
)
def test_a_process_loads_only_what_it_needs(steps: list[tuple[str, set[str]]]) -> None:
    """Each step adds to what the process has loaded."""
    numba_kernels.make_ready()  # compiled once, as after the first start: the compiler loads more
    look = "print(*sorted({heavy} & set(sys.modules)))"
    program = "\n".join(f"{step}\n{look.format(heavy=heavy)}" for step, heavy in steps)

    done = subprocess.run(
        [sys.executable, "-c", f"import sys\n{program}"], capture_output=True, text=True, check=True
    )

    assert done.stdout.splitlines() == [""] * len(steps)


# The kernels are compiled once after an installation, and whoever waits for it is told.


@pytest.fixture
def kernels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of kernels in which nothing is compiled."""
    monkeypatch.setattr(numba_kernels, "make_kernel_folder", lambda: tmp_path)
    return tmp_path


def test_a_stage_is_told_as_preparing_until_all_is_compiled(kernels: Path) -> None:
    told: list[tuple[Stage, float]] = []
    listen = report_preparing(lambda stage, fraction: told.append((stage, fraction)))
    for number in range(USUAL_KERNELS // 2):
        (kernels / f"{number}.nbc").touch()

    listen("reading", 0.0)
    (kernels / DONE).touch()
    listen("checking", 0.45)

    assert told[0] == ("preparing", 0.5)
    assert told[-1] == ("checking", 0.45)


def test_the_writing_of_the_report_is_told_as_such(kernels: Path) -> None:
    assert list(kernels.iterdir()) == []
    told: list[tuple[Stage, float]] = []

    report_preparing(lambda stage, fraction: told.append((stage, fraction)))("rendering", 0.9)

    assert told == [("rendering", 0.9)]


def test_once_all_is_compiled_stages_are_told_as_they_are(kernels: Path) -> None:
    (kernels / DONE).touch()

    def listen(_stage: Stage, _fraction: float) -> None: ...

    assert report_preparing(listen) is listen


def test_only_one_prepares(tmp_path: Path) -> None:
    assert [_lock_preparation(tmp_path) for _ in range(2)] == [True, False]
    assert (tmp_path / LOCK).exists()


@pytest.mark.slow
def test_preparing_compiles_and_says_so(tmp_path: Path) -> None:
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}

    subprocess.run([sys.executable, "-m", "acromion.fusion.prepare"], check=True, env=environment)

    compiled = {path.name.split("-")[0] for path in tmp_path.rglob("*.nbc")}
    assert (tmp_path / DONE).exists()
    assert {"eva._scan_classes", "nodes._correct", "elevation._measure_angles"} <= compiled


# The revision is a fingerprint of every source file of the science and of the report.


@pytest.fixture
def copy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the sources, of which the revision is taken."""
    for name in ("fusion", "app/report"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(version, "_ROOT", tmp_path)
    return tmp_path


def find_revision() -> str:
    """Take the revision anew: it is computed once for each process."""
    return version.source_fingerprint.__wrapped__()


def test_a_change_in_any_folder_of_the_science_or_the_report_changes_the_revision(copy: Path) -> None:
    folders = sorted({path.parent for path in copy.rglob("*.py")})
    revisions = [find_revision()]

    for folder in folders:
        with next(folder.glob("*.py")).open("a") as file:
            file.write("# changed\n")
        revisions.append(find_revision())

    assert {"fusion", "readers", "exposure", "report", "charts"} <= {folder.name for folder in folders}
    assert len(set(revisions)) == 1 + len(folders)


def test_a_file_that_moves_or_comes_changes_the_revision(copy: Path) -> None:
    before = find_revision()

    next((copy / "fusion").glob("*.py")).rename(copy / "fusion" / "exposure" / "moved.py")
    moved = find_revision()
    (copy / "app" / "report" / "new").mkdir()
    (copy / "app" / "report" / "new" / "one.py").touch()

    assert len({before, moved, find_revision()}) == 3


def test_the_same_sources_have_the_same_revision(copy: Path) -> None:
    assert find_revision() == version.source_fingerprint()


def test_a_checkout_has_the_commit_of_git_and_anything_else_is_not_released(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = ["git", "-C", str(ROOT), "rev-parse", "--short=12", "HEAD"]
    commit = subprocess.run(asked, capture_output=True, text=True, check=False).stdout.strip()

    revision = version.source_revision.__wrapped__()
    monkeypatch.setattr(version, "_ROOT", tmp_path)
    installed = version.source_revision.__wrapped__()

    unreleased = f"{version.software_version()}, not released"
    assert (revision, installed) == (f"git {commit}" if commit else unreleased, unreleased)


def test_a_package_has_the_revision_that_was_written_when_it_was_built(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "app").mkdir()
    (tmp_path / "app" / "revision.txt").write_text("release 9.9.9\n")
    monkeypatch.setattr(version, "_ROOT", tmp_path)

    assert version.source_revision.__wrapped__() == "release 9.9.9"
