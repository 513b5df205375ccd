"""A study on the pages: a folder is one, all at a glance, a list of participants."""

from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from tests.pages.steps import END_MS, make_file, open_home
from tests.ways_in.servers import RunningServer

pytestmark = pytest.mark.browser


@pytest.fixture
def dropped(page: Page, server: RunningServer, tmp_path: Path) -> Page:
    """The page of a study that was begun with a folder of two files, neither of them a recording."""
    folder = tmp_path / "Packing line"
    folder.mkdir()
    for name in ("in_study_1.csv", "in_study_2.csv"):
        make_file(folder, name)
    open_home(page, server)
    page.set_input_files("#folder", folder)
    for name in ("in_study_1.csv", "in_study_2.csv"):
        expect(page.locator("#rows .row", has_text=name).first).to_be_visible(timeout=END_MS)
    page.goto(f"{server.address}batches?lang=en")
    page.get_by_role("link", name="Packing line").first.click()
    expect(page.locator("#participants")).to_be_visible()  # its script listens
    return page


def test_a_folder_is_a_study_all_at_a_glance_with_a_list_of_participants(
    dropped: Page, tmp_path: Path
) -> None:
    squares = dropped.locator(".squares a")
    expect(squares).to_have_count(2)
    expect(squares.get_by_text("in_study_1.csv: No report")).to_have_count(1, timeout=END_MS)
    listed = tmp_path / "participants.csv"
    listed.write_text("file,subject,side\nin_study_1.csv,S91,left\nelsewhere.csv,S92,left\n")

    dropped.set_input_files("#list", listed)

    expect(dropped.locator("#list-told")).to_have_text("Changed: 1. Not in this study: elsewhere.csv.")
    expect(squares.get_by_text("S91: No report")).to_have_count(1, timeout=END_MS)


def test_a_list_that_cannot_be_read_says_which_row(dropped: Page, tmp_path: Path) -> None:
    listed = tmp_path / "participants.csv"
    listed.write_text("file,side\nin_study_1.csv,up\n")

    dropped.set_input_files("#list", listed)

    expect(dropped.locator("#list-told")).to_contain_text("The list of participants cannot be used")
