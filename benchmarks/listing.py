"""Measure a page of 100,000 recordings and analyses: ``python -m benchmarks.listing [recordings]``.

Fills a new SQLite database, then requests the first page, a page in the middle and the last ones from the
application (with routes, validation and JSON), with and without filters. Goal: p99 <= 100 ms.
"""

import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

from fastapi.testclient import TestClient
from sqlalchemy import insert

from acromion.app.http.api.library.models import write_cursor
from acromion.app.library.database.tables import analyses, recordings
from acromion.app.library.jobs import JobStore
from acromion.app.main import create_app
from acromion.app.request import ReportRequest
from acromion.app.settings import Settings

ROUNDS = 300
AT_ONCE = 10_000


def fill(settings: Settings, count: int) -> None:
    """Write the rows of ``count`` recordings, each with a finished analysis."""
    store, request = JobStore(settings), ReportRequest("shift.gt3x").to_json()
    for first in range(0, count, AT_ONCE):
        numbers = range(first, min(first + AT_ONCE, count))
        with store.engine.begin() as connection:
            connection.execute(insert(recordings), [make_recording(k) for k in numbers])
            connection.execute(insert(analyses), [make_analysis(k, request) for k in numbers])
    store.close()


def format_timestamp(k: int) -> str:
    """Return a timestamp that increases with the number."""
    moment = datetime(2026, 1, 1, 6, tzinfo=UTC) + timedelta(minutes=5 * k)
    return moment.isoformat(timespec="microseconds")


def make_recording(k: int) -> dict[str, object]:
    """Return the row of one recording."""
    metadata = {"subject": f"S{k % 500:03d}", "external_id": f"visit-{k}", "start": format_timestamp(k)[:19]}
    stored = {"sha256": f"{k:064x}", "size_bytes": 1_000_000, "file_name": f"{k}.gt3x", "state": "stored"}
    return {"id": f"rec_{k:016x}", "created_at": format_timestamp(k), **metadata, **stored}


def make_analysis(k: int, request: str) -> dict[str, object]:
    """Return the row of its analysis."""
    ended = {"state": "succeeded" if k % 20 else "failed", "progress": 1.0, "attempts": 1, "beats": 9}
    known = {
        "recording_id": f"rec_{k:016x}",
        "request": request,
        "way_in": "api",
        "token": "0" * 16,
    }
    problem = {"problem_code": None if k % 20 else "E-SHORT", "problem_facts": None}
    row: dict[str, object] = {"id": f"an_{k:016x}", "created_at": format_timestamp(k), "batch_id": None}
    return row | ended | known | problem


def measure(ask: Callable[[], object]) -> tuple[float, float]:
    """Return median and 99th percentile in milliseconds."""
    took_ms = []
    for _ in range(ROUNDS):
        began_s = time.perf_counter()
        ask()
        took_ms.append((time.perf_counter() - began_s) * 1000)
    return statistics.median(took_ms), statistics.quantiles(took_ms, n=100)[98]


def main(count: int) -> None:
    """Print a table."""
    with tempfile.TemporaryDirectory() as name:
        settings = Settings(data_dir=Path(name), min_free_bytes=0)
        fill(settings, count)
        middle = write_cursor((format_timestamp(count // 2), "z"))
        pages = {
            "recordings, first page": "/api/v1/recordings?limit=50",
            "recordings, in the middle": f"/api/v1/recordings?limit=50&cursor={middle}",
            "recordings of a subject": "/api/v1/recordings?subject=S123",
            "recordings by external id": "/api/v1/recordings?external_id=visit-77",
            "recordings of a day": "/api/v1/recordings?from=2026-03-03&to=2026-03-04",
            "analyses, first page": "/api/v1/analyses?limit=50",
            "analyses, in the middle": f"/api/v1/analyses?limit=50&cursor={middle}",
            "failed analyses": "/api/v1/analyses?state=failed&limit=50",
        }
        with TestClient(create_app(settings), base_url="http://localhost") as client:
            print(f"{count} recordings, {ROUNDS} rounds\n{'page':<28}{'median ms':>10}{'p99 ms':>10}")
            for title, address in pages.items():
                assert client.get(address).status_code == 200
                median_ms, p99_ms = measure(lambda address=address: client.get(address))  # type: ignore[misc]
                print(f"{title:<28}{median_ms:>10.1f}{p99_ms:>10.1f}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 100_000)
