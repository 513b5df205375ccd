"""Taking away: every file, the summary for the record, the other language, the definitions."""

import io
from pathlib import Path

import pypdf
import pytest
from playwright.sync_api import BrowserContext, Page, expect

from tests.pages.conftest import keep_picture, open_page
from tests.pages.steps import open_analysis
from tests.ways_in.servers import RunningServer
from tests.ways_in.test_three_ways import run_command

pytestmark = pytest.mark.browser


def test_the_original_is_downloaded_under_its_name(shown: Page, shifts: tuple[Path, Path]) -> None:
    shown.get_by_text("Settings and origin", exact=True).click()
    link = shown.get_by_role("link", name="Download the original recording")
    keep_picture(shown, "original")

    with shown.expect_download() as download:
        link.click()

    assert download.value.suggested_filename == shifts[0].name
    assert download.value.path().read_bytes() == shifts[0].read_bytes()


def test_the_page_gives_the_same_results_as_the_command_line(
    shown: Page, shifts: tuple[Path, Path], tmp_path: Path
) -> None:
    shown.get_by_text("Files", exact=True).last.click()
    with shown.expect_download() as download:
        shown.get_by_role("link", name="Every figure (JSON)").click()

    by_command = run_command(shifts[0], tmp_path / "out") / "results.json"
    assert download.value.path().read_bytes() == by_command.read_bytes()


def test_the_answer_is_copied_in_six_lines(page: Page, server: RunningServer, right: str) -> None:
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    open_analysis(page, server, right)

    page.get_by_role("button", name="Copy the answer for the clinical record").click()

    expect(page.locator("#status")).to_have_text("Copied")
    copied = page.evaluate("navigator.clipboard.readText()")
    assert len(copied.strip().splitlines()) == 6
    assert "S012" in copied


def test_each_figure_has_its_definition_by_one_click_hover_or_key(shown: Page) -> None:
    table = shown.get_by_role("region", name="Figures").first
    marks = table.locator(".define summary")
    assert marks.count() == table.get_by_role("row").count() == 8

    titles = [mark.get_attribute("title") or "" for mark in marks.all()]
    assert [word in title for word, title in zip(("30°", "60°", "level"), titles, strict=False)] == [True] * 3
    marks.nth(1).focus()
    shown.keyboard.press("Enter")

    expect(table.locator(".define span").filter(has_text="shoulder height").first).to_be_visible()


def test_the_poses_are_printed_on_one_sheet_in_dark_ink(
    context: BrowserContext, server: RunningServer
) -> None:
    with open_page(context, color_scheme="dark") as page:
        page.goto(f"{server.address}help/poses?lang=fr")

        printed = page.pdf(format="Letter", prefer_css_page_size=False)
        page.emulate_media(media="print")
        ink = page.evaluate("getComputedStyle(document.body).color")

    assert len(pypdf.PdfReader(io.BytesIO(printed)).pages) == 1
    assert ink == "rgb(29, 42, 46)"


def test_a_report_leads_back_to_its_page_to_its_pdf_and_to_the_other_language(
    page: Page, server: RunningServer, right: str
) -> None:
    open_analysis(page, server, right)

    page.get_by_role("link", name="Read in English").click()
    page.get_by_role("link", name="Français").click()
    with page.expect_download() as download:
        page.get_by_role("link", name="PDF").click()
    page.get_by_role("link", name="Retour à la page").click()

    assert download.value.suggested_filename.endswith(".fr.pdf")
    expect(page).to_have_url(f"{server.address}analyses/{right}")


def test_what_leads_back_is_neither_printed_nor_in_the_file(
    page: Page, server: RunningServer, right: str
) -> None:
    page.goto(f"{server.address}analyses/{right}/report.html?lang=en")
    expect(page.locator(".way")).to_be_visible()

    page.emulate_media(media="print")

    expect(page.locator(".way")).to_be_hidden()
    assert "Back to the page" not in server.client.get(f"/api/v1/analyses/{right}/report.html").text


def test_no_page_shows_an_address_of_the_api(page: Page, server: RunningServer, right: str) -> None:
    for address in ("", f"analyses/{right}", f"analyses/{right}/report.html", "studies", "help/reading"):
        page.goto(server.address + address)

        assert "/api/v1" not in page.locator("body").inner_text(), address
