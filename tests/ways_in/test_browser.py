"""The whole way in a real browser: drop a recording, see it through, read and take away the report.

Screenshots go to the folder named by ACROMION_SCREENSHOTS, else to pytest's own.
"""

import io
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import pypdf
import pytest
from playwright.sync_api import Browser, ConsoleMessage, Page, ViewportSize, expect

from tests.ways_in.servers import RunningServer
from tests.ways_in.test_three_ways import run_command

pytestmark = pytest.mark.browser

END_MS = 60_000
DROPPED_FILE = """() => {
  const transfer = new DataTransfer();
  transfer.items.add(new File(["x"], "dropped.csv"));
  return transfer;
}"""


@dataclass(frozen=True, slots=True)
class Look:
    """A reader's language, theme and screen."""

    language: str
    scheme: Literal["light", "dark"]
    width: int


LOOKS = [
    pytest.param(Look("en", "light", 1200), id="en-light-desktop"),
    pytest.param(Look("fr", "dark", 1200), id="fr-dark-desktop"),
    pytest.param(Look("fr", "light", 360), id="fr-light-phone"),
    pytest.param(Look("en", "dark", 360), id="en-dark-phone"),
]


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningServer]:
    folder = tmp_path_factory.mktemp("browser")
    running = RunningServer(folder / "data", folder / "server.log")
    yield running
    running.stop()


@pytest.fixture(scope="module")
def finished(server: RunningServer, recording: Path) -> str:
    """The id of an analysis that has succeeded."""
    job = server.send(recording, subject="S012", side="right")
    assert server.see(job["id"], wait=60)["state"] == "succeeded"
    return str(job["id"])


@pytest.fixture
def page(browser: Browser) -> Iterator[Page]:
    """A page that must not complain, nor ask any other host."""
    context = browser.new_context(accept_downloads=True, locale="en-CA")
    opened = context.new_page()
    complaints: list[str] = []
    opened.on("console", lambda message: complaints.append(message.text) if is_complaint(message) else None)
    opened.on("pageerror", lambda error: complaints.append(str(error)))
    opened.on(
        "request",
        lambda request: complaints.append(request.url) if "//127.0.0.1:" not in request.url else None,
    )
    yield opened
    context.close()
    assert complaints == []


def is_complaint(message: ConsoleMessage) -> bool:
    """Leave aside that Chromium writes every refused request to its console."""
    return "status of 422" not in message.text


@pytest.fixture(scope="session")
def screenshots(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = Path(os.environ.get("ACROMION_SCREENSHOTS", "") or tmp_path_factory.mktemp("screenshots"))
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def send(page: Page, server: RunningServer, recording: Path, language: str = "en") -> str:
    """Upload by the page's own field; gives the id of the analysis once it has one."""
    page.goto(f"{server.address}?lang={language}")
    page.get_by_text("Right" if language == "en" else "Droit", exact=True).click()
    page.get_by_label("Subject code" if language == "en" else "Code du sujet").fill("S012")
    known = set(page.locator("#rows .row").evaluate_all("rows => rows.map(row => row.id)"))
    page.set_input_files("#files", recording)
    page.wait_for_function("n => document.querySelectorAll('#rows .row').length > n", arg=len(known))
    (new,) = set(page.locator("#rows .row").evaluate_all("rows => rows.map(row => row.id)")) - known
    return str(new)


def wait_for_end(page: Page, analysis_id: str) -> None:
    row = page.locator(f"#{analysis_id}:not([data-active])")
    row.wait_for(timeout=END_MS)
    assert row.get_attribute("data-state") == "succeeded", row.inner_text()


def test_a_recording_is_uploaded_analysed_read_and_taken_away(
    page: Page, server: RunningServer, recording: Path, screenshots: Path, tmp_path: Path
) -> None:
    analysis_id = send(page, server, recording)
    expect(page.locator(f"#{analysis_id} progress")).to_have_count(2)
    page.screenshot(path=screenshots / "working.png", full_page=True)
    wait_for_end(page, analysis_id)
    row = page.locator(f"#{analysis_id}")

    with page.expect_download() as download:
        row.get_by_role("link", name="PDF").click()
    pdf = pypdf.PdfReader(io.BytesIO(download.value.path().read_bytes()))
    row.get_by_role("link", name="Open the report").click()

    expect(page.locator("h1").first).to_be_visible()
    page.screenshot(path=screenshots / "report.png", full_page=True)
    assert "S012" in page.content()
    assert "S012" in pdf.pages[0].extract_text()
    assert download.value.suggested_filename == f"{recording.stem}_report.en.pdf"


def test_the_browser_gives_the_same_results_as_the_command_line(
    page: Page, server: RunningServer, recording: Path, tmp_path: Path
) -> None:
    analysis_id = send(page, server, recording)
    wait_for_end(page, analysis_id)
    page.goto(f"{server.address}analyses/{analysis_id}")

    with page.expect_download() as download:
        page.get_by_role("link", name="JSON").click()

    by_command = run_command(recording, tmp_path / "out") / "results.json"
    assert download.value.path().read_bytes() == by_command.read_bytes()


def test_the_page_may_be_closed_and_come_back_to(
    page: Page, browser: Browser, server: RunningServer, recording: Path
) -> None:
    analysis_id = send(page, server, recording)
    page.close()

    other = browser.new_page()
    other.goto(server.address)
    wait_for_end(other, analysis_id)

    other.close()


def test_a_file_that_is_no_recording_is_told_with_its_cure(
    page: Page, server: RunningServer, tmp_path: Path, screenshots: Path
) -> None:
    notes = tmp_path / "notes.csv"
    notes.write_text("Dear diary,\ntoday I lifted boxes.\n")
    page.goto(f"{server.address}?lang=fr")

    page.set_input_files("#files", notes)

    failed = page.locator(".row.is-failed").first
    expect(failed).to_contain_text("Que faire", timeout=END_MS)
    page.screenshot(path=screenshots / "failed.png", full_page=True)


def test_an_empty_file_is_refused_on_the_spot(page: Page, server: RunningServer, tmp_path: Path) -> None:
    empty = tmp_path / "empty.gt3x"
    empty.touch()
    page.goto(f"{server.address}?lang=en")

    with page.expect_response("**/api/v1/analyze*") as answer:
        page.set_input_files("#files", empty)

    refused = page.locator("#uploads .row")
    expect(refused).to_contain_text("E-EMPTY")
    assert answer.value.status == 422
    refused.get_by_role("button", name="Remove").click()
    expect(refused).to_have_count(0)


def test_all_of_many_files_are_taken(page: Page, server: RunningServer, tmp_path: Path) -> None:
    files = [tmp_path / f"many_{number}.csv" for number in range(7)]
    for file in files:
        file.write_text("not a recording\n")
    page.goto(f"{server.address}?lang=en")

    page.set_input_files("#files", files)

    for file in files:
        expect(page.locator("#rows .row", has_text=file.name)).to_have_count(1, timeout=END_MS)


def test_dropped_files_are_taken(page: Page, server: RunningServer) -> None:
    page.goto(f"{server.address}?lang=en")
    dropped = page.evaluate_handle(DROPPED_FILE)

    page.dispatch_event(".zone", "drop", {"dataTransfer": dropped})

    expect(page.locator("#rows .row", has_text="dropped.csv")).to_have_count(1, timeout=END_MS)


def test_the_whole_form_is_reached_by_the_keyboard(page: Page, server: RunningServer) -> None:
    page.goto(f"{server.address}?lang=en")
    reached = []

    for _ in range(6):
        page.keyboard.press("Tab")
        reached.append(page.evaluate("document.activeElement.id || document.activeElement.name"))

    assert {"side", "subject", "files"} <= set(reached)


def test_hostile_text_makes_no_element_and_runs_nothing(page: Page, server: RunningServer) -> None:
    name = "<img src=x onerror=alert(1)>.csv"
    page.goto(f"{server.address}?lang=en")
    page.get_by_label("Subject code").fill("</p><script>alert(1)</script>")

    page.set_input_files("#files", {"name": name, "mimeType": "text/csv", "buffer": b"x"})

    row = page.locator("#rows .row", has_text=name).first
    expect(row).to_contain_text("<script>alert(1)</script>", timeout=END_MS)
    assert page.locator("main img, main script").count() == 0


@pytest.mark.parametrize("look", LOOKS)
def test_the_pages_fit_every_screen(
    browser: Browser, server: RunningServer, screenshots: Path, finished: str, look: Look
) -> None:
    viewport: ViewportSize = {"width": look.width, "height": 800}
    context = browser.new_context(viewport=viewport, color_scheme=look.scheme)
    page = context.new_page()

    for name, path in (("home", ""), ("analysis", f"analyses/{finished}")):
        page.goto(f"{server.address}{path}?lang={look.language}")
        file = f"{name}-{look.language}-{look.scheme}-{look.width}.png"
        page.screenshot(path=screenshots / file, full_page=True)
        assert page.evaluate("document.documentElement.scrollWidth") == look.width

    context.close()
