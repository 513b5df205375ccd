"""A clinician's conclusion, typed on the recording's page."""

import io

import pypdf
import pytest
from playwright.sync_api import Page, expect

from fusion.simulation import write_recordings
from tests.pages.conftest import finish, repeat
from tests.pages.steps import END_MS, open_analysis
from tests.ways_in.servers import RunningServer

pytestmark = pytest.mark.browser


SAID = {
    "text": "Overhead work is the load.\nMeasure again in May.",
    "name": "M. Tremblay",
    "date": "2026-11-23",
}


@pytest.fixture(scope="module")
def plain_id(server: RunningServer, tmp_path_factory: pytest.TempPathFactory) -> str:
    """A report without a conclusion."""
    file = write_recordings(tmp_path_factory.mktemp("concluded"), "gt9x", 0.02, 61)[0]
    return finish(server, file, subject="S061", side="right")


def test_a_conclusion_makes_a_version_that_says_it_on_page_and_pdf(
    page: Page, server: RunningServer, plain_id: str
) -> None:
    open_analysis(page, server, plain_id)
    page.get_by_label("What you conclude").fill(SAID["text"])
    page.get_by_label("Your name").fill(SAID["name"])
    page.get_by_label("Date").fill(SAID["date"])
    page.get_by_role("button", name="Add to the report").click()
    expect(page.locator(".meta").first).to_contain_text("version 2", timeout=END_MS)
    card = page.locator("section", has=page.get_by_role("heading", name="Conclusion", exact=True))

    expect(card).to_contain_text("Measure again in May.")
    expect(card).to_contain_text("M. Tremblay, 23 November 2026")
    analysis_id = page.url.split("/analyses/")[1].split("?")[0]
    pdf = server.client.get(f"/api/v1/analyses/{analysis_id}/report.pdf", params={"lang": "fr"}).content
    second = pypdf.PdfReader(io.BytesIO(pdf)).pages[1].extract_text()
    assert "Overhead work is the load." in second
    assert "23 novembre 2026" in second.replace("\u00a0", " ")


def test_a_correction_leaves_the_conclusion_out(page: Page, server: RunningServer, plain_id: str) -> None:
    concluded = repeat(server, plain_id, "succeeded", conclusion=SAID | {"name": "A. Roy"})
    open_analysis(page, server, concluded)
    expect(page.get_by_text("A. Roy")).to_be_visible()

    page.get_by_role("radio", name="left").check()
    page.get_by_role("button", name="Analyse again").click()

    expect(page.get_by_role("heading", name="What the correction changed")).to_be_visible(timeout=END_MS)
    expect(page.get_by_text("Measure again in May.")).to_have_count(0)
