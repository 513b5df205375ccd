"""One server, one browser and a few finished analyses for all tests of the pages.

Screenshots are taken where ACROMION_SCREENSHOTS names a folder for them.
"""

import itertools
import os
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Literal

import pytest
from playwright.sync_api import Browser, BrowserContext, ConsoleMessage, Page, expect

from acromion.fusion.simulation import write_recordings
from tests.pages.steps import keep_no_drafts, open_analysis, see_end, wait_for_curve
from tests.ways_in.servers import RunningServer

HOURS = 0.05
SUBJECTS = itertools.count(400)

expect.set_options(timeout=30_000)


@pytest.fixture(scope="session")
def session_server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningServer]:
    folder = tmp_path_factory.mktemp("pages")
    running = RunningServer(folder / "data", folder / "server.log")
    yield running
    running.stop()


@pytest.fixture(scope="session")
def server(session_server: RunningServer) -> RunningServer:
    """The server of the pages; a file may have one of its own."""
    return session_server


@pytest.fixture(autouse=True)
def no_draft(request: pytest.FixtureRequest) -> None:
    """Forget what an earlier test typed on a page and did not send."""
    for name in {"server", "clinic"} & set(request.fixturenames):
        folder = request.getfixturevalue(name).data
        with closing(sqlite3.connect(folder / "acromion.sqlite3", timeout=120)) as database, database:
            database.execute("DELETE FROM drafts")


@pytest.fixture(scope="session")
def shifts(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Two simulated recordings of three minutes, which begin at the same time."""
    folder = tmp_path_factory.mktemp("shifts")
    made = [write_recordings(folder / str(seed), "gt9x", HOURS, seed)[0] for seed in (1, 2)]
    return made[0], made[1]


@pytest.fixture(scope="session")
def trunk(server: RunningServer, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The id of a finished analysis of a sensor on the trunk: S012, the same day."""
    folder = tmp_path_factory.mktemp("trunk")
    file = write_recordings(folder, "gt9x", HOURS, 3)[0].rename(folder / "trunk.gt3x")
    return finish(server, file, subject="S012", side="trunk")


@pytest.fixture(scope="session")
def unstated(server: RunningServer, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The id of a finished analysis without a stated arm: S012, the same day."""
    folder = tmp_path_factory.mktemp("unstated")
    file = write_recordings(folder, "gt9x", HOURS, 4)[0].rename(folder / "unstated.gt3x")
    return finish(server, file, subject="S012")


@pytest.fixture(scope="session")
def right(server: RunningServer, shifts: tuple[Path, Path]) -> str:
    """The id of a finished analysis: S012, right arm."""
    return finish(server, shifts[0], subject="S012", side="right")


@pytest.fixture
def day(page: Page, server: RunningServer, right: str) -> Page:
    """The page of a finished analysis of three minutes, its curve drawn."""
    keep_no_drafts(page)
    open_analysis(page, server, right)
    wait_for_curve(page)
    return page


@pytest.fixture
def own_day(page: Page, server: RunningServer, shifts: tuple[Path, Path]) -> Page:
    """The page of a finished analysis that only this test corrects, its curve drawn."""
    open_analysis(page, server, finish(server, shifts[0], subject=f"S{next(SUBJECTS)}", side="right"))
    wait_for_curve(page)
    return page


@pytest.fixture(scope="session")
def left(server: RunningServer, shifts: tuple[Path, Path]) -> str:
    """The id of a finished analysis: S012, left arm."""
    return finish(server, shifts[1], subject="S012", side="left")


@pytest.fixture(scope="session")
def repeated(server: RunningServer, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The id of an analysis that failed where the one before it had a report: all of the shift is a break."""
    folder = tmp_path_factory.mktemp("repeated")
    file = write_recordings(folder, "gt9x", 0.02, 51)[0].rename(folder / "repeated.gt3x")
    first = finish(server, file, subject="S051", side="right")
    return repeat(
        server, first, "failed", periods=[{"start": "07:00:00", "end": "07:02:00", "kind": "break"}]
    )


@pytest.fixture(scope="session")
def corrected(server: RunningServer, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The id of a second analysis, with tasks: what is new stands beside what was."""
    folder = tmp_path_factory.mktemp("corrected")
    file = write_recordings(folder, "gt9x", HOURS, 52)[0].rename(folder / "corrected.gt3x")
    first = finish(server, file, subject="S052", side="left")
    tasks = [("07:00:30", "07:01:15", "reaching for the top shelf"), ("07:01:20", "07:02:30", "packing")]
    periods = [{"start": start, "end": end, "kind": "task", "label": label} for start, end, label in tasks]
    return repeat(server, first, "succeeded", periods=periods)


@pytest.fixture(scope="session")
def batch(server: RunningServer, right: str, unknown: str) -> str:
    """The id of a batch that is over: one recording with a report, one without."""
    items = [{"recording_id": server.see(job)["recording_id"]} for job in (right, unknown)]
    told = server.client.post("/api/v1/batches", json={"name": "spring", "items": items}).json()
    for item in server.client.get(told["links"]["analyses"]).json()["items"]:
        see_end(server, item["id"])
    return str(told["id"])


@pytest.fixture(scope="session")
def unknown(server: RunningServer, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The id of a failed analysis: a table whose columns nobody knows."""
    table = tmp_path_factory.mktemp("unknown") / "unknown.csv"
    table.write_text("".join(f"{10 * k};0.0{k % 9};0.0;1.0;0.1;0.2;0.3\n" for k in range(300)))
    job = server.send(table)
    assert see_end(server, job["id"])["state"] == "failed"
    return str(job["id"])


@pytest.fixture(scope="session")
def offered(server: RunningServer, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The id of a failed analysis: somebody has named the columns of another table with its header."""
    folder, jobs = tmp_path_factory.mktemp("offered"), []
    for k in range(2):
        table = folder / f"offered{k}.csv"
        rows = "".join(f"{10 * n};0.0{n % 9};0.0;1.0;0.1;0.2;0.{k}\n" for n in range(300))
        table.write_text("t;a;b;c;d;e;f\n" + rows)
        jobs.append(str(server.send(table)["id"]))
    for job in jobs:
        assert see_end(server, job)["state"] == "failed"
    form = {f"acceleration_{axis}": str(2 + k) for k, axis in enumerate("xyz")}
    form |= {f"angular_rate_{axis}": str(5 + k) for k, axis in enumerate("xyz")}
    header = server.client.get(f"/analyses/{jobs[0]}/columns").text.partition('name="header" value="')[2]
    server.client.post(f"/analyses/{jobs[0]}/columns", data=form | {"header": header.partition('"')[0]})
    return jobs[1]


@pytest.fixture(scope="session")
def context(browser: Browser, session_server: RunningServer) -> Iterator[BrowserContext]:
    """One profile for all pages; a page that stays open keeps their process alive."""
    opened = browser.new_context(accept_downloads=True, locale="en-CA")
    opened.new_page().goto(f"{session_server.address}help")
    yield opened
    opened.close()


@pytest.fixture
def page(context: BrowserContext) -> Iterator[Page]:
    """A page that must not complain, nor ask any other host; what it has stored is forgotten."""
    with open_page(context) as opened:
        yield opened
        storage = {"origin": "*", "storageTypes": "cookies,local_storage,indexeddb"}
        context.new_cdp_session(opened).send("Storage.clearDataForOrigin", storage)
    context.clear_permissions()


@pytest.fixture
def other_browser(browser: Browser) -> Iterator[BrowserContext]:
    """The profile of another person."""
    opened = browser.new_context(locale="en-CA")
    yield opened
    opened.close()


@pytest.fixture(scope="module")
def shown(context: BrowserContext, server: RunningServer, right: str) -> Iterator[Page]:
    """The page of a finished analysis in English, for tests that only read it and take from it."""
    with open_page(context) as opened:
        opened.goto(f"{server.address}analyses/{right}?lang=en")
        yield opened


@contextmanager
def open_page(context: BrowserContext, color_scheme: Literal["light", "dark"] = "light") -> Iterator[Page]:
    """Open a page, and see in the end that nothing was amiss."""
    opened = context.new_page()
    opened.emulate_media(color_scheme=color_scheme)
    opened.set_default_timeout(30_000)
    complaints: list[str] = []
    opened.on("console", lambda message: complaints.append(message.text) if is_complaint(message) else None)
    opened.on("pageerror", lambda error: complaints.append(str(error)))
    opened.on(
        "request",
        lambda request: complaints.append(request.url) if "//127.0.0.1:" not in request.url else None,
    )
    yield opened
    opened.close()
    assert complaints == []


def keep_picture(page: Page, name: str) -> None:
    """Take a picture of the page for a person to look at, if one has asked for it."""
    folder = os.environ.get("ACROMION_SCREENSHOTS", "")
    if folder:
        page.screenshot(path=Path(folder) / f"{name}.png", full_page=True)


def is_complaint(message: ConsoleMessage) -> bool:
    """Leave aside that Chromium writes every refused or broken request to its console."""
    return message.type in ("error", "warning") and "Failed to load resource" not in message.text


def finish(server: RunningServer, recording: Path, **wishes: str) -> str:
    """Analyse a recording by the API; gives the analysis."""
    job = server.send(recording, **wishes)
    assert see_end(server, job["id"])["state"] == "succeeded"
    return str(job["id"])


def repeat(server: RunningServer, analysis_id: str, state: str, **settings: object) -> str:
    """Analyse a recording again by other settings; gives the analysis."""
    wish = {"recording_ids": [server.see(analysis_id)["recording_id"]], "settings": settings}
    again = server.client.post("/api/v1/analyses", json=wish).json()["id"]
    assert see_end(server, again)["state"] == state
    return str(again)
