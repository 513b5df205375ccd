"""A study on the pages: a dropped folder leads there, and a list of participants names subjects and arms."""

from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from tests.pages.steps import END_MS, open_home
from tests.pages.test_everyone import Look, list_barriers
from tests.ways_in.servers import RunningServer

pytestmark = pytest.mark.browser


@pytest.fixture
def dropped(page: Page, server: RunningServer, tmp_path: Path) -> Page:
    """The page of a study that was begun with a folder of two files, neither of them a recording."""
    folder = tmp_path / "Packing line"
    folder.mkdir()
    for name in ("in_study_1.csv", "in_study_2.csv"):
        (folder / name).write_text(f"{name} of {tmp_path.name} is not a recording\n")
    open_home(page, server)
    page.set_input_files("#folder", folder)
    expect(page.get_by_role("heading", level=1)).to_have_text("Packing line", timeout=END_MS)
    expect(page.locator("#participants")).to_be_visible()  # its script listens
    return page


def test_a_folder_leads_to_its_study_with_a_list_of_participants(dropped: Page, tmp_path: Path) -> None:
    row = dropped.get_by_role("row", name="in_study_1.csv")
    expect(dropped.locator(".whose tbody tr")).to_have_count(2)
    expect(row.get_by_role("link", name="No report")).to_be_visible(timeout=END_MS)
    mark = row.locator("td.told").evaluate("(cell) => getComputedStyle(cell, '::before').content")
    assert mark == '"! "'  # not the dot of good data
    listed = tmp_path / "participants.csv"
    listed.write_text("file,subject,side\nin_study_1.csv,S91,left\nelsewhere.csv,S92,left\n")

    dropped.set_input_files("#list", listed)
    preview = dropped.locator("#list-told")
    expect(preview).to_contain_text("1 row fits no recording of this study: elsewhere.csv.")
    expect(preview).to_contain_text("in_study_2.csv")
    assert list_barriers(dropped, Look("en", "light", 1280), "#participants") == []
    expect(row.get_by_role("textbox")).to_have_value("")
    dropped.get_by_role("button", name="Do not apply it").click()
    expect(preview).to_be_hidden()
    dropped.set_input_files("#list", listed)
    dropped.get_by_role("button", name="Apply the list").click()

    expect(dropped.locator("#list-told")).to_have_text("The list was applied.")
    expect(row.get_by_role("textbox")).to_have_value("S91")
    expect(row.get_by_role("combobox")).to_have_value("left")


def test_a_list_that_cannot_be_read_says_which_row(dropped: Page, tmp_path: Path) -> None:
    listed = tmp_path / "participants.csv"
    listed.write_text("file,side\nin_study_1.csv,up\n")

    dropped.set_input_files("#list", listed)

    expect(dropped.locator("#list-told")).to_contain_text("The list of participants cannot be used")
