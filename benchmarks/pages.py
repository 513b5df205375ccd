"""Measure the pages in Chromium: a long curve, 10,000 recordings, a 300 MB upload, 8 h from drop to report.

    python -m benchmarks.pages

Prints medians and 95th percentiles, and the machine's load, because they depend on it.
"""

import os
import secrets
import shutil
import statistics
import tempfile
import time
import zipfile
from pathlib import Path

from playwright.sync_api import Browser, Page, sync_playwright
from sqlalchemy import insert

from acromion.app.library.batches import join_study
from acromion.app.library.database.tables import analyses, answers, recordings
from acromion.app.library.jobs import JobStore
from acromion.app.library.rows import JobState
from acromion.app.request import ReportRequest
from acromion.app.settings import Settings
from acromion.fusion.simulation import write_recordings
from tests.ways_in.servers import RunningServer

LIBRARY, STUDY = 10_000, 200
STEPS = 60
DROPS = 5
UPLOAD_BYTES = 300_000_000
TIMINGS = """performance.getEntriesByType("resource")
  .filter((entry) => entry.name.includes("/curve?")).map((entry) => entry.duration)"""


def fill_library(data: Path) -> None:
    store = JobStore(Settings(data_dir=data))
    rows, jobs, results = [], [], []
    for number in range(LIBRARY):
        recording, analysis = f"rec_{secrets.token_hex(8)}", f"an_{secrets.token_hex(8)}"
        moment = (
            f"2025-{number % 12 + 1:02d}-{number % 28 + 1:02d}T07:00:{number % 60:02d}.{number:06d}+00:00"
        )
        name = {"file_name": f"shift_{number}.gt3x", "subject": f"S{number % 500:03d}"}
        rows.append({"id": recording, "sha256": "0" * 64, "size_bytes": 50_000_000, "state": "stored"} | name)
        rows[-1] |= {"created_at": moment}
        request = ReportRequest(name["file_name"], name["subject"], ("left", "right")[number // 500 % 2])
        job: dict[str, object] = {
            "id": analysis,
            "recording_id": recording,
            "request": request.to_json(),
            "way_in": "api",
        }
        job |= {"state": JobState.SUCCEEDED, "progress": 1.0, "attempts": 1, "beats": 1, "created_at": moment}
        jobs.append(job)
        verdict = ("good", "caution", "poor")[number % 3]
        figures = {"recorded_s": 28_800.0, "above_60_percent": number % 40 / 2}
        figures |= {"above_60_low_percent": number % 40 / 4, "above_60_high_percent": number % 40 * 1.0}
        results.append({"analysis_id": analysis, "verdict": verdict, "start": moment[:19]} | figures)
    with store.engine.begin() as connection:
        for table, values in ((recordings, rows), (analyses, jobs), (answers, results)):
            connection.execute(insert(table), values)
        for job in jobs[:STUDY]:
            join_study(connection, "Packing line", str(job["id"]))
    store.close()


def measure_curve(page: Page, address: str) -> None:
    page.goto(address)
    page.locator("#curve .main-svg").first.wait_for()
    page.locator("#curve").scroll_into_view_if_needed()
    page.evaluate("acromionDay.steps.length = 0")
    for key in (["+"] * 6 + ["ArrowRight"] * 8 + ["-"] * 6) * (STEPS // 20):
        page.locator("#curve").press(key)
        page.wait_for_timeout(120)
    print_times("a step of pan or zoom, key to drawn", page.evaluate("acromionDay.steps"))
    print_times("a piece of the curve, request to response", page.evaluate(TIMINGS))


LISTS = {
    "": "#drop[data-api]",
    "?order=above_60": "#drop[data-api]",
    "persons": ".persons tbody",
    "person?subject=S001": ".by-day",
    "studies": ".rows",
    "studies?name=Packing line": ".ranking",
}
"""Pages of the library, and a part that shows each is ready."""


def measure_library(browser: Browser, address: str) -> None:
    for path, ready in LISTS.items():
        taken: dict[str, list[float]] = {"first visit": [], "again": []}
        for _ in range(5):
            page = browser.new_page()  # with an empty cache
            for visits in taken.values():
                page.goto("about:blank")
                began_s = time.perf_counter()
                page.goto(address + path, wait_until="domcontentloaded")
                page.wait_for_selector(ready, state="visible")
                visits.append(1000 * (time.perf_counter() - began_s))
            page.close()
        for visit, taken_ms in taken.items():
            print_times(f"/{path} with {LIBRARY} recordings, {visit}, to interactive", taken_ms)


def measure_upload(browser: Browser, running: RunningServer, folder: Path) -> None:
    """Compare the page's upload with one raw PUT of the same size to the same server."""
    taken: dict[str, list[float]] = {"page": [], "put": []}
    for number in range(3):
        by_page, by_put = (folder / f"{way}_{number}.csv" for way in taken)
        for path in (by_page, by_put):
            path.write_bytes(os.urandom(UPLOAD_BYTES))
        page = browser.new_page()
        page.goto(running.address)
        began_s = time.perf_counter()
        with page.expect_response(lambda answer: "acromion-recording" in answer.headers, timeout=120_000):
            page.set_input_files("#files", by_page)
        taken["page"].append(time.perf_counter() - began_s)
        page.close()
        began_s = time.perf_counter()
        with by_put.open("rb") as file:
            running.client.post("/api/v1/recordings", content=file)
        taken["put"].append(time.perf_counter() - began_s)
        for path in (by_page, by_put):
            path.unlink()
    speed = {way: UPLOAD_BYTES / 1e6 / statistics.median(seconds) for way, seconds in taken.items()}
    share = 100 * speed["page"] / speed["put"]
    print(f"upload of 300 MB: page {speed['page']:.0f} MB/s, raw {speed['put']:.0f} MB/s, {share:.0f} %")


def measure_drop(browser: Browser, running: RunningServer, folder: Path) -> None:
    """Time an 8 h `.gt3x` from the drop to its report in the list, on a warm server."""
    log = next(path for path in write_recordings(folder / "shift", "gt9x", 8.0, 1) if path.suffix == ".gt3x")
    taken_ms = []
    for number in range(DROPS + 1):
        other = folder / f"day_{number}.gt3x"
        shutil.copy(log, other)
        with zipfile.ZipFile(other, "a") as archive:
            archive.comment = str(number).encode()  # otherwise the server knows the bytes
        page = browser.new_page()
        page.goto(f"{running.address}?lang=en")
        began_s = time.perf_counter()
        page.set_input_files("#files", other)
        done = page.locator('#rows .row[data-state="succeeded"]', has_text=other.name)
        done.first.wait_for(timeout=120_000)
        taken_ms.append(1000 * (time.perf_counter() - began_s))
        page.close()
    print_times("drop of 8 h to report", taken_ms[1:])


def print_times(name: str, taken_ms: list[float]) -> None:
    ordered = sorted(taken_ms)
    p95 = ordered[min(len(ordered) - 1, int(0.95 * len(ordered)))]
    print(f"{name}: median {statistics.median(ordered):.0f} ms, p95 {p95:.0f} ms, n {len(ordered)}")


def main() -> None:
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    with tempfile.TemporaryDirectory() as name, sync_playwright() as playwright:
        folder = Path(name)
        running = RunningServer(folder / "data", folder / "server.log")
        try:
            log = next(iter(write_recordings(folder / "long", "lsm9ds1", 8.0, 1)))  # 14.4 million samples
            job = running.send(log)
            running.see(job["id"], wait=120)
            fill_library(folder / "data")
            chromium = shutil.which("chromium") or shutil.which("google-chrome")
            browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
            measure_curve(browser.new_page(), f"{running.address}analyses/{job['id']}?lang=en")
            measure_library(browser, running.address)
            measure_upload(browser, running, folder)
            measure_drop(browser, running, folder)
            browser.close()
        finally:
            running.stop()


if __name__ == "__main__":
    main()
