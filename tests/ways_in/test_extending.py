"""The patches of ``docs/extend.md``, each laid over a copy of the software and used there."""

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests import ROOT

PAGE = ROOT / "docs" / "extend.md"
Extend = Callable[[str], Path]


@pytest.fixture
def extend(tmp_path: Path) -> Extend:
    """Lay a patch of the page over a copy of the software; gives its folder."""

    def make(name: str) -> Path:
        copy = tmp_path / "copy"
        ignored = shutil.ignore_patterns("__pycache__")
        for folder in ("app", "fusion", "templates", ".ci/package"):
            shutil.copytree(ROOT / folder, copy / folder, symlinks=True, ignore=ignored)
        found = re.search(rf"<!-- patch: {name} -->\n```diff\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)
        assert found
        laid = subprocess.run(["patch", "-p1", "--batch"], cwd=copy, input=found[1].encode(), check=False)
        assert laid.returncode == 0
        return copy

    return make


def run_there(copy: Path, *arguments: str) -> str:
    """Run this Python in the copy."""
    command = [sys.executable, *arguments]
    there = os.environ | {"PYTHONPATH": str(copy / ".ci" / "package")}
    return subprocess.run(
        command, cwd=copy, env=there, check=True, capture_output=True, text=True, timeout=300
    ).stdout


def test_the_figure_stands_in_the_results_and_is_explained_in_both_languages(
    extend: Extend, shift_gt3x: Path, tmp_path: Path
) -> None:
    run_there(extend("figure"), "-m", "acromion", "run", str(shift_gt3x), "-o", str(tmp_path / "out"))

    results = json.loads((tmp_path / "out" / shift_gt3x.stem / "results.json").read_bytes())
    found = results["exposure"]["recovery"]
    share = 100 * found["neutral_slow_percent"] / found["slow_percent"]
    assert found["neutral_of_slow_percent"] == pytest.approx(share, abs=1e-3)
    dictionary = (tmp_path / "out" / "dictionary.csv").read_text("utf-8")
    assert (
        "exposure.recovery.neutral_of_slow_percent,,%,share of the slow time with the arm down,"
        "part du temps lent avec le bras pendant"
    ) in dictionary


COUNT_RISES = """
import numpy as np
from acromion.app.live.cue_log import parse_rule
from acromion.app.report.words.wording import load_wording
from acromion.fusion.live.cues import CueWatch
from acromion.fusion.live.session import LiveRows

angle_deg = np.tile([20.0, 58.0, 62.0, 66.0, 62.0, 58.0, 66.0, 54.0], 4)  # one rise in each period
rows = LiveRows(np.arange(32) * 10_000, angle_deg, np.ones(32, bool))
print([cue.time_s for cue in CueWatch((parse_rule("count:60:2"),)).take(rows)])
print(load_wording("fr", "live")["cue"]["count"])
"""


def test_the_cue_comes_at_every_second_rise_and_has_its_words(extend: Extend) -> None:
    told = run_there(extend("cue"), "-c", COUNT_RISES).splitlines()

    # rises at the fourth row of each period of eight: rows 3, 11, 19, 27; every second of them
    assert told == ["[0.11, 0.27]", "{limit} levées au-dessus de {angle}°."]
