"""The real server or worker, with a quick stand-in for the science: ``web|worker DATA synced|unsynced``.

``unsynced`` is the test's own double of the disk: no fsync reaches it. The product has no such switch; the
harness needs it to show that its power cuts find what a missing fsync loses.
"""

import hashlib
import json
import os
import select
import sys
from pathlib import Path
from typing import Any

import acromion.app.library.database.connect
from acromion.app.main import serve
from acromion.app.queue.worker import run_worker
from acromion.app.request import OnStage, ReportRequest
from acromion.app.settings import Settings

SLOWEST_S = 0.3


def write_digest(log: Path, request: ReportRequest, out: Path, on_stage: OnStage) -> None:
    """Take a moment that depends on the content, and write a result that depends on nothing else."""
    digest = hashlib.sha256(log.read_bytes()).hexdigest()
    on_stage("fusing", 0.5)
    (out / "report.en.html").write_text(digest * 2000)
    select.select([], [], [], SLOWEST_S * int(digest[:2], 16) / 255)  # sleeps under a false clock, too
    (out / "results.json").write_text(json.dumps({"sha256": digest}))


def skip_sync() -> None:
    """Let every fsync, ours and SQLite's, do nothing."""
    prepare = acromion.app.library.database.connect._prepare_sqlite

    def prepare_carelessly(connection: Any, _record: Any) -> None:
        prepare(connection, _record)
        connection.execute("PRAGMA synchronous=OFF")

    acromion.app.library.database.connect._prepare_sqlite = prepare_carelessly
    os.fsync = _forget


def _forget(fd: object) -> None:
    """Take the place of fsync."""


def main() -> None:
    """Be the server or the worker."""
    role, data, sync = sys.argv[1:]
    if sync == "unsynced":
        skip_sync()
    settings = Settings(data_dir=Path(data), port=0, workers=0)
    if role == "web":
        serve(settings)
    else:
        run_worker(settings, write_digest)


if __name__ == "__main__":
    main()
