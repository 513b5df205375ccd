"""Versions of a report: by another analysis, which takes none away if it fails, and by a conclusion."""

import io
import re
from itertools import count
from pathlib import Path

import pypdf
import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from acromion.fusion.simulation import write_recordings
from tests.pages.conftest import finish, repeat
from tests.pages.steps import END_MS, find_row, open_analysis, open_home, see_end
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
    page.get_by_role("button", name="Update").click()

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
    page.get_by_role("button", name="Update").click()
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


def find_conclusion(page: Page) -> Locator:
    """The card of the conclusion."""
    return page.locator("section", has=page.get_by_role("heading", name="Conclusion", exact=True))


def test_a_conclusion_makes_a_version_that_says_it_on_page_and_pdf(
    page: Page, server: RunningServer, plain_id: str
) -> None:
    open_analysis(page, server, plain_id)
    page.get_by_label("What you conclude").fill(SAID["text"])
    page.get_by_label("Your name").fill(SAID["name"])
    page.get_by_label("Date").fill(SAID["date"])
    page.get_by_role("button", name="Add to the report").click()
    expect(page.locator(".meta").first).to_contain_text("version 2", timeout=END_MS)
    card = find_conclusion(page)

    expect(card).to_contain_text("Measure again in May.")
    expect(card).to_contain_text("M. Tremblay, 23 November 2026")
    analysis_id = page.url.split("/analyses/")[1].split("?")[0]
    pdf = server.client.get(f"/api/v1/analyses/{analysis_id}/report.pdf", params={"lang": "fr"}).content
    first = pypdf.PdfReader(io.BytesIO(pdf)).pages[0].extract_text()
    assert "Overhead work is the load." in first
    assert "23 novembre 2026" in first.replace("\u00a0", " ")


SEEDS = count(620)
"""A recording for each test: the same bytes are not analysed again."""


@pytest.fixture
def corrected_id(server: RunningServer, tmp_path: Path) -> str:
    """Version 3: another arm than that of version 2, which has a conclusion."""
    file = write_recordings(tmp_path, "gt9x", 0.02, next(SEEDS))[0]
    first = finish(server, file, subject="S062", side="right")
    repeat(server, first, "succeeded", conclusion=SAID)
    return repeat(server, first, "succeeded", side="left")


def read_pdf(server: RunningServer, page: Page) -> str:
    """Read the English PDF of the analysis that a page shows."""
    analysis_id = page.url.split("/analyses/")[1].split("?")[0]
    pdf = server.client.get(f"/api/v1/analyses/{analysis_id}/report.pdf", params={"lang": "en"}).content
    return "\n".join(part.extract_text() for part in pypdf.PdfReader(io.BytesIO(pdf)).pages)


def test_a_correction_on_the_page_makes_a_draft_of_the_conclusion(
    page: Page, server: RunningServer, plain_id: str
) -> None:
    concluded = repeat(server, plain_id, "succeeded", conclusion=SAID | {"name": "A. Roy"})
    open_analysis(page, server, concluded)
    expect(find_conclusion(page)).to_contain_text("A. Roy")

    page.get_by_role("radio", name="left").check()
    page.get_by_role("button", name="Update").click()

    expect(page.get_by_role("heading", name="Before and now")).to_be_visible(timeout=END_MS)
    card = find_conclusion(page)
    expect(card).to_contain_text(
        re.compile(r"Conclusion of version \d, written for other figures \(changed since: the arm\)")
    )
    expect(card).to_contain_text("A. Roy, 23 November 2026")
    expect(card.get_by_label("What you conclude")).to_have_value(SAID["text"])


def test_no_report_prints_a_draft(page: Page, server: RunningServer, corrected_id: str) -> None:
    open_analysis(page, server, corrected_id)

    assert "Overhead work is the load." not in read_pdf(server, page)


def test_a_draft_is_confirmed_by_one_click(page: Page, server: RunningServer, corrected_id: str) -> None:
    open_analysis(page, server, corrected_id)

    page.get_by_role("button", name="Confirm for this version").click()

    expect(page.locator(".meta").first).to_contain_text("version 4", timeout=END_MS)
    expect(find_conclusion(page)).to_contain_text("Measure again in May.")
    expect(page.get_by_text("Draft, not in the report")).to_have_count(0)
    assert "Overhead work is the load." in read_pdf(server, page)


def test_without_scripts_a_draft_is_confirmed_too(
    browser: Browser, server: RunningServer, corrected_id: str
) -> None:
    context = browser.new_context(java_script_enabled=False)
    plain = context.new_page()
    open_analysis(plain, server, corrected_id)

    plain.get_by_role("button", name="Confirm for this version").click()

    expect(plain).not_to_have_url(re.compile(corrected_id))
    analysis_id = plain.url.split("/analyses/")[1]
    context.close()
    assert see_end(server, analysis_id)["conclusion"]["text"] == SAID["text"]


# The banner of an old version.


@pytest.mark.parametrize(
    ("language", "told"),
    [
        ("en", "This is version 1 of 2. See the current version (version 2)"),
        ("fr", "Vous consultez la version 1 sur 2. Voir la version actuelle (version 2)"),
    ],
)
def test_an_old_version_leads_to_the_current_one(
    page: Page, server: RunningServer, two_versions: tuple[str, str], language: str, told: str
) -> None:
    old, current = two_versions
    open_analysis(page, server, old, language)
    expect(page.locator("#old")).to_have_text(told)

    page.locator("#old").get_by_role("link").click()

    expect(page).to_have_url(re.compile(current))
    expect(page.locator("#old")).to_have_count(0)


def test_the_report_of_an_old_version_leads_to_the_current_one(
    page: Page, server: RunningServer, two_versions: tuple[str, str]
) -> None:
    old, current = two_versions
    page.goto(f"{server.address}analyses/{old}/report.html?lang=en")
    expect(page.get_by_text("This is version 1 of 2.")).to_be_visible()

    page.get_by_role("link", name="See the current version (version 2)").click()

    expect(page).to_have_url(re.compile(current))


@pytest.fixture(scope="module")
def two_versions(server: RunningServer, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    """An old version and the current one."""
    file = write_recordings(tmp_path_factory.mktemp("two"), "gt9x", 0.02, 63)[0]
    first = finish(server, file, subject="S063", side="right")
    return first, repeat(server, first, "succeeded", side="left")
