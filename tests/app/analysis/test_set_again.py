"""A report with another label is set again from its figures, with the bytes of a full analysis."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from acromion.app.analysis.run import make_report
from acromion.app.report.products import MEASURED, set_report_again
from acromion.app.request import LABEL, Conclusion, ReportRequest
from acromion.app.store.decoded import DecodedCache
from acromion.app.store.folder import KnownFiles
from acromion.fusion.diary import DiaryEntry
from acromion.fusion.simulation import write_recordings

NAME = "S012_right.gt3x"
ASKED = ReportRequest(NAME, "S012", "right", kinds=("html", "pdf"), diary=(DiaryEntry(20.0, 40.0, "break"),))
LABELS: dict[str, dict[str, Any]] = {
    "subject": {"subject": "S013"},
    "side": {"side": "left"},
    "trunk": {"side": "trunk"},
    "job": {"job_title": "Carpenter", "isco_code": "7115"},
    "conclusion": {"conclusion": Conclusion("Overhead work\nis the load.", "M. Tremblay", "2026-11-23")},
    "reason": {"reason": "wrong arm", "version": 2, "changes": ("side",)},
    "language": {"languages": ("fr-CA",)},
    "paper": {"paper": "letter", "appendix": True},
    "kinds": {"kinds": ("html",)},
    "the least hours of a day": {"min_hours": 2.0},
}


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_recordings(tmp_path_factory.mktemp("made"), "gt9x", 0.02, 12)[0]


@pytest.fixture(scope="module")
def finished(recording: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return analyse(recording, ASKED, tmp_path_factory.mktemp("finished"))


def analyse(recording: Path, request: ReportRequest, out: Path) -> Path:
    """Analyse the recording as a server does: with a cache, and therefore with the day for the page."""
    cache = DecodedCache(out.parent / "cache", 10_000_000)
    make_report(recording, request, out, known=KnownFiles(cache=cache))
    return out


def read_all(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.parametrize("label", LABELS)
def test_a_report_set_again_has_the_bytes_of_a_full_analysis(
    label: str, recording: Path, finished: Path, tmp_path: Path
) -> None:
    relabelled = replace(ASKED, **LABELS[label])
    (tmp_path / "set").mkdir()
    (tmp_path / "full").mkdir()
    set_report_again(finished / "results.json", relabelled, tmp_path / "set")

    full = read_all(analyse(recording, relabelled, tmp_path / "full"))

    measured = {name: (finished / name).read_bytes() for name in MEASURED}
    assert read_all(tmp_path / "set") | measured == full


def test_every_label_leaves_the_figures_alone() -> None:
    named = {name for label in LABELS.values() for name in label}

    assert named | {"draft"} == LABEL
    assert {str(replace(ASKED, **label).describe_figures(is_capture=False)) for label in LABELS.values()} == {
        str(ASKED.describe_figures(is_capture=False))
    }


def test_the_arm_of_a_motion_capture_is_measured() -> None:
    left = replace(ASKED, side="left")

    assert left.describe_figures(is_capture=True) != ASKED.describe_figures(is_capture=True)


def test_a_subject_whose_diary_has_other_rows_is_measured_again() -> None:
    diary = (DiaryEntry(20.0, 40.0, "break", file="S013"),)
    before = replace(ASKED, diary=diary)

    assert replace(before, subject="S014").describe_figures(is_capture=False) == before.describe_figures(
        is_capture=False
    )
    assert replace(before, subject="S013").describe_figures(is_capture=False) != before.describe_figures(
        is_capture=False
    )
