"""Inspections and other short tasks for which a person waits: in a child process, without the queue."""

import importlib
import json
import shutil
import tempfile
import threading
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from acromion.app.analysis.attempt import (
    Attempt,
    MakeReport,
    choose_limits,
    load_and_call,
    load_and_measure,
    load_and_set_again,
    run_and_wait,
)
from acromion.app.analysis.fork_server import warm_up
from acromion.app.report.findings import ReleaseStamp
from acromion.app.request import Language, OnStage, ReportRequest
from acromion.app.settings import Settings
from acromion.fusion.diary import DiaryEntry
from acromion.fusion.workbook import is_workbook

MOST_CONCURRENT = 2
PREFIX = "look_"
SHORT_DIARY_BYTES = 64 << 10
"""A text up to this size is a few thousand rows, and is parsed without a child."""


def load_and_compare_live(
    shown: Path, elevation: Path, request: ReportRequest, out: Path, _on_stage: OnStage
) -> None:
    """Compare the displayed angles of a live session with its report."""
    write = importlib.import_module("acromion.app.live.recorder").write_difference
    write(shown, elevation, request.languages[0], out)


def load_and_write_raw(
    raw: Path, early: Path, _request: ReportRequest, _out: Path, _on_stage: OnStage
) -> None:
    """Write the raw file of an interrupted live session from its early bytes."""
    importlib.import_module("acromion.app.live.raw_file").write_early_rows(early, raw)


INSPECT = partial(load_and_call, "acromion.app.analysis.inspect", "write_inspection")
PREVIEW = partial(load_and_call, "acromion.app.analysis.inspect", "write_preview")
PROPOSE_COLUMNS = partial(load_and_call, "acromion.app.analysis.inspect", "write_column_proposal")
READ_DIARY = partial(load_and_call, "acromion.app.analysis.inspect", "write_diary")
WRITE_ANGLES = partial(load_and_call, "acromion.app.analysis.run", "write_elevation_csv")


@dataclass(frozen=True, slots=True)
class Inspector:
    """Runs a few of these tasks at a time; further callers wait."""

    settings: Settings
    folder: Path
    inspect: MakeReport = INSPECT
    make_preview: MakeReport = PREVIEW
    _turns: threading.BoundedSemaphore = field(
        default_factory=lambda: threading.BoundedSemaphore(MOST_CONCURRENT)
    )
    _warm: threading.Event = field(default_factory=threading.Event)

    def prepare(self) -> None:
        """Create the folder for the files that the child passes to the parent."""
        self.folder.mkdir(parents=True, exist_ok=True, mode=0o700)

    def sweep(self) -> None:
        """Remove what a crash left; only for the one server of this folder, before its first inspection."""
        for left in self.folder.glob(f"{PREFIX}*"):
            shutil.rmtree(left, ignore_errors=True)
            if left.is_file():
                left.unlink()

    def get_ready(self) -> None:
        """Load ``fusion`` into the fork server now, because a recording has been announced."""
        if not self._warm.is_set():
            self._warm.set()
            threading.Thread(target=warm_up, name="warm-up", daemon=True).start()

    def look(self, recording_path: Path, request: ReportRequest) -> dict[str, Any]:
        """Inspect a whole recording. Raises RecordedProblem with the code of the refusal."""
        return _read(self._run(recording_path, request, self.inspect, "inspection.json"))

    def measure(self, recording_path: Path, request: ReportRequest) -> dict[str, Any]:
        """Return start and duration of a recording on the device's clock. Raises RecordedProblem."""
        return _read(self._run(recording_path, request, load_and_measure, "extent.json"))

    def preview(self, head: bytes, request: ReportRequest) -> dict[str, Any]:
        """Inspect the first bytes of a recording. Raises RecordedProblem."""
        with tempfile.NamedTemporaryFile(prefix=PREFIX, dir=self.folder) as file:
            file.write(head)
            file.flush()
            return _read(self._run(Path(file.name), request, self.make_preview, "inspection.json"))

    def read_diary(self, body: bytes) -> tuple[DiaryEntry, ...]:
        """Parse a diary; a workbook or a long text in a child process.

        Raises UnusableDiary, or RecordedProblem with the same code from the child.
        """
        if len(body) <= SHORT_DIARY_BYTES and not is_workbook(body):
            from acromion.fusion.exposure.periods import read_checked_diary  # noqa: PLC0415  slow import

            return read_checked_diary(body)
        with tempfile.NamedTemporaryFile(prefix=PREFIX, dir=self.folder) as file:
            file.write(body)
            file.flush()
            rows = json.loads(self._run(Path(file.name), ReportRequest(""), READ_DIARY, "diary.json"))
        return tuple(DiaryEntry(**row) for row in rows)

    def propose_columns(self, recording_path: Path, request: ReportRequest) -> dict[str, Any]:
        """Return the names of a table's columns and their proposed meanings. Raises RecordedProblem."""
        return _read(self._run(recording_path, request, PROPOSE_COLUMNS, "columns.json"))

    def write_angles(self, parquet: Path) -> bytes:
        """Return the angles as gzipped CSV."""
        return self._run(parquet, ReportRequest(""), WRITE_ANGLES, "elevation.csv.gz")

    def compare_live(self, shown: Path, elevation: Path, language: Language) -> dict[str, Any]:
        """Return the difference between the displayed angles of a live session and its report."""
        request = ReportRequest("", languages=(language,))
        return _read(self._run(elevation, request, partial(load_and_compare_live, shown), "difference.json"))

    def set_again(
        self, results: Path, request: ReportRequest, stamp: ReleaseStamp | None
    ) -> dict[str, bytes]:
        """Return the files of a report by name, with the stamp of its release if it has one."""
        with self._turns, tempfile.TemporaryDirectory(prefix=PREFIX, dir=self.folder) as folder:
            self._make(results, request, partial(load_and_set_again, release=stamp), Path(folder))
            return {path.name: path.read_bytes() for path in Path(folder).iterdir()}

    def write_raw(self, early: Path, raw: Path) -> None:
        """Write the raw file of an interrupted live session. Raises RecordedProblem, Crashed."""
        self._run(early, ReportRequest(""), partial(load_and_write_raw, raw))

    def _run(self, recording_path: Path, request: ReportRequest, make: MakeReport, name: str = "") -> bytes:
        """Return the content of the file that the child wrote; none if it has no name."""
        with self._turns, tempfile.TemporaryDirectory(prefix=PREFIX, dir=self.folder) as folder:
            self._make(recording_path, request, make, Path(folder))
            return (Path(folder) / name).read_bytes() if name else b""

    def _make(self, path: Path, request: ReportRequest, make: MakeReport, out: Path) -> None:
        limits = choose_limits(self.settings, path.stat().st_size)
        run_and_wait(Attempt(path, request, out, make, limits))


def _read(body: bytes) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(body)
    return found
