"""People and studies on the pages: walks from a drop to an answer, counted in clicks, on every screen."""

import re
import shutil
import sqlite3
import zipfile
from contextlib import closing
from pathlib import Path

import pytest
from playwright.sync_api import Locator, Page, expect

from acromion.fusion.simulation import write_recordings
from tests.pages.conftest import keep_picture
from tests.pages.steps import END_MS, find_row, list_other_times, note_questions, open_home
from tests.ways_in.servers import RunningServer

pytestmark = pytest.mark.browser

on_every_screen = pytest.mark.parametrize("width", [1440, 1000, 390])
in_both_languages = pytest.mark.parametrize("language", ["en", "fr"])


class Clicks:
    """Clicks that are counted."""

    def __init__(self) -> None:
        self.count = 0

    def on(self, place: Locator) -> None:
        """Click once."""
        self.count += 1
        place.click()


def show(page: Page, address: str, language: str, width: int) -> None:
    page.set_viewport_size({"width": width, "height": 900})
    page.goto(f"{address}{'&' if '?' in address else '?'}lang={language}")


def expect_to_fit(page: Page, language: str, picture: str) -> None:
    """See that nothing is wider than the screen, and that times are spelled as the language does."""
    assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
    assert list_other_times(page, language) == []
    keep_picture(page, picture)


def find_y(place: Locator) -> float:
    box = place.bounding_box()
    assert box is not None
    return box["y"]


# One person.


@on_every_screen
@in_both_languages
def test_the_page_of_a_person_shows_both_arms_one_above_the_other(
    page: Page, server: RunningServer, right: str, left: str, language: str, width: int
) -> None:
    show(page, f"{server.address}person?subject=S012", language, width)

    names = ("Left arm", "Right arm") if language == "en" else ("Bras gauche", "Bras droit")
    upper, lower = (page.locator(".drawn text:visible", has_text=name) for name in names)
    assert find_y(upper) < find_y(lower)
    day = page.locator(".month .is-measured", has_text="2")
    expect(day.locator(f'a[href$="{left}"]')).to_be_visible()
    expect(day.locator(f'a[href$="{right}"]')).to_be_visible()
    assert day.first.evaluate("(cell) => cell.scrollWidth <= cell.clientWidth")
    text_px = page.locator(".drawn text:visible").first.evaluate(
        "(one) => one.getBoundingClientRect().height"
    )
    assert text_px >= 12  # as large as the small words of the page
    expect_to_fit(page, language, f"person-{language}-{width}")


def test_both_arms_of_a_shift_are_two_clicks_away(
    page: Page, server: RunningServer, right: str, left: str
) -> None:
    clicks = Clicks()
    open_home(page, server)

    clicks.on(page.locator(f'#rows a[href*="{right}?"]').first)
    clicks.on(page.get_by_role("link", name="Both arms of this shift, with the left arm"))

    expect(page.get_by_role("heading", level=1)).to_have_text("Both arms of one shift")
    assert clicks.count == 2


def test_a_person_leads_to_both_arms_and_to_all_days(
    page: Page, server: RunningServer, right: str, left: str
) -> None:
    page.goto(f"{server.address}persons?lang=en")

    page.get_by_role("link", name="S012", exact=True).click()
    page.get_by_role("link", name="Both arms on 2026-03-02").click()
    expect(page.get_by_role("heading", level=1)).to_have_text("Both arms of one shift")
    page.go_back()
    page.get_by_role("link", name="All days together").click()

    expect(page.locator(f'input[name=analysis][value="{right}"]')).to_be_checked()
    expect(page.locator(f'input[name=analysis][value="{left}"]')).to_be_checked()


# A study: twelve recordings of six people.

STUDY = "Sorting hall"
ABOVE_60 = {"P01": 4.0, "P02": 9.0, "P03": 2.0, "P04": 21.0, "P05": 13.0, "P06": 6.0}
"""The share of the right arm, in percent; the left arm has half of it."""


@pytest.fixture(scope="module")
def hall(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of twelve recordings; the names of files and folders say whose arm it is."""
    source = write_recordings(tmp_path_factory.mktemp("hall_source"), "gt9x", 0.02, 61)[0]
    folder = tmp_path_factory.mktemp("hall") / STUDY
    for person in ABOVE_60:
        for side in ("left", "right"):
            path = folder / person / f"shift_{side}.gt3x"
            path.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(source, path)
            with zipfile.ZipFile(path, "a") as archive:
                archive.comment = f"{person} {side}".encode()  # otherwise the server knows the bytes
    return folder


def write_whole_days(server: RunningServer) -> None:
    """Write in the database that the recordings of the hall lasted 8 h, and their shares above 60 deg."""
    with closing(sqlite3.connect(server.data / "acromion.sqlite3", timeout=120)) as database, database:
        for person, above in ABOVE_60.items():
            for side, percent in (("right", above), ("left", above / 2)):
                change = """UPDATE answers SET recorded_s = 28800, analysed_s = 28800, above_60_percent = ?,
                    above_60_low_percent = ?, above_60_high_percent = ? WHERE analysis_id IN (
                    SELECT analyses.id FROM analyses JOIN recordings ON recording_id = recordings.id
                    WHERE recordings.subject = ? AND recordings.side = ?)"""
                values = (percent, percent - 1, percent + 1, person, side)
                assert database.execute(change, values).rowcount >= 1


def test_from_twelve_dropped_recordings_to_who_has_most_takes_at_most_four_clicks(
    page: Page, server: RunningServer, hall: Path
) -> None:
    clicks = Clicks()
    open_home(page, server)
    with page.expect_file_chooser() as chooser:
        clicks.on(page.get_by_role("button", name="Choose a folder"))
    chooser.value.set_files(hall)

    expect(page.get_by_role("heading", level=1)).to_have_text(STUDY, timeout=END_MS)
    expect(page.locator("#proposed")).to_contain_text(re.compile(r"12\s+rows were filled in"))
    expect(page.locator(".whose input[value=P04]")).to_have_count(2)
    clicks.on(page.get_by_role("button", name="Save subjects and arms"))
    expect(page.locator("#proposed")).to_have_count(0)
    expect(page.locator(".whose td.told")).to_have_text([re.compile("short")] * 12, timeout=3 * END_MS)
    expect(
        page.get_by_text(re.compile(r"12\s+recordings are shorter than 4.h and not ranked"))
    ).to_be_visible()
    write_whole_days(server)
    page.reload()

    first = page.locator(".ranking tbody tr").first
    expect(first).to_have_text(re.compile(r"P04\s*right\s+21\.0\s%\s+\(20\.0–22\.0\s%\)"))
    assert clicks.count <= 4
    ranked = page.locator(".ranking tbody th").all_inner_texts()
    # 21, 13, 10.5 (left of P04), 9, 6.5, 6, 4.5, 4, 3, 2, 2, 1
    assert ranked[:9] == ["P04", "P05", "P04", "P02", "P05", "P06", "P02", "P01", "P06"]
    look_at_the_study(page)


def look_at_the_study(page: Page) -> None:
    """See the study on every screen in both languages; the walk above has made it, which takes long."""
    address = page.url.partition("?")[0]
    for language in ("en", "fr"):
        for width in (1440, 1000, 390):
            show(page, address, language, width)
            expect(page.locator(".ranking tbody tr")).to_have_count(12)
            dot = page.locator(".ranking circle").first.bounding_box()
            assert dot is not None
            assert 0 < dot["x"] < width
            expect_to_fit(page, language, f"study-{language}-{width}")


def test_codes_that_were_typed_in_a_study_are_not_lost_unasked(
    page: Page, server: RunningServer, batch: str
) -> None:
    asked = note_questions(page)
    page.goto(f"{server.address}studies/{batch}?lang=en")
    page.locator(".whose [name=subject]").first.fill("S77")

    page.get_by_role("link", name="People").click()

    expect(page).to_have_url(re.compile("/persons"))
    assert asked == ["beforeunload"]


def test_files_of_a_study_lead_to_its_page_also_beside_a_file_that_was_refused(
    page: Page, server: RunningServer, tmp_path: Path
) -> None:
    good = write_recordings(tmp_path, "gt9x", 0.02, 64)[0]
    empty = tmp_path / "empty.csv"
    empty.touch()
    open_home(page, server)
    page.get_by_label("Study").first.fill("Loose files")

    page.set_input_files("#files", [good, empty])

    expect(page.get_by_text('The study "Loose files" is ready.')).to_be_visible(timeout=END_MS)
    expect(page.locator("#cards section")).to_have_count(0)
    page.get_by_role("link", name="Open the study").click()
    expect(page.get_by_role("heading", level=1)).to_have_text("Loose files")


def test_a_study_of_short_recordings_says_that_nothing_is_ranked(
    page: Page, server: RunningServer, batch: str
) -> None:
    page.goto(f"{server.address}studies/{batch}?lang=en")

    expect(page.get_by_text("Nothing to rank yet")).to_be_visible()
    expect(page.locator(".ranking")).to_have_count(0)


@on_every_screen
@in_both_languages
def test_the_lists_of_people_and_of_recordings_fit(
    page: Page, server: RunningServer, right: str, batch: str, language: str, width: int
) -> None:
    for name in ("persons", ""):
        show(page, server.address + name, language, width)
        if name:
            expect(page.get_by_role("link", name="S012", exact=True)).to_be_visible()
        # A code of 100 characters is cut in its second line.
        longest = page.locator(".person a, .subject .name a").evaluate_all(
            "all => Math.max(...all.map((one) => ((one.textContent = 'W'.repeat(100)), one.clientHeight)))"
        )
        assert longest <= 60
        if not name:  # a box without words on a wide screen only
            for key in ("open", "pdf"):
                expect(page.locator(f"#rows .is-succeeded [data-key={key}]").first).to_be_visible()
            words = page.locator("label:has(#pick-all) span").bounding_box()
            assert words is not None
            assert (words["width"] > 60) == (width == 390)
        expect_to_fit(page, language, f"{name or 'home'}-{language}-{width}")


def test_the_list_leads_from_a_recording_to_its_study(page: Page, server: RunningServer, batch: str) -> None:
    page.set_viewport_size({"width": 1440, "height": 900})
    open_home(page, server)

    find_row(page, "spring").get_by_role("link", name="spring").click()

    expect(page.get_by_role("heading", level=1)).to_have_text("spring")
