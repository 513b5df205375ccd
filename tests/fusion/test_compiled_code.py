"""Where the compiled kernels are kept."""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from fusion import _copy_compiled

TELL = "import os, fusion; print(os.environ['NUMBA_CACHE_DIR'])"


def tell_folder(given: Path, base: Path) -> Path:
    environment = os.environ | {"NUMBA_CACHE_DIR": str(given), "XDG_CACHE_HOME": str(base)}
    told = subprocess.run([sys.executable, "-c", TELL], env=environment, capture_output=True, check=True)
    return Path(told.stdout.decode().strip())


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
