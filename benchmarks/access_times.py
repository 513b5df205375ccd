"""What answers tell by their time, and what the trail costs: ``python -m benchmarks.access_times``.

1. A foreign id against an unknown one: medians of 100 requests each, in turn. Goal: they differ by < 5 %.
2. An upload and a reading with the trail and without it: medians of 100 each, in turn.
"""

import os
import secrets
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from fastapi.testclient import TestClient

import app.jobs.trail
from app.access.accounts import AccountStore
from app.access.subjects import ROLES
from app.api.middleware.readings import KnownReadings
from app.main import create_app
from app.settings import Settings

TIMES = 100
WARM = 20
BODY = 100_000
UNKNOWN_ANALYSIS, UNKNOWN_RECORDING = "an_00000000000000ff", "rec_00000000000000ff"
Call = Callable[[], object]


def measure(*calls: Call) -> list[float]:
    """Give the median time of each call in ms; they are called in turn, so that load meets all alike."""
    for _ in range(WARM):
        for call in calls:
            call()
    times_s: list[list[float]] = [[] for _ in calls]
    for turn in range(TIMES):
        for place in range(len(calls))[:: 1 if turn % 2 else -1]:
            began_s = time.perf_counter()
            calls[place]()
            times_s[place].append(time.perf_counter() - began_s)
    return [1000 * statistics.median(times) for times in times_s]


@contextmanager
def replacing(owner: object, name: str, value: object) -> Iterator[None]:
    """Put something else in a place of a module or class for a while."""
    before = getattr(owner, name)
    setattr(owner, name, value)
    try:
        yield
    finally:
        setattr(owner, name, before)


@contextmanager
def without_trail() -> Iterator[None]:
    """Write no line, as before there was a trail."""
    with replacing(app.jobs.trail, "_append", ignore), replacing(KnownReadings, "is_new", ignore):
        yield


def ignore(*_: object) -> bool:
    """Take the place of what writes a line, and of what says that a reading is new."""
    return False


def measure_ids(client: TestClient, mine: dict[str, str], other: dict[str, str]) -> None:
    """Print the times of a foreign and of an unknown id."""
    job = client.post("/api/v1/analyze", content=b"bytes", headers=mine).json()
    pairs = {
        "/api/v1/analyses/{}": (job["id"], UNKNOWN_ANALYSIS),
        "/api/v1/recordings/{}": (job["recording_id"], UNKNOWN_RECORDING),
        "/api/v1/analyses/{}/results.json": (job["id"], UNKNOWN_ANALYSIS),
        "/analyses/{}": (job["id"], UNKNOWN_ANALYSIS),
    }
    for route, ids in pairs.items():
        foreign, unknown = (partial(client.get, route.format(one), headers=other) for one in ids)
        foreign_ms, unknown_ms = measure(foreign, unknown)
        apart = 100 * abs(foreign_ms - unknown_ms) / unknown_ms
        sys.stdout.write(
            f"{route}: foreign {foreign_ms:.2f} ms, unknown {unknown_ms:.2f} ms: {apart:.1f} %\n"
        )


def measure_trail(client: TestClient, mine: dict[str, str]) -> None:
    """Print the times with the trail and without it."""
    job = client.post("/api/v1/analyze", content=b"bytes", headers=mine).json()
    address = f"/api/v1/analyses/{job['id']}"

    def store() -> None:
        client.post("/api/v1/analyze", content=secrets.token_bytes(BODY), headers=mine)

    def read() -> None:
        client.get(address, headers=mine)

    def read_first() -> None:
        with first_readings():
            client.get(address, headers=mine)

    for name, call in {"POST of 100 kB": store, "GET, once more": read, "GET, first": read_first}.items():

        def call_without(call: Call = call) -> None:
            with without_trail():
                call()

        with_ms, without_ms = measure(call, call_without)
        cost = with_ms - without_ms
        sys.stdout.write(f"{name}: {with_ms:.2f} ms with the trail, {without_ms:.2f} without: {cost:+.2f}\n")


@contextmanager
def first_readings() -> Iterator[None]:
    """Let each reading be the first, unless no line is written at all."""
    known = KnownReadings.is_new
    with replacing(KnownReadings, "is_new", ignore if known is ignore else lambda *_: True):
        yield


def main() -> None:
    """Make a server with two organisations, and measure."""
    os.environ.pop("ACROMION_NO_SECRET", None)
    with tempfile.TemporaryDirectory() as folder:
        settings = Settings(data_dir=Path(folder) / "data", min_free_bytes=0)
        accounts = AccountStore(settings)
        headers = []
        for organisation in ("own", "org_other"):
            accounts.add_organisation(organisation, organisation)
            person = accounts.add_person(organisation, organisation, organisation, tuple(ROLES))
            headers.append({"Cookie": f"acromion_session={accounts.begin_session(person.id)}"})
        with TestClient(create_app(settings), "http://localhost:8080") as client:
            measure_ids(client, *headers)
            measure_trail(client, headers[0])


if __name__ == "__main__":
    main()
