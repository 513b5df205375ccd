"""A release: what is refused, and what is in the packages."""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from benchmarks.release import NotReady, build_twice, check_changelog, check_citation, read_version
from hatch_build import PACKAGE, find_revision, link_folders
from tests import ROOT

SECONDS = 1_772_438_400
ENTRY = """# Changelog

## Unreleased

## 1.2.0 - 2026-03-02

### Added
- A figure.

## 1.1.0 - 2026-01-01
- Old.
"""


def test_a_changelog_with_an_entry_of_the_version_is_taken() -> None:
    check_changelog(ENTRY, "1.2.0")


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (ENTRY.replace("1.2.0", "1.1.9"), "no heading"),
        (ENTRY.replace("- A figure.\n", ""), "has no entry"),
        (ENTRY.replace("## Unreleased\n", "## Unreleased\n- A thing.\n"), "Unreleased"),
        (ENTRY.replace(" - 2026-03-02", ""), "no heading"),
    ],
    ids=["of another version", "a heading alone", "unreleased entries", "no date"],
)
def test_a_changelog_that_does_not_tell_what_is_in_the_version_is_refused(text: str, reason: str) -> None:
    with pytest.raises(NotReady, match=reason):
        check_changelog(text, "1.2.0")


def test_the_citation_names_the_version_of_the_package() -> None:
    check_citation(ROOT, read_version(ROOT))


def test_a_citation_of_another_version_is_refused() -> None:
    with pytest.raises(NotReady, match=r"not 9\.9\.9"):
        check_citation(ROOT, "9.9.9")


@pytest.fixture(scope="module")
def packages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The packages of a copy of the work tree, built twice; a difference is refused."""
    folder = tmp_path_factory.mktemp("packages")
    copied = shutil.ignore_patterns(".venv", ".git", "__pycache__", ".*_cache", ".hypothesis", "out", "dist")
    shutil.copytree(ROOT, folder / "copy", symlinks=True, ignore=copied)
    build_twice(folder / "copy", folder / "dist", SECONDS)
    return folder / "dist"


def test_two_builds_and_one_from_the_archive_give_the_same_bytes(packages: Path) -> None:
    assert [path.suffix for path in sorted(packages.iterdir())] == [".whl", ".gz"]


def test_every_file_in_the_wheel_has_the_time_that_was_asked_for(packages: Path) -> None:
    (wheel,) = packages.glob("*.whl")

    assert {one.date_time for one in zipfile.ZipFile(wheel).infolist()} == {(2026, 3, 2, 8, 0, 0)}


@pytest.fixture(scope="module")
def unpacked(packages: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel unpacked, as pip lays it, far from the work tree."""
    folder = tmp_path_factory.mktemp("unpacked")
    (wheel,) = packages.glob("*.whl")
    zipfile.ZipFile(wheel).extractall(folder)
    return folder


def run_from(folders: list[Path], code: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run code with packages from these folders first."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, folders))}
    command = [sys.executable, "-P", "-c", code]
    return subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, check=False)


COMMAND = "import sys; sys.argv = ['acromion', *{}]; from acromion.app.start import main; main()"


def test_the_wheel_simulates_analyses_and_reports_without_the_work_tree(
    unpacked: Path, tmp_path: Path
) -> None:
    done = run_from([unpacked], COMMAND.format(["demo", "--hours", "0.1", "-o", "out"]), tmp_path)
    where = run_from([unpacked], "import acromion; print(acromion.__file__)", tmp_path)

    assert done.returncode == 0, done.stderr
    assert where.stdout.strip() == str(unpacked / "acromion" / "__init__.py")
    assert next(tmp_path.glob("out/*/report.pdf")).read_bytes().startswith(b"%PDF")


def test_a_wheel_that_the_release_program_built_is_a_release(unpacked: Path) -> None:
    assert (unpacked / "acromion" / "app" / "revision.txt").read_text() == "release 0.1.0\n"


def test_a_package_that_anybody_else_builds_is_of_a_commit_or_not_released(tmp_path: Path) -> None:
    assert find_revision(tmp_path, "0.1.0") == "0.1.0, not released"

    for words in (["init", "-q"], ["commit", "-q", "--allow-empty", "-m", "Begin"]):
        who = ["-c", "user.name=A", "-c", "user.email=a@b.ca"]
        subprocess.run(["git", "-C", str(tmp_path), *who, *words], check=True)
    asked = ["git", "-C", str(tmp_path), "rev-parse", "HEAD"]
    commit = subprocess.run(asked, capture_output=True, text=True, check=True).stdout

    assert find_revision(tmp_path, "0.1.0") == f"git {commit[:12]}"


def test_the_wheel_contains_one_package_and_its_description(unpacked: Path) -> None:
    assert sorted(path.name for path in unpacked.iterdir()) == ["acromion", "acromion-0.1.0.dist-info"]


def test_the_wheel_works_beside_other_packages_called_app_and_fusion(unpacked: Path, tmp_path: Path) -> None:
    for name in ("app", "fusion"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("raise SystemExit('theirs ran')\n")

    done = run_from([tmp_path, unpacked], COMMAND.format(["demo", "--hours", "0.1", "-o", "out"]), tmp_path)

    assert done.returncode == 0, done.stderr
    assert "theirs ran" not in done.stdout + done.stderr


def test_an_editable_installation_links_the_folders_of_the_package(tmp_path: Path) -> None:
    for folder in (PACKAGE, "app", "fusion"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "app" / "start.py").touch()

    link_folders(tmp_path)
    link_folders(tmp_path)  # a second installation finds them

    assert (tmp_path / PACKAGE / "app" / "start.py").exists()
    assert (tmp_path / PACKAGE / "fusion").is_dir()
