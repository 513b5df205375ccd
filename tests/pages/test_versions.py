"""Versions of a report: by another analysis, which takes none away if it fails, and by a conclusion."""

import io
import re
from pathlib import Path

import pypdf
import pytest
from playwright.sync_api import Page, expect

from fusion.simulation import write_recordings
from tests.pages.conftest import finish, repeat
from tests.pages.steps import END_MS, find_row, open_analysis, open_home
from tests.ways_in.servers import RunningServer

pytestmark = pytest.mark.browser


def test_a_failed_repetition_leaves_the_report_in_the_list_and_says_why(
    page: Page, server: RunningServer, repeated: str
) -> None:
    open_home(page, server)

    row = find_row(page, "repeated.gt3x")
    expect(row.get_by_role("link", name="Open the report")).to_be_visible()
    row.get_by_text("The last attempt failed").first.click()

    expect(row).to_contain_text("What to do")
    expect(row.get_by_role("button", name="Try again")).to_be_visible()


def test_what_was_asked_in_vain_is_corrected_and_tried_again(
    page: Page, server: RunningServer, repeated: str
) -> None:
    open_home(page, server)

    row = find_row(page, "repeated.gt3x")
    row.get_by_text("The last attempt failed").first.click()
    row.get_by_role("link", name="Correct and try again").click()
    expect(page.get_by_text("These are the settings of the attempt that failed.")).to_be_visible()
    period = page.locator("#periods tr").first
    expect(period.locator("[name=label]")).to_have_value("")
    period.locator("[name=end]").fill("07:00:20")
    page.get_by_label("Reason").fill("the break was short")
    page.get_by_role("button", name="Analyse again").click()

    expect(page.get_by_role("heading", name="The answer in short")).to_be_visible(timeout=END_MS)
    expect(page.locator(".meta").first).to_contain_text("version 2")
    expect(page.get_by_text("Reason: the break was short").first).to_be_visible()
    expect(page.get_by_role("row", name="Periods not stated Break 07:00:00 – 07:00:20")).to_be_visible()


def test_earlier_versions_stay_within_reach_with_what_each_changed(
    page: Page, server: RunningServer, tmp_path: Path
) -> None:
    file = write_recordings(tmp_path, "gt9x", 0.02, 52)[0]
    analysis_id = finish(server, file, subject="S052", side="right")
    repeat(server, analysis_id, "succeeded", side="left")
    newest = repeat(server, analysis_id, "succeeded", side="left", calibration=["3,9"])

    open_analysis(page, server, newest)

    versions = page.locator("section", has=page.get_by_role("heading", name="Versions of this report"))
    told = versions.get_by_role("listitem")
    expect(told).to_have_count(3)
    expect(told.nth(0)).to_have_text(re.compile(r"version 3 \(shown here\) · .* different: the calibration"))
    expect(told.nth(1)).to_have_text(re.compile(r"version 2 · .* What is different: the arm"))
    expect(told.nth(2)).to_have_text(re.compile(r"version 1 · .* first version"))
    expect(page.get_by_role("columnheader", name="Before (version 2)").first).to_be_visible()
    versions.get_by_role("link", name="version 1").click()
    expect(page).to_have_url(re.compile(analysis_id))


def test_the_report_of_a_correction_names_its_version_and_what_is_different(
    page: Page, server: RunningServer, tmp_path: Path
) -> None:
    file = write_recordings(tmp_path, "gt9x", 0.02, 53)[0]
    newest = repeat(server, finish(server, file), "succeeded", side="left")
    open_analysis(page, server, newest)

    page.get_by_role("link", name="Read in English").click()

    expect(page.get_by_text("Version 2 of this report; it replaces version 1.")).to_be_visible()
    expect(page.get_by_text("What is different: the arm.")).to_be_visible()


def test_whose_arm_it_is_said_in_a_correction_holds_for_the_recording_too(
    page: Page, server: RunningServer, tmp_path: Path
) -> None:
    file = write_recordings(tmp_path, "gt9x", 0.02, 57)[0]
    analysis_id = finish(server, file, side="right")
    open_analysis(page, server, analysis_id)

    page.locator("#correction").get_by_label("Subject code").fill("S057")
    page.get_by_role("button", name="Analyse again").click()
    expect(page).to_have_url(re.compile("before="))

    recording_id = server.see(analysis_id)["recording_id"]
    kept = server.client.get(f"/api/v1/recordings/{recording_id}").json()
    assert (kept["subject"], kept["side"]) == ("S057", "right")


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
