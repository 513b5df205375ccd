"""Live sessions: bit-identical replay, latency to the screen, twenty at once, data lost by a kill.

    python -m benchmarks.live [--hours 8] [--minutes 10] [--sessions 20] [--seconds 60]

Each part prints its line. The server is killed with SIGKILL while lines arrive at 100 Hz; the loss is counted
in the recording that the next server makes of the remaining data.
"""

import argparse
import asyncio
import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, Literal

import numpy as np
import psutil
from playwright.sync_api import sync_playwright
from websockets.asyncio.client import connect

from acromion.app.live.recorder import Recorder
from acromion.app.live.sources import ReplaySource
from acromion.app.settings import Settings
from acromion.fusion.live import LiveElevation
from acromion.fusion.readers import read_recording
from acromion.fusion.simulation import write_recordings
from tests.app.live.made import count_stored_rows
from tests.ways_in.servers import RunningServer

HEADER = "# device: LSM9DS1\ntime_us,counter,acc_x_g,acc_y_g,acc_z_g,gyr_x_dps,gyr_y_dps,gyr_z_dps\n"
RATE_HZ, CHUNK_ROWS, SETTLED_S = 100, 4, 10.0
PERCENTILES = (50, 99)
WATCH = """() => {
  window.taken = [];
  const place = document.getElementById("latency");
  const look = () => window.taken.push(Number(place.dataset.ms));
  new MutationObserver(look).observe(place, { attributes: true });
}"""


def start_server(data: Path, log: Path) -> RunningServer:
    """Start a server that runs no analysis and requires no secret."""
    return RunningServer(data, log, 0, ACROMION_NO_SECRET="1")


def measure_replay(
    folder: Path, device: Literal["gt9x", "lsm9ds1"], hours: float, rate_hz: float | None
) -> None:
    """Replay a recording at full speed, recorded and shown, and compare with the file's own angle."""
    log = write_recordings(folder / device, device, hours, 1, rate_hz)[0]
    recording = read_recording(log)
    source = ReplaySource(recording, log.name, 20.0, wait=lambda _: None)
    recorder = Recorder(folder / f"{device}.csv", source.facts)
    began_s, shown = time.process_time(), []
    while (frames := source.read()) is not None:
        shown.append(recorder.take(frames).elevation_deg)
    taken_s = time.process_time() - began_s
    recorder.stop()
    live = LiveElevation(recording.rate_hz, source.facts.arm_axis)
    expected = np.concatenate([live.update(one.acc_g, one.gyr_dps) for one in recording.segments])
    equal = np.array_equal(np.concatenate(shown), expected)
    recorded_s = recording.duration_us / 1e6
    print(
        f"{device} {hours:g} h at {recording.rate_hz:g} Hz, {len(recording.segments)} segment(s): "
        f"bit-identical: {equal}; {taken_s:.1f} s of CPU, {recorded_s / taken_s:.0f} times real time"
    )


def measure_latency(running: RunningServer, seconds: float) -> None:
    """Measure the latency from the arrival of frames at the server to the screen, in headless Chromium."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path="/usr/bin/chromium", args=["--no-sandbox"])
        page = browser.new_page()
        page.goto(f"{running.address}live?lang=en")
        page.click("#begin")
        page.wait_for_selector("#latency[data-ms]")
        page.wait_for_timeout(5000)  # until the clocks are synchronised
        page.evaluate(WATCH)
        page.wait_for_timeout(1000 * seconds)
        taken_ms = page.evaluate("() => window.taken")
        page.keyboard.press("s")
        browser.close()
    p50, p99 = np.percentile(taken_ms, PERCENTILES)
    print(f"latency over {seconds:g} s: p50 {p50:.0f} ms, p99 {p99:.0f} ms, {len(taken_ms)} pictures")


def write_rows(first: int, stop: int) -> bytes:
    """Return rows of a hanging arm."""
    rows = (f"{10_000 * k},{k},0.00{k % 7},0.01,0.99{k % 5},0.1,0.2,0.{k % 9}\n" for k in range(first, stop))
    return "".join(rows).encode()


async def feed(address: str, seconds: float) -> dict[str, Any]:
    """Run one session at 100 Hz; return its last status."""
    status: dict[str, Any] = {}
    async with connect(address, max_queue=None) as socket:
        await socket.send(json.dumps({"type": "start", "source": "lines", "name": "bench", "axis": "+z"}))

        async def hear() -> None:
            async for text in socket:
                message = json.loads(text)
                status.update(message.get("status", {}))
                if message["type"] == "ended":
                    return

        hearing = asyncio.create_task(hear())
        await socket.send(HEADER.encode())
        began_s = time.monotonic()
        for first in range(0, round(seconds * RATE_HZ), CHUNK_ROWS):
            await socket.send(write_rows(first, first + CHUNK_ROWS))
            await asyncio.sleep(max(0.0, began_s + first / RATE_HZ - time.monotonic()))
        await asyncio.sleep(2.0)
        await socket.send(json.dumps({"type": "stop"}))
        await hearing
    return status


async def feed_all(address: str, sessions: int, seconds: float) -> list[dict[str, Any]]:
    """Run all sessions at once."""
    return await asyncio.gather(*(feed(address, seconds) for _ in range(sessions)))


def measure_cpu_s(server: psutil.Process) -> float:
    """Return the CPU time of a server and its child processes."""
    times = [one.cpu_times() for one in (server, *server.children(recursive=True))]
    return sum(one.user + one.system for one in times)


def measure_many(running: RunningServer, sessions: int, minutes: float) -> None:
    """Measure CPU and memory of the server and of the sessions, and the lost frames."""
    server = psutil.Process(running.process.pid)
    address = running.address.replace("http", "ws") + "api/v1/live"
    asyncio.run(feed_all(address, 1, 5.0))  # loads the analysis code
    own_s = resource.getrusage(resource.RUSAGE_SELF).ru_utime

    async def run() -> tuple[list[dict[str, Any]], float, float, float]:
        feeding = asyncio.create_task(feed_all(address, sessions, 60.0 * minutes))
        await asyncio.sleep(SETTLED_S)
        before_s, began_s = measure_cpu_s(server), time.monotonic()
        await asyncio.sleep(60.0 * minutes - 2 * SETTLED_S)
        cpu_s, taken_s = measure_cpu_s(server) - before_s, time.monotonic() - began_s
        children = sum(one.memory_full_info().pss for one in server.children(recursive=True))
        return await feeding, cpu_s, taken_s, children

    found, cpu_s, taken_s, children_bytes = asyncio.run(run())
    own_s = resource.getrusage(resource.RUSAGE_SELF).ru_utime - own_s
    print(
        f"{sessions} sessions at {RATE_HZ} Hz for {minutes:g} min: {100 * cpu_s / taken_s:.0f} % of a core, "
        f"server {server.memory_info().rss / (1 << 20):.0f} MiB, "
        f"sessions {children_bytes / (1 << 20):.0f} MiB, lost {sum(one['lost'] for one in found)} of "
        f"{sum(one['frames'] for one in found)} (the benchmark itself: {100 * own_s / taken_s:.0f} %)"
    )


async def feed_until_killed(running: RunningServer, address: str, seconds: float) -> int:
    """Run one recorded session, then kill the server; return the number of sent rows."""
    sent = 0
    async with connect(address, max_queue=None) as socket:
        asked = {"type": "start", "source": "lines", "name": "bench", "axis": "+z", "keeps": True}
        await socket.send(json.dumps(asked))
        await socket.send(HEADER.encode())
        began_s = time.monotonic()
        while time.monotonic() - began_s < seconds:
            await socket.send(write_rows(sent, sent + CHUNK_ROWS))
            sent += CHUNK_ROWS
            await asyncio.sleep(max(0.0, began_s + sent / RATE_HZ - time.monotonic()))
        running.process.kill()
    return sent


def measure_kill(folder: Path, after_s: float, *, is_busy: bool) -> float:
    """Return the seconds that a kill of a fresh server loses: sent seconds minus those in the recording."""
    log = folder.with_suffix(".log")
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(2 * is_busy)]
    try:
        running = start_server(folder, log)
        address = running.address.replace("http", "ws") + "api/v1/live"
        sent = asyncio.run(feed_until_killed(running, address, after_s))
        running.process.wait()
    finally:
        for process in busy:
            process.kill()
            process.wait()
    again = start_server(folder, log)
    stored = again.client.get("/api/v1/recordings").json()["items"]
    again.stop()
    rows = sum(count_stored_rows(Settings(data_dir=folder), one["id"]) for one in stored)
    lost_s = (sent - rows) / RATE_HZ
    print(
        f"kill after {after_s:.1f} s{', cores busy' * is_busy}: {sent} sent, {lost_s:.2f} s lost", flush=True
    )
    return lost_s


def measure_kills(folder: Path, rounds: int) -> None:
    """Run several kills, half of them in the first seconds of a server, every other one with busy cores."""
    kills = [
        (0.5 + 0.7 * number if number < rounds / 2 else 12.0 + 0.37 * number, number % 2 == 0)
        for number in range(rounds)
    ]
    lost_s = [
        measure_kill(folder / f"kill{number}", after_s, is_busy=is_busy)
        for number, (after_s, is_busy) in enumerate(kills)
    ]
    print(
        f"kills of the server: {rounds}; lost {max(lost_s):.2f} s at most, {np.mean(lost_s):.2f} s on average"
    )


def main() -> None:
    """Run the parts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=8.0)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--sessions", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--kills", type=int, default=10)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        measure_replay(folder, "gt9x", asked.hours, None)
        measure_replay(folder, "lsm9ds1", asked.hours, 500.0)
        running = start_server(folder / "data", folder / "log")
        try:
            measure_latency(running, asked.seconds)
            measure_many(running, asked.sessions, asked.minutes)
        finally:
            running.stop()
        measure_kills(folder, asked.kills)


if __name__ == "__main__":
    main()
