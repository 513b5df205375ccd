"""Where the compiled kernels are kept."""

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from acromion.fusion.numba_kernels import _copy_compiled, make_kernel_folder

IMPORT_ALL = "import os, fusion; [getattr(fusion, name) for name in fusion.__all__]"
CALL = "from acromion.fusion.numba_kernels import make_ready; make_ready()"
LOADED = f"import sys; {CALL}; print(*sorted({{'numba.np.arraymath', 'scipy.linalg'}} & set(sys.modules)))"
SOLVE = (
    "import numpy as np; from acromion.fusion.sensor.model import solve_band;"
    "print(*solve_band(np.array([[4.0, 5.0], [2.0, 0.0]]), np.array([[6.0, 7.0]]))[0])"
)


def run(program: str, without: tuple[str, ...] = (), **environment: Path) -> str:
    kept = {name: value for name, value in os.environ.items() if name not in without}
    kept |= {name: str(value) for name, value in environment.items()}
    command = [sys.executable, "-B", "-c", program]
    return subprocess.run(command, env=kept, capture_output=True, text=True, check=True).stdout.strip()


def list_files(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.rglob("*") if path.is_file())


@pytest.fixture
def read_only(tmp_path: Path) -> Iterator[Path]:
    """Make a folder with a compiled kernel on a disk that cannot be written, as in a container."""
    folder = tmp_path / "compiled"
    (folder / "fusion").mkdir(parents=True)
    (folder / "fusion" / "kernel.nbc").write_bytes(b"code")
    if os.geteuid() == 0:  # root may write everywhere but on a disk mounted to be read
        subprocess.run(["mount", "--bind", str(folder), str(folder)], check=True)
        subprocess.run(["mount", "-o", "remount,bind,ro", str(folder)], check=True)
        yield folder
        subprocess.run(["umount", str(folder)], check=True)
        return
    for place in (folder / "fusion", folder):
        place.chmod(0o500)
    yield folder
    folder.chmod(0o700)


def find_folder(monkeypatch: pytest.MonkeyPatch, **environment: Path) -> Path:
    for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, str(value))
    found = make_kernel_folder.__wrapped__()
    assert found is not None
    return found


def test_a_folder_that_can_be_written_is_used_as_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = tmp_path / "kernels"

    assert find_folder(monkeypatch, NUMBA_CACHE_DIR=given, XDG_CACHE_HOME=tmp_path / "base") == given


def test_what_is_compiled_on_a_read_only_disk_is_copied_to_a_folder_that_numba_can_write(
    read_only: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    used = find_folder(monkeypatch, NUMBA_CACHE_DIR=read_only, XDG_CACHE_HOME=tmp_path / "base")

    assert used.is_relative_to(tmp_path / "base")
    assert (used / "fusion" / "kernel.nbc").read_bytes() == b"code"


def test_with_a_read_only_home_compiled_code_is_kept_among_the_temporary_files(
    read_only: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "tmp"))

    assert find_folder(monkeypatch, HOME=read_only).is_relative_to(tmp_path / "tmp")


def test_the_copy_is_whole_leaves_nothing_beside_it_and_fills_no_folder_in_use(tmp_path: Path) -> None:
    given, folder = tmp_path / "given", tmp_path / "home" / "kernels"
    (given / "fusion").mkdir(parents=True)
    (given / "fusion" / "kernel.nbc").write_bytes(b"code")
    folder.mkdir(parents=True)

    _copy_compiled(given, folder)
    (given / "old.nbc").touch()
    _copy_compiled(given, folder)

    assert list_files(folder) == ["kernel.nbc"]
    assert [path.name for path in folder.parent.iterdir()] == ["kernels"]


def test_an_import_writes_nothing_and_the_first_kernel_that_runs_is_kept_in_the_private_folder(
    tmp_path: Path,
) -> None:
    home, temporary = tmp_path / "home", tmp_path / "tmp"
    home.mkdir()
    temporary.mkdir()
    nothing = f"assert not os.listdir({str(home)!r}) and 'NUMBA_CACHE_DIR' not in os.environ"

    run(
        f"{IMPORT_ALL}; {nothing}; {CALL}", ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME"), HOME=home, TMPDIR=temporary
    )

    (folder,) = (home / ".cache" / "acromion").iterdir()
    assert folder.stat().st_mode & 0o777 == 0o700
    assert any(name.startswith("numba_kernels._add_one") for name in list_files(folder))
    assert not [*temporary.iterdir()]


def test_if_nothing_can_be_written_kernels_run_all_the_same(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.touch()

    run(
        f"import tempfile; tempfile.tempdir = {str(blocked)!r}; {CALL}",
        ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME"),
        HOME=blocked,
        TMPDIR=tmp_path,
    )

    assert list_files(tmp_path) == ["file"]


def test_a_kernel_that_was_compiled_before_runs_without_what_only_the_compiler_needs(tmp_path: Path) -> None:
    first, again = (run(LOADED, NUMBA_CACHE_DIR=tmp_path) for _ in range(2))

    assert (first, again) == ("numba.np.arraymath scipy.linalg", "")


def test_a_kernel_that_was_compiled_before_takes_and_gives_arrays() -> None:
    assert [run(SOLVE) for _ in range(2)] == ["1.0 1.0"] * 2
