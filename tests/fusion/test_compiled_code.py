"""Where the compiled kernels are kept."""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from fusion.numba_kernels import _copy_compiled

TELL = "from fusion.numba_kernels import make_kernel_folder; print(make_kernel_folder())"
IMPORT_ALL = "import os, fusion; [getattr(fusion, name) for name in fusion.__all__]"
CALL = "from fusion.numba_kernels import make_ready; make_ready()"
LOADED = f"import sys; {CALL}; print(*sorted({{'numba.np.arraymath', 'scipy.linalg'}} & set(sys.modules)))"


def tell_folder(given: Path, base: Path) -> Path:
    environment = os.environ | {"NUMBA_CACHE_DIR": str(given), "XDG_CACHE_HOME": str(base)}
    told = subprocess.run([sys.executable, "-c", TELL], env=environment, capture_output=True, check=True)
    return Path(told.stdout.decode().strip())


def run_away(program: str, home: Path, temporary: Path) -> None:
    """Run a program as a user with this home and this folder for temporary files, neither named otherwise."""
    environment = {k: v for k, v in os.environ.items() if k not in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME")}
    environment |= {"HOME": str(home), "TMPDIR": str(temporary), "PYTHONDONTWRITEBYTECODE": "1"}
    subprocess.run([sys.executable, "-c", program], env=environment, check=True)


def list_files(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.rglob("*") if path.is_file())


@pytest.fixture
def read_only(tmp_path: Path) -> Iterator[Path]:
    """A folder with a compiled kernel on a disk that cannot be written, as in a container."""
    folder = tmp_path / "compiled"
    (folder / "fusion").mkdir(parents=True)
    (folder / "fusion" / "kernel.nbc").write_bytes(b"code")
    if os.geteuid() == 0:  # who may write everywhere but on a disk mounted to be read
        subprocess.run(["mount", "--bind", str(folder), str(folder)], check=True)
        subprocess.run(["mount", "-o", "remount,bind,ro", str(folder)], check=True)
        yield folder
        subprocess.run(["umount", str(folder)], check=True)
        return
    for place in (folder / "fusion", folder):
        place.chmod(0o500)
    yield folder
    folder.chmod(0o700)


def test_a_folder_that_can_be_written_is_used_as_it_is(tmp_path: Path) -> None:
    given = tmp_path / "kernels"
    given.mkdir()

    assert tell_folder(given, tmp_path / "base") == given


def test_what_is_compiled_on_a_read_only_disk_is_copied_to_where_numba_can_write(
    read_only: Path, tmp_path: Path
) -> None:
    used = tell_folder(read_only, tmp_path / "base")

    assert used != read_only
    assert (used / "fusion" / "kernel.nbc").read_bytes() == b"code"


def test_the_copy_is_whole_and_leaves_nothing_beside_it(tmp_path: Path) -> None:
    given, folder = tmp_path / "given", tmp_path / "home" / "kernels"
    (given / "fusion").mkdir(parents=True)
    (given / "fusion" / "kernel.nbc").write_bytes(b"code")
    folder.mkdir(parents=True)

    _copy_compiled(given, folder)

    assert (folder / "fusion" / "kernel.nbc").read_bytes() == b"code"
    assert [path.name for path in folder.parent.iterdir()] == ["kernels"]


def test_a_folder_in_use_is_not_filled_again(tmp_path: Path) -> None:
    given, folder = tmp_path / "given", tmp_path / "kernels"
    given.mkdir()
    (given / "old.nbc").touch()
    folder.mkdir()
    (folder / "new.nbc").touch()

    _copy_compiled(given, folder)

    assert [path.name for path in folder.iterdir()] == ["new.nbc"]


def test_an_import_of_every_public_name_writes_nothing_and_sets_nothing(tmp_path: Path) -> None:
    home, temporary = tmp_path / "home", tmp_path / "tmp"
    home.mkdir()
    temporary.mkdir()

    run_away(f"{IMPORT_ALL}; assert 'NUMBA_CACHE_DIR' not in os.environ", home, temporary)

    assert not [*home.iterdir(), *temporary.iterdir()]


def test_the_first_kernel_that_runs_is_kept_in_the_private_folder(tmp_path: Path) -> None:
    home, temporary = tmp_path / "home", tmp_path / "tmp"
    home.mkdir()
    temporary.mkdir()

    run_away(CALL, home, temporary)

    (folder,) = (home / ".cache" / "acromion").iterdir()
    assert folder.stat().st_mode & 0o777 == 0o700
    assert any(name.startswith("numba_kernels._add_one") for name in list_files(folder))
    assert not [*temporary.iterdir()]


def test_with_a_read_only_home_compiled_code_is_kept_among_the_temporary_files(
    read_only: Path, tmp_path: Path
) -> None:
    temporary = tmp_path / "tmp"
    temporary.mkdir()

    run_away(CALL, read_only, temporary)

    assert any(name.startswith("numba_kernels._add_one") for name in list_files(temporary))


def test_where_nothing_can_be_written_kernels_run_all_the_same(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.touch()
    program = f"import tempfile; tempfile.tempdir = {str(blocked)!r}; {CALL}"

    run_away(program, blocked, tmp_path)

    assert list_files(tmp_path) == ["file"]


def test_a_kernel_that_was_compiled_before_runs_without_what_only_the_compiler_needs(tmp_path: Path) -> None:
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}

    def run() -> str:
        command = [sys.executable, "-c", LOADED]
        return subprocess.run(
            command, env=environment, capture_output=True, text=True, check=True
        ).stdout.strip()

    assert run() == "numba.np.arraymath scipy.linalg"
    assert run() == ""


def test_a_kernel_that_was_compiled_before_takes_and_gives_arrays() -> None:
    program = (
        "import numpy as np; from fusion.sensor.model import solve_band;"
        "print(*solve_band(np.array([[4.0, 5.0], [2.0, 0.0]]), np.array([[6.0, 7.0]]))[0])"
    )

    def run() -> str:
        command = [sys.executable, "-c", program]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()

    assert run() == "1.0 1.0"
    assert run() == "1.0 1.0"
