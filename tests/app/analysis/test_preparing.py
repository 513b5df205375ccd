"""The kernels are compiled once after an installation, and whoever waits for it is told."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from app.jobs.children.preparing import LOCK, _take_turn, tell_preparing
from app.request import Stage
from fusion import numba_kernels
from fusion.numba_kernels import DONE, USUAL_KERNELS


@pytest.fixture
def kernels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of kernels in which nothing is compiled."""
    monkeypatch.setattr(numba_kernels, "make_kernel_folder", lambda: tmp_path)
    return tmp_path


def test_a_stage_is_told_as_preparing_until_all_is_compiled(kernels: Path) -> None:
    told: list[tuple[Stage, float]] = []
    listen = tell_preparing(lambda stage, fraction: told.append((stage, fraction)))
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

    tell_preparing(lambda stage, fraction: told.append((stage, fraction)))("rendering", 0.9)

    assert told == [("rendering", 0.9)]


def test_once_all_is_compiled_stages_are_told_as_they_are(kernels: Path) -> None:
    (kernels / DONE).touch()

    def listen(_stage: Stage, _fraction: float) -> None: ...

    assert tell_preparing(listen) is listen


def test_only_one_prepares(tmp_path: Path) -> None:
    assert [_take_turn(tmp_path) for _ in range(2)] == [True, False]
    assert (tmp_path / LOCK).exists()


@pytest.mark.slow
def test_preparing_compiles_and_says_so(tmp_path: Path) -> None:
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}

    subprocess.run([sys.executable, "-m", "fusion.prepare"], check=True, env=environment)

    compiled = {path.name.split("-")[0] for path in tmp_path.rglob("*.nbc")}
    assert (tmp_path / DONE).exists()
    assert {"eva._scan_classes", "nodes._correct", "elevation._measure_angles"} <= compiled
