"""A study by REST, with everything killed in the middle: ``python -m benchmarks.thousand``.

Sends recordings that differ, asks for them in one batch, kills the server, its workers and their children at
half of it (kill -9), starts it again and waits for the end. Prints the time from the question to the last
report, killing and starting included, beside the sum of the analyses' own times over the cores (goal of
issue 8: 1.15), and how many ended well. ``--whole`` kills nothing.
"""

import argparse
import os
import shutil
import signal
import tempfile
import time
import zipfile
from collections.abc import Iterator
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import Any

from fusion.simulation import simulate_shift, write_shift
from tests.ways_in.servers import RunningServer, list_children

LOOK_S = 0.5


def send_all(server: RunningServer, shift: Path, name: str, number: int) -> list[str]:
    """Store copies that differ by the comment of the archive; gives their ids."""
    ids = []
    for k in range(number):
        copy = shift.with_name("copy.gt3x")
        shutil.copy(shift, copy)
        with zipfile.ZipFile(copy, "a") as archive:
            archive.comment = f"{name} {k}".encode()
        told = {"file_name": f"{name}_{k:04d}.gt3x"}
        answer = server.client.post("/api/v1/recordings", content=copy.read_bytes(), params=told)
        ids.append(answer.raise_for_status().json()["id"])
    return ids


def ask_for_all(server: RunningServer, recordings: list[str]) -> str:
    """Ask for one batch of them; gives its address."""
    wish = {"items": [{"recording_id": recording} for recording in recordings]}
    answer = server.client.post("/api/v1/batches", json=wish)
    return str(answer.raise_for_status().json()["links"]["self"])


def wait_for_share(server: RunningServer, batch: str, number: int) -> dict[str, Any]:
    """Wait until that many have ended."""
    while True:
        view: dict[str, Any] = server.client.get(batch).json()
        if view["item_count"] - view["counts"]["queued"] - view["counts"]["running"] >= number:
            return view
        time.sleep(LOOK_S)


def kill_everything(server: RunningServer) -> None:
    """End the server, its workers and their children at once."""
    family = [server.process.pid, *_descend(server.process.pid)]
    for pid in family:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    server.kill()


def _descend(parent: int) -> Iterator[int]:
    for child in list_children(parent):
        yield child
        yield from _descend(child)


def list_analyses(server: RunningServer, batch: str) -> Iterator[dict[str, Any]]:
    """Give every analysis of a batch."""
    asked: dict[str, str | int] = {"batch_id": batch.rpartition("/")[2], "limit": 500}
    while True:
        page = server.client.get("/api/v1/analyses", params=asked).json()
        yield from page["items"]
        if page["next_cursor"] is None:
            return
        asked |= {"cursor": page["next_cursor"]}


def measure(folder: Path, shift: Path, number: int, workers: int, *, whole: bool) -> tuple[float, float]:
    """Give the seconds that the batch took, and those of its analyses over the workers."""
    settings = {"ACROMION_MAX_CACHE_BYTES": "0"}
    server = RunningServer(folder / "data", folder / "log", workers, **settings)
    try:
        wait_for_share(server, ask_for_all(server, send_all(server, shift, "warm", workers)), workers)
        recordings = send_all(server, shift, "study", number)
        started_s = time.monotonic()
        batch = ask_for_all(server, recordings)
        if not whole:
            wait_for_share(server, batch, number // 2)
            kill_everything(server)
            server = RunningServer(folder / "data", folder / "log", workers, **settings)
        counts = wait_for_share(server, batch, number)["counts"]
        took_s = time.monotonic() - started_s
        spent_s = sum(map(_tell_duration_s, list_analyses(server, batch)))
    finally:
        server.stop()
    if counts["succeeded"] != number:
        raise SystemExit(f"of {number}: {counts}")
    return took_s, spent_s / workers


def _tell_duration_s(analysis: dict[str, Any]) -> float:
    begun, ended = (datetime.fromisoformat(analysis[name]) for name in ("started_at", "ended_at"))
    return (ended - begun).total_seconds()


def main() -> None:
    parser = argparse.ArgumentParser(description="Do a study by REST.")
    parser.add_argument("--recordings", type=int, default=1000)
    parser.add_argument("--minutes", type=float, default=60.0, help="length of each recording")
    parser.add_argument("--whole", action="store_true", help="kill nothing")
    wished = parser.parse_args()
    workers = os.cpu_count() or 1
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        simulated = simulate_shift("gt9x", wished.minutes / 60, seed=1)
        shift = write_shift(folder, simulated, actilife_csv=False)[0]
        took_s, spent_s = measure(folder, shift, wished.recordings, workers, whole=wished.whole)
    fault = "nothing killed" if wished.whole else "everything killed at half"
    print(f"{wished.recordings} recordings of {wished.minutes:g} min, {workers} workers, {fault}:")
    ratio = took_s / spent_s
    print(f"all succeeded; {took_s:.1f} s, of their own {spent_s:.1f} s: ratio {ratio:.3f} (goal 1.15)")


if __name__ == "__main__":
    main()
