"""The revision is a fingerprint of every source file of the science and of the report."""

import shutil
from pathlib import Path

import pytest

from app import version
from tests import ROOT


@pytest.fixture
def copy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the sources, of which the revision is taken."""
    for name in ("fusion", "app/report"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(version, "_ROOT", tmp_path)
    return tmp_path


def find_revision() -> str:
    """Take the revision anew: it is computed once for each process."""
    return version.software_revision.__wrapped__()


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
    assert find_revision() == version.software_revision()
