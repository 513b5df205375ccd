"""Mix hostile and honest input for long: ``python -m benchmarks.soak [--minutes 120] [--pause 0]``.

Starts the real server with accounts and two workers on this machine. One person sends damaged and worst files
(six waiting at a time) and hostile live lines; ``--pause`` slows this person down. Another sends shifts, runs
a live session and opens pages. Measures the 95th percentile of the pages, the memory of each process, and the
delay of each honest analysis, compared with its duration on the quiet server. Clients are separate processes,
each of which writes one line per event into a file; the summary can also be read while the program runs.
"""

import argparse
import asyncio
import csv
import itertools
import json
import multiprocessing
import os
import random
import statistics
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import httpx2
import psutil
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed

from acromion.app.accounts.accounts import AccountStore
from acromion.app.accounts.subjects import ROLES
from acromion.app.settings import Settings
from acromion.fusion.simulation import simulate_shift, write_shift
from benchmarks.fuzz.outcome import damage
from benchmarks.fuzz.seeds import SEEDS
from benchmarks.live import CHUNK_ROWS, HEADER, RATE_HZ, write_rows
from tests.badfiles.expected import BAD_FILES
from tests.badfiles.ways_in import content_of
from tests.fusion.readers.cwa.cwa_builder import log_of
from tests.ways_in.servers import RunningServer, wait_for

SPAWN = multiprocessing.get_context("spawn")
WORST_BYTES, WAITING_FILES, HOSTILE_SOCKETS = 1 << 20, 6, 2
PIECES = (b"a", b"ax: 0 ", b"(", b'" ', b", ", b"1:01:01.1 -> ", b"gyr", b"X,", b"\xff", b"1,2,3\n", b"0\n")
PAGES = (
    "/",
    "/rows",
    "/live",
    "/studies",
    "/persons",
    "/trash",
    "/account",
    "/healthz",
    "/api/v1/analyses?limit=20",
)
PAGE_PAUSE_S, SHIFT_PAUSE_S, SAMPLE_S, SOCKET_S = 0.25, 20.0, 10.0, 60.0
QUIET_ROUNDS, QUIET_S = 2, 40.0
Rows = list[list[str]]


class Log:
    """A file with one line per event: seconds since the start, and values."""

    def __init__(self, path: Path, began_s: float) -> None:
        self._file, self._began_s = path.open("a", buffering=1), began_s

    def write(self, *values: object) -> None:
        """Write one event."""
        csv.writer(self._file).writerow([f"{time.monotonic() - self._began_s:.1f}", *values])


def make_hostile_files() -> Iterator[tuple[str, bytes]]:
    """Yield files without end: the table of bad files, damaged recordings, and the worst text."""
    chance = random.Random(1)
    header = b"time_us,acc_x_g,acc_y_g,acc_z_g,gyr_x_dps,gyr_y_dps,gyr_z_dps"
    row = b"0,0.0,0.02,1.0,0.1,0.2,0.3"
    for number in itertools.count():
        text = chance.choice(PIECES)
        text *= WORST_BYTES // len(text)
        unique = b"# %d\n" % number
        yield "above.csv", unique + text + b"\n" + header + b"\n" + row
        yield "name.csv", unique + header + b"," + text.replace(b"\n", b" ") + b"\n" + (row + b",1\n") * 300
        yield "wide.csv", unique + b",".join(b"acc_x_%d" % k for k in range(30_000)) + b"\n" + b"1," * 30_000
        yield "ones.cwa", log_of(range(number % 40)) + b"\xff" * (WORST_BYTES - number)
        for _ in range(8):
            bad = chance.choice(BAD_FILES)
            yield bad.name, content_of(bad)
            name = chance.choice(sorted(SEEDS))
            yield f"{name}.bin", damage(name, chance)


def send_hostile_files(address: str, token: str, end_s: float, log: Log, pause_s: float) -> None:
    """Send files, ``pause_s`` apart; at most :data:`WAITING_FILES` wait for their analysis."""
    waiting: set[str] = set()
    with open_client(address, {"authorization": f"Bearer {token}"}) as client:
        for name, content in make_hostile_files():
            while len(waiting) >= WAITING_FILES or time.monotonic() > end_s:
                for place in sorted(waiting):
                    view = client.get(place).json()
                    if view["state"] not in ("queued", "running"):
                        waiting.discard(place)
                        code = (view.get("problem") or {}).get("code", view["state"])
                        log.write("ended", code, view["file_name"], measure_s(view, "started_at", "ended_at"))
                if time.monotonic() > end_s:
                    return
                time.sleep(0.2)
            params = {"file_name": name, "again": "true"}
            answer = client.post("/api/v1/analyze", params=params, content=content)
            log.write("sent", answer.status_code, name, len(content))
            if answer.status_code == 202:
                waiting.add(answer.json()["links"]["self"])
            time.sleep(pause_s)


def measure_s(view: dict[str, Any], first: str, last: str) -> float:
    """Return the seconds between two moments of an analysis."""
    if not (view[first] and view[last]):
        return 0.0
    return (datetime.fromisoformat(view[last]) - datetime.fromisoformat(view[first])).total_seconds()


def send_hostile_lines(address: str, token: str, end_s: float, log: Log, pause_s: float) -> None:
    """Run sessions of worst lines, ``pause_s`` apart or as fast as the server takes them."""

    async def run(number: int) -> None:
        chance = random.Random(number)
        while time.monotonic() < end_s:
            stop_s, text = time.monotonic() + SOCKET_S, chance.choice(PIECES)
            sent, end = 0, "closed"
            with suppress(ConnectionClosed, OSError, TimeoutError):
                async with connect(address, additional_headers=_bear(token), max_queue=None) as socket:
                    await socket.send(json.dumps({"type": "start", "source": "lines", "name": "bad"}))
                    await socket.send(HEADER.encode() + write_rows(0, 300))
                    hearing = asyncio.create_task(_hear_end(socket))
                    while time.monotonic() < min(stop_s, end_s) and not hearing.done():
                        size = chance.choice((10, 1000, 60_000))
                        await socket.send(text * max(1, size // len(text)))
                        sent += size
                        await asyncio.sleep(pause_s)
                    await socket.send(json.dumps({"type": "stop"}))
                    end = await asyncio.wait_for(hearing, SOCKET_S)
            log.write("socket", end, repr(text), sent)

    async def run_all() -> None:
        await asyncio.gather(*(run(number) for number in range(HOSTILE_SOCKETS)))

    asyncio.run(run_all())


def _bear(token: str) -> dict[str, str]:
    return {"authorization": f"Bearer {token}"}


async def _hear_end(socket: Any) -> str:
    async for text in socket:
        message = json.loads(text)
        if message["type"] in ("ended", "problem"):
            return message.get("code") or str(message["state"])
    return "closed"


def run_honest_session(address: str, token: str, end_s: float, log: Log) -> None:
    """Run kept sessions at 100 Hz, some minutes each; measure from sending to the update."""

    async def run(stop_s: float) -> None:
        sent_s: dict[int, float] = {}
        taken_ms: list[float] = []
        status: dict[str, Any] = {}
        async with connect(address, additional_headers=_bear(token), max_queue=None) as socket:

            async def hear() -> str:
                async for text in socket:
                    message = json.loads(text)
                    status.update(message.get("status", {}))
                    if message["type"] == "update" and (at_s := sent_s.pop(status["frames"], None)):
                        taken_ms.append(1000 * (time.monotonic() - at_s))
                    if message["type"] in ("ended", "problem"):
                        return message.get("code") or str(message["state"])
                return "closed"

            asked = {"type": "start", "source": "lines", "name": "bench", "axis": "+z", "keeps": True}
            await socket.send(json.dumps(asked))
            await socket.send(HEADER.encode())
            hearing, began_s, rows = asyncio.create_task(hear()), time.monotonic(), 0
            while time.monotonic() < stop_s and not hearing.done():
                await socket.send(write_rows(rows, rows + CHUNK_ROWS))
                rows += CHUNK_ROWS
                sent_s[rows] = time.monotonic()
                await asyncio.sleep(max(0.0, began_s + rows / RATE_HZ - time.monotonic()))
            await socket.send(json.dumps({"type": "stop"}))
            end = await asyncio.wait_for(hearing, SOCKET_S)
            p95_ms = statistics.quantiles(taken_ms, n=20)[-1] if len(taken_ms) > 1 else 0.0
            log.write("live", end, rows, status.get("frames", 0), status.get("lost", 0), f"{p95_ms:.0f}")

    while time.monotonic() < end_s - SOCKET_S:
        try:
            asyncio.run(run(min(end_s, time.monotonic() + 5 * SOCKET_S)))
        except (ConnectionClosed, OSError, TimeoutError) as error:
            log.write("live", type(error).__name__, 0, 0, 0, 0)


def open_pages(address: str, cookie: str, end_s: float, log: Log, kind: str = "page") -> None:
    """Open pages one after another, as a person does; also log how late this process woke up."""
    with open_client(address, {"cookie": cookie, "accept": "text/html"}) as client:
        for page in itertools.cycle(PAGES):
            began_s = time.monotonic()
            if began_s > end_s:
                return
            status = client.get(page).status_code
            taken_ms, slept_s = 1000 * (time.monotonic() - began_s), time.monotonic()
            time.sleep(PAGE_PAUSE_S)
            late_ms = 1000 * (time.monotonic() - slept_s - PAGE_PAUSE_S)
            log.write(kind, page, status, f"{taken_ms:.1f}", f"{late_ms:.1f}")


def analyse(client: httpx2.Client, shift: Path, number: int) -> dict[str, Any]:
    """Send a shift, and wait for the end of its analysis."""
    params = {"file_name": shift.name, "again": "true", "side": ("left", "right")[number % 2]}
    view = client.post("/api/v1/analyze", params=params, content=shift.read_bytes()).json()
    while view["state"] in ("queued", "running"):
        view = client.get(view["links"]["self"], params={"wait": 10}).json()
    found: dict[str, Any] = view
    return found


def send_shifts(
    address: str, token: str, shifts: list[Path], end_s: float, log: Log, kind: str = "shift"
) -> None:
    """Send the shifts in turn, one at a time."""
    with open_client(address, _bear(token)) as client:
        for number, shift in enumerate(itertools.cycle(shifts)):
            if time.monotonic() > end_s or (kind == "quiet" and number >= QUIET_ROUNDS * len(shifts)):
                return
            view = analyse(client, shift, number)
            wait_s, run_s = (
                measure_s(view, "created_at", "started_at"),
                measure_s(view, "started_at", "ended_at"),
            )
            load = f"{os.getloadavg()[0]:.1f}"
            log.write(kind, shift.name, view["state"], f"{wait_s:.1f}", f"{run_s:.1f}", load)
            if kind != "quiet":
                time.sleep(SHIFT_PAUSE_S)


def open_client(address: str, headers: dict[str, str]) -> httpx2.Client:
    """Return a client with these headers."""
    return httpx2.Client(base_url=address, timeout=600, headers=headers)


def sample_memory(server: RunningServer, log: Log) -> None:
    """Write the memory of the server, its workers and all other processes below it, in MB."""
    parts: Counter[str] = Counter()
    main = psutil.Process(server.process.pid)
    for process in [main, *main.children(recursive=True)]:
        with suppress(psutil.Error):
            is_worker = "acromion.app.queue.worker" in " ".join(process.cmdline())
            kind = "server" if process == main else "workers" if is_worker else "others"
            parts[kind] += round(process.memory_full_info().pss / 1e6)
            parts["processes"] += 1
    load = f"{os.getloadavg()[0]:.1f}"
    log.write("memory", parts["server"], parts["workers"], parts["others"], parts["processes"], load)


def summarise(folder: Path) -> Iterator[str]:
    """Yield the lines of the summary."""
    rows = [row for path in folder.glob("*.csv") for row in csv.reader(path.open())]
    events: dict[str, Rows] = {}
    for row in sorted(rows, key=lambda row: float(row[0])):
        events.setdefault(row[1], []).append(row)
    for kind in ("quiet page", "page"):
        opened = events.get(kind, [])
        failed = sum(row[3] != "200" for row in opened)
        for what, place in ((f"{kind}s: {len(opened)}, {failed} not 200", 4), ("the client woke up late", 5)):
            taken_ms = [float(row[place]) for row in opened]
            if len(taken_ms) > 1:
                p50, p95, p99 = (statistics.quantiles(taken_ms, n=100)[k] for k in (49, 94, 98))
                yield f"{what}: p50 {p50:.0f} ms, p95 {p95:.0f} ms, p99 {p99:.0f} ms"
    memory = events.get("memory", [])
    for place, name in enumerate(("server", "workers", "others", "processes", "load"), 2):
        values = [float(row[place]) for row in memory]
        quarters = [values[k * len(values) // 4 : (k + 1) * len(values) // 4] for k in range(4)]
        medians = ", ".join(f"{statistics.median(part):.1f}" for part in quarters if part)
        yield f"{name}: median of each quarter {medians}"
    alone_s: dict[str, list[float]] = {}
    for row in events.get("quiet", ()):
        alone_s.setdefault(row[2], []).append(float(row[4]) + float(row[5]))
    shifts = [(row[2], float(row[4]), float(row[5]), row[3]) for row in events.get("shift", ())]
    lengths_s = {name: min(taken) for name, taken in alone_s.items()}
    for name, length_s in lengths_s.items():
        mine = [(wait_s, run_s) for shift, wait_s, run_s, _ in shifts if shift == name]
        if mine:
            late = sum(wait_s + run_s - length_s > length_s for wait_s, run_s in mine)
            waited = sum(wait_s > run_s for wait_s, run_s in mine)
            middle_s = statistics.median(wait_s + run_s for wait_s, run_s in mine)
            worst_s, longest_wait_s = max(map(sum, mine)), max(wait_s for wait_s, _ in mine)
            yield (
                f"{name}: {len(mine)} analyses, alone {length_s:.1f} s, median {middle_s:.1f} s, "
                f"worst {worst_s:.1f} s, longest wait {longest_wait_s:.1f} s; "
                f"delayed by more than alone: {late}; waited longer than they ran: {waited}"
            )
    yield f"honest analyses not succeeded: {sum(state != 'succeeded' for *_, state in shifts)}"
    ended = Counter(row[2] for row in events.get("ended", ()))
    sent = len(events.get("sent", ()))
    yield f"hostile files: {sent} sent, {sum(ended.values())} ended: {dict(ended.most_common())}"
    refused = Counter(row[2] for row in events.get("sent", ()) if row[2] != "202")
    yield f"hostile files refused at once: {dict(refused)}"
    longest_s = max((float(row[4]) for row in events.get("ended", ())), default=0.0)
    yield f"longest hostile analysis: {longest_s:.1f} s"
    sockets = events.get("socket", ())
    sent_mb = sum(int(row[4]) for row in sockets) / 1e6
    yield f"hostile sockets: {len(sockets)}, {sent_mb:.0f} MB, {dict(Counter(row[2] for row in sockets))}"
    for row in events.get("live", ()):
        yield f"honest session: {row[2]}, {row[3]} rows sent, {row[4]} shown, {row[5]} lost, p95 {row[6]} ms"


def main() -> None:
    """Run the soak, and print the summary."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=120.0)
    parser.add_argument("--hours", type=float, nargs="+", default=[1.0, 4.0], help="lengths of the shifts")
    parser.add_argument("--pause", type=float, default=0.0, help="seconds after each hostile file and line")
    parser.add_argument("--folder", type=Path, help="for the events; default: a temporary folder")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=asked.folder) as place:
        folder = Path(place)
        events = asked.folder or folder
        shifts = []
        for hours in asked.hours:
            (made := folder / f"{hours:g}h").mkdir()
            log = write_shift(made, simulate_shift("gt9x", hours, seed=1), actilife_csv=False)[0]
            shifts.append(log.rename(folder / f"{hours:g}h{log.suffix}"))
        settings = {"ACROMION_MAX_CACHE_BYTES": "0", "ACROMION_NO_SECRET": "0"}
        server = RunningServer(folder / "data", folder / "log", workers=2, **settings)
        try:
            soak(server, shifts, 60.0 * asked.minutes, events, asked.pause)
        finally:
            server.stop()
        for line in summarise(events):
            print(line, flush=True)


def soak(server: RunningServer, shifts: list[Path], lasts_s: float, events: Path, pause_s: float) -> None:
    """Measure the quiet server, then run all clients at once."""
    tokens = {}
    accounts = AccountStore(Settings(data_dir=server.data))
    with closing(accounts.database):
        for login in ("honest", "hostile"):
            person = accounts.add_person(login, login, ["clinician"])
            tokens[login] = accounts.add_token(person.id, login, ROLES["clinician"], time.time() + 86_400)
            session = accounts.begin_session(person.id)
            cookie = f"acromion_session_{urlsplit(server.address).port}={session}"
            tokens[f"{login} page"] = cookie
    began_s, honest, hostile = time.monotonic(), tokens["honest"], tokens["hostile"]
    version = f"{server.address}api/v1/version"
    wait_for(lambda: httpx2.get(version, headers=_bear(honest)).is_success)
    quiet = Log(events / "quiet.csv", began_s)
    open_pages(server.address, tokens["honest page"], began_s + QUIET_S, quiet, "quiet page")
    send_shifts(server.address, honest, shifts, began_s + 3600, quiet, "quiet")
    end_s = time.monotonic() + lasts_s
    socket = server.address.replace("http", "ws") + "api/v1/live"
    clients: dict[str, Callable[..., None]] = {
        "files": partial(send_hostile_files, server.address, hostile, end_s, pause_s=pause_s),
        "lines": partial(send_hostile_lines, socket, hostile, end_s, pause_s=pause_s),
        "live": partial(run_honest_session, socket, honest, end_s),
        "pages": partial(open_pages, server.address, tokens["honest page"], end_s),
        "shifts": partial(send_shifts, server.address, honest, shifts, end_s),
    }
    running = [
        SPAWN.Process(target=_run_client, args=(client, events / f"{name}.csv", began_s), name=name)
        for name, client in clients.items()
    ]
    for process in running:
        process.start()
    log = Log(events / "memory.csv", began_s)
    while any(process.is_alive() for process in running):
        sample_memory(server, log)
        time.sleep(SAMPLE_S)
    failed = [process.name for process in running if process.exitcode]
    if failed:
        print(f"clients that failed: {failed}", flush=True)


def _run_client(client: Callable[..., None], path: Path, began_s: float) -> None:
    client(log=Log(path, began_s))


if __name__ == "__main__":
    main()
