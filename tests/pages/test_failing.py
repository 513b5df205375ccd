"""When it fails: what, where, what to do, a code, a page that explains it; and nothing is lost."""

import re
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from tests.pages.steps import END_MS, find_row, find_upload, make_file, open_home, see_end
from tests.ways_in.servers import RunningServer

pytestmark = pytest.mark.browser

EPOCHS = (
    """------------ Data File Created By ActiGraph GT3X+ ActiLife v6.13.3 date format M/d/yyyy Normal
Serial Number: TAS1E00000000
Start Time 07:00:00
Start Date 3/2/2026
Epoch Period (hh:mm:ss) 00:01:00
Download Time 15:00:00
Download Date 3/2/2026
Current Memory Address: 0
Current Battery Voltage: 4.0     Mode = 12
--------------------------------------------------
"""
    + "1,2,3,4\n" * 500
)


def test_a_refusal_says_what_happened_and_what_to_do_and_leads_to_help(
    page: Page, server: RunningServer, tmp_path: Path
) -> None:
    epochs = tmp_path / "epochs.csv"
    epochs.write_text(EPOCHS)
    open_home(page, server, "fr")

    page.set_input_files("#files", epochs)
    failed = find_row(page, "epochs.csv")

    expect(failed).to_contain_text("Que faire", timeout=END_MS)
    expect(failed).to_contain_text("E-EPOCH")
    failed.locator("summary").click()
    failed.get_by_role("link", name="E-EPOCH").click()
    expect(page.get_by_role("heading", level=1)).to_have_text(re.compile("époque|epoch", re.IGNORECASE))


def test_the_details_are_copied_without_what_is_personal(
    page: Page, server: RunningServer, tmp_path: Path
) -> None:
    server.send(make_file(tmp_path, "details.csv"), subject="SECRET7")
    open_home(page, server)
    failed = find_row(page, "details.csv")
    expect(failed).to_have_attribute("data-state", "failed", timeout=END_MS)

    copied = failed.locator("[data-copy]").get_attribute("data-copy") or ""

    assert re.match(r"E-[A-Z]+", copied)
    assert "SECRET7" not in copied
    assert "details.csv" not in copied


def test_a_failed_analysis_keeps_the_file(page: Page, server: RunningServer, tmp_path: Path) -> None:
    job = server.send(make_file(tmp_path, "kept.csv"))
    assert see_end(server, job["id"])["state"] == "failed"
    page.goto(f"{server.address}analyses/{job['id']}?lang=en")

    page.get_by_role("button", name="Try again").click()

    expect(page).not_to_have_url(re.compile(job["id"]))
    expect(page.get_by_role("heading", level=1)).to_have_text("kept.csv")


def test_an_empty_file_is_refused_on_the_spot(page: Page, server: RunningServer, tmp_path: Path) -> None:
    empty = tmp_path / "empty.gt3x"
    empty.touch()
    open_home(page, server)

    page.set_input_files("#files", empty)

    refused = find_upload(page, "empty.gt3x")
    expect(refused).to_contain_text("E-EMPTY")
    refused.get_by_role("button", name="Remove").click()
    expect(refused).to_have_count(0)


def test_hostile_text_makes_no_element_and_runs_nothing(
    page: Page, server: RunningServer, tmp_path: Path
) -> None:
    name, subject = "<img src=x onerror=alert(1)>.csv", "</p><script>alert(1)</script>"
    server.send(make_file(tmp_path, "hostile.csv"), subject=subject)
    open_home(page, server)

    page.set_input_files("#files", {"name": name, "mimeType": "text/csv", "buffer": b"hostile"})

    expect(find_row(page, name)).to_be_visible(timeout=END_MS)
    expect(page.locator("#finish")).to_contain_text(name)
    expect(find_row(page, "hostile.csv")).to_contain_text(subject)
    assert page.locator("main img, main script").count() == 0


def test_a_server_that_is_gone_is_told_and_the_list_stays(
    page: Page, server: RunningServer, right: str
) -> None:
    open_home(page, server)
    page.route("**/rows*", lambda route: route.abort())

    expect(page.get_by_text("The server does not respond.")).to_be_visible(timeout=END_MS)

    assert page.locator("#rows .row").count() > 0
