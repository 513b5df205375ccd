"""Test the recovery of a lost database: ``python -m benchmarks.recover`` (1,000 recordings, some minutes).

- ``folder``: recordings are stored and analysed (by a fake analysis), some get periods, some are moved to the
  trash; the SQLite file is deleted; ``acromion recover`` must restore what the API returned before.
- ``bucket``: the same with the recordings in a bucket of a real S3 server and the rows in PostgreSQL, whose
  tables are dropped; recovered from another folder than before.

Prints a table; exits 1 if anything differs.
"""

import argparse
import os
import random
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx2

from tests import ROOT
from tests.crash.harness import Site
from tests.crash.stores import run_command
from tests.postgres import PostgresServer
from tests.swift import SwiftServer

PERIODS_OF, TRASH_OF, ANALYSES_AT_ONCE = 10, 7, 100
CHANGING = frozenset({"links", "files"})
Views = dict[str, dict[str, Any]]
Environment = Mapping[str, str]


@dataclass
class RecoveryResult:
    """The result of one recovery."""

    what: str
    recordings: int = 0
    trashed: int = 0
    reports: int = 0
    back: int = 0
    seconds: float = 0.0
    broken: list[str] = field(default_factory=list)

    def row(self) -> str:
        """Return a row of the table."""
        counts = f"{self.recordings} | {self.trashed} | {self.reports} | {self.back}"
        return f"| {self.what} | {counts} | {self.seconds:.0f} | {len(self.broken)} |"


def fill(client: httpx2.Client, number: int, seed: int) -> None:
    """Store recordings with different metadata, and analyse them all."""
    dice, ids = random.Random(seed), list[str]()
    for k in range(number):
        metadata = {
            "file_name": f"shift {k}.gt3x",
            "subject": f"S-{k % 97}",
            "side": dice.choice(("left", "right")),
        }
        metadata |= {"external_id": f"EXT-{k}", "note": f"note {k}, côté {dice.random():.3f}"}
        stored = client.post("/recordings", content=dice.randbytes(dice.randint(100, 3000)), params=metadata)
        ids.append(stored.raise_for_status().json()["id"])
        if k % PERIODS_OF == 0:
            period = {"start_s": 0, "end_s": 60 + k, "kind": "task", "label": f"task {k}"}
            client.put(f"/recordings/{ids[-1]}/periods", json=[period]).raise_for_status()
    for begin in range(0, number, ANALYSES_AT_ONCE):
        wish = {"recording_ids": ids[begin : begin + ANALYSES_AT_ONCE]}
        client.post("/analyses", json=wish).raise_for_status()
    while any(view["state"] in ("queued", "running") for view in _list_all(client, "/analyses")):
        time.sleep(1)
    for recording_id in ids[::TRASH_OF]:
        client.delete(f"/recordings/{recording_id}").raise_for_status()


def read_all(client: httpx2.Client) -> Views:
    """Return everything that the API reports about recordings, periods, trash and analyses."""
    found: Views = {}
    for view in _list_all(client, "/recordings"):
        periods = client.get(f"/recordings/{view['id']}/periods").raise_for_status().json()
        found[view["id"]] = view | {"periods": periods}
    found |= {view["id"]: view for view in _list_all(client, "/recordings", trashed="true")}
    for view in _list_all(client, "/analyses"):
        result = client.get(f"/analyses/{view['id']}/results.json")
        found[view["id"]] = view | {"result": (result.status_code, result.text)}
    return {name: {k: v for k, v in view.items() if k not in CHANGING} for name, view in found.items()}


def _list_all(client: httpx2.Client, path: str, **asked: Any) -> Iterator[dict[str, Any]]:
    while True:
        page = client.get(path, params=asked | {"limit": 500}).raise_for_status().json()
        yield from page["items"]
        if page["next_cursor"] is None:
            return
        asked = asked | {"cursor": page["next_cursor"]}


@contextmanager
def running(
    folder: Path, environment: Environment, workers: int = 0, root: Path = ROOT
) -> Iterator[httpx2.Client]:
    site = Site(folder / "data", folder / "log", workers=workers, environment=environment, root=root)
    try:
        with httpx2.Client(base_url=f"{site.address}/api/v1", timeout=None) as client:
            yield client
    finally:
        site.end()


def compare(before: Views, after: Views) -> list[str]:
    """Return the differences."""
    broken = [f"{name} is lost" for name in before if name not in after]
    broken += [f"{name} is new" for name in after if name not in before]
    for name in before.keys() & after.keys():
        keys = before[name].keys() | after[name].keys()
        other = sorted(k for k in keys if before[name].get(k) != after[name].get(k))
        if other:
            broken.append(f"{name} differs in {', '.join(other)}")
    return broken


def recover_all(tried: RecoveryResult, folder: Path, environment: Environment, before: Views) -> None:
    """Recover, start, and compare with the state before."""
    os.environ.update(environment)
    started_s = time.monotonic()
    ended = run_command("recover", "--data", folder / "data")
    tried.seconds = time.monotonic() - started_s
    print(ended.output.strip()[-500:])
    if ended.exit_code:
        tried.broken.append(f"recover: exit {ended.exit_code} {ended.code}")
    with running(folder, environment) as client:
        after = read_all(client)
    tried.broken += compare(before, after)
    tried.recordings = len(_list_recordings(before))
    tried.trashed = sum(view["state"] == "trashed" for view in _list_recordings(before))
    tried.reports = sum(view["result"][0] == 200 for view in before.values() if "result" in view)
    tried.back = sum(before[name] == after.get(name) for name in before if name.startswith("rec_"))
    verified = run_command("verify", "--data", folder / "data")
    if verified.exit_code:
        tried.broken.append(f"verify: {verified.output[-200:]}")


def _list_recordings(views: Views) -> list[dict[str, Any]]:
    return [view for name, view in views.items() if name.startswith("rec_")]


def try_folder(folder: Path, number: int) -> list[RecoveryResult]:
    tried = RecoveryResult("folder and SQLite")
    with running(folder, {}, workers=2) as client:
        fill(client, number, seed=1)
        before = read_all(client)
    _delete_sqlite(folder / "data")
    recover_all(tried, folder, {}, before)
    return [tried]


def try_bucket(folder: Path, number: int) -> list[RecoveryResult]:
    tried, swift, postgres = (
        RecoveryResult("bucket and PostgreSQL, from another folder"),
        SwiftServer(),
        PostgresServer(),
    )
    try:
        environment = swift.environment | {
            "ACROMION_OBJECT_STORE": swift.make_bucket(),
            "ACROMION_DATABASE_URL": postgres.url,
        }
        (folder / "first").mkdir()
        with running(folder / "first", environment, workers=2) as client:
            fill(client, number, seed=2)
            before = read_all(client)
        postgres.empty()
        recover_all(tried, folder, environment, before)
    finally:
        postgres.remove()
        swift.remove()
        for name in ("ACROMION_OBJECT_STORE", "ACROMION_DATABASE_URL"):
            os.environ.pop(name, None)
    return [tried]


def _delete_sqlite(data: Path) -> None:
    for path in data.glob("acromion.sqlite3*"):
        path.unlink()


def main() -> None:
    parser = argparse.ArgumentParser(description="Delete the database, recover, compare.")
    parser.add_argument("--recordings", type=int, default=1000)
    parser.add_argument("--only", choices=("folder", "bucket"))
    wished = parser.parse_args()
    tried: list[RecoveryResult] = []
    for what in ("folder", "bucket"):
        if wished.only not in (None, what):
            continue
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            if what == "folder":
                tried += try_folder(folder, wished.recordings)
            else:
                tried += try_bucket(folder, wished.recordings)
        for line in tried[-1].broken[:10]:
            print("   ", line)
    print("| what | recordings | of them in the trash | reports | back | s | differences |")
    print("|---|---:|---:|---:|---:|---:|---:|", *(one.row() for one in tried), sep="\n")
    sys.exit(any(one.broken for one in tried))


if __name__ == "__main__":
    main()
