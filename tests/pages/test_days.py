"""Several days on the page: from a recording to the days of its person, choosing among them."""

import re

import pytest
from playwright.sync_api import Page, expect

from tests.pages.steps import open_analysis
from tests.ways_in.servers import RunningServer

pytestmark = pytest.mark.browser


def open_days(page: Page, server: RunningServer, left: str, right: str) -> None:
    page.goto(f"{server.address}days?analysis={left}&analysis={right}")


def test_a_recording_leads_to_the_days_of_its_person(
    page: Page, server: RunningServer, right: str, left: str
) -> None:
    open_analysis(page, server, right)

    page.get_by_role("link", name="Several days of S012 together").click()

    expect(page.get_by_role("heading", level=1)).to_have_text("Arm Elevation Profile of several days")


def test_a_day_is_taken_away_and_the_form_stays_for_another_choice(
    page: Page, server: RunningServer, right: str, left: str
) -> None:
    open_days(page, server, left, right)
    chosen = page.locator("input[name=analysis]:checked")
    expect(chosen).to_have_count(2)

    chosen.first.uncheck()
    page.get_by_role("button", name="Apply").click()

    expect(page.get_by_role("alert")).to_contain_text("a profile takes two recordings or more")
    expect(page.locator("input[name=analysis]:checked")).to_have_count(1)


def test_a_day_is_set_after_a_change(page: Page, server: RunningServer, right: str, left: str) -> None:
    open_days(page, server, left, right)

    page.locator(f"input[name=after][value={right}]").check()
    page.get_by_role("button", name="Apply").click()

    expect(page.locator(".sentences")).to_contain_text("Nobody has days that count both before and after")
    expect(page.locator(f"input[name=after][value={right}]")).to_be_checked()


def test_the_pdf_is_one_click_away(page: Page, server: RunningServer, right: str, left: str) -> None:
    open_days(page, server, left, right)

    with page.expect_download() as download:
        page.get_by_role("link", name="PDF").click()

    assert re.fullmatch(r"S012_profile\.en\.pdf", download.value.suggested_filename)
