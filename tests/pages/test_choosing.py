"""Acts on many recordings: chosen by Shift, keyboard and filter; tagged, renamed, taken away, thrown away."""

import csv
from collections.abc import Iterator
from zipfile import ZipFile

import pytest
from playwright.sync_api import BrowserContext, Locator, Page, expect

from tests.pages.conftest import keep_picture, open_page
from tests.pages.steps import END_MS, see_end
from tests.pages.test_everyone import SCREENS, Look, list_barriers, show_as
from tests.ways_in.servers import RunningServer

pytestmark = pytest.mark.browser

NAMES = ("choose_a.csv", "choose_b.csv", "choose_c.csv", "choose_d.csv")


@pytest.fixture(scope="module")
def four(server: RunningServer, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, ...]:
    """The recordings of four files that are no recordings: quick to send, and to analyse again."""
    folder, jobs = tmp_path_factory.mktemp("choose"), []
    for name in NAMES:
        (folder / name).write_text(f"{name} is none\n" * 20)
        jobs.append(server.send(folder / name))
    return tuple(str(see_end(server, job["id"])["recording_id"]) for job in jobs)


@pytest.fixture(scope="module")
def choosing(context: BrowserContext, server: RunningServer, four: tuple[str, ...]) -> Iterator[Page]:
    """The list of the four, by their names; one page for all tests, which begin with nothing chosen."""
    with open_page(context) as opened:
        opened.goto(f"{server.address}?text=choose_&order=name&lang=en")
        yield opened


@pytest.fixture
def listed(choosing: Page) -> Page:
    choosing.keyboard.press("Escape")
    expect(choosing.locator("#acts")).to_be_hidden()
    return choosing


def find_box(page: Page, place: int) -> Locator:
    return page.locator("#rows .row input[type=checkbox]").nth(place)


def list_chosen(page: Page) -> list[str]:
    found: list[str] = page.locator("#rows .row:has(:checked)").evaluate_all(
        "all => all.map(e => e.dataset.file)"
    )
    return found


def test_shift_chooses_all_rows_between(listed: Page) -> None:
    find_box(listed, 0).click()
    find_box(listed, 2).click(modifiers=["Shift"])

    assert list_chosen(listed) == list(NAMES[:3])
    expect(listed.locator(".chosen")).to_have_text("3 selected")


def test_rows_are_chosen_by_the_keyboard_alone(listed: Page) -> None:
    find_box(listed, 1).focus()
    listed.keyboard.press("Space")
    listed.keyboard.press("Shift+ArrowDown")
    listed.keyboard.press("Shift+ArrowDown")

    assert list_chosen(listed) == list(NAMES[1:])
    listed.keyboard.press("Escape")
    assert list_chosen(listed) == []


def test_what_is_chosen_stays_chosen_while_the_list_is_asked_for_again(listed: Page) -> None:
    find_box(listed, 3).click()

    with listed.expect_response("**/rows?*"):
        listed.evaluate("document.dispatchEvent(new Event('visibilitychange'))")
    listed.evaluate("new Promise(requestAnimationFrame)")

    assert list_chosen(listed) == [NAMES[3]]


def test_tags_are_given_to_many_filter_the_list_and_are_taken_away(
    listed: Page, server: RunningServer
) -> None:
    find_box(listed, 0).click()
    find_box(listed, 1).click(modifiers=["Shift"])
    listed.get_by_label("Tag", exact=True).fill("line 2, spring")
    listed.get_by_role("button", name="Add tag").click()
    expect(listed.locator("#acted")).to_contain_text("2 recordings now have the tag line 2, spring.")
    expect(listed.locator("#rows .row").first.locator(".tags")).to_have_text("line 2 spring")

    listed.locator("#rows .row").first.get_by_role("link", name="spring").click()
    expect(listed.locator("#rows .row")).to_have_count(2)
    listed.locator("#pick-all").click()
    listed.get_by_label("Tag", exact=True).fill("spring")
    listed.get_by_role("button", name="Remove tag").click()

    expect(listed.locator("#rows .row")).to_have_count(0)
    listed.goto(f"{server.address}?text=choose_&order=name&lang=en")


def test_the_chosen_are_deleted_and_taken_back(listed: Page) -> None:
    find_box(listed, 0).click()
    find_box(listed, 1).click()
    listed.get_by_role("button", name="Delete").click()
    expect(listed.locator("#rows .row")).to_have_count(2)

    listed.locator("#acted").get_by_role("button", name="Undo").click()

    expect(listed.locator("#acted")).to_contain_text("2 recordings were restored.")
    expect(listed.locator("#rows .row")).to_have_count(4)


def test_the_arm_of_many_is_set_in_one_step(listed: Page) -> None:
    find_box(listed, 2).click()
    find_box(listed, 3).click()
    listed.locator("#acts").get_by_label("Arm").select_option("left")
    listed.get_by_role("button", name="Set arm").click()

    expect(listed.locator("#acted")).to_contain_text("The arm of 2 recordings was changed.")
    sides = listed.locator("#rows .row .side")
    expect(sides).to_have_text(["–", "–", "left", "left"])
    expect(listed.locator("#rows [data-active]")).to_have_count(0, timeout=END_MS)


def test_one_table_and_the_pdfs_of_the_chosen_are_taken(
    page: Page, server: RunningServer, right: str, left: str
) -> None:
    page.goto(f"{server.address}?text=shift_seed&order=name&lang=en")
    for name in ("shift_seed1.gt3x", "shift_seed2.gt3x"):
        page.locator(f"[data-file='{name}'] input[type=checkbox]").first.click()

    with page.expect_download() as download:
        page.get_by_role("button", name="One table").click()
    rows = list(csv.DictReader(download.value.path().read_text("utf-8-sig").splitlines()))
    with page.expect_download() as download:
        page.get_by_role("button", name="PDFs").click()

    assert {row["side"] for row in rows} == {"left", "right"}
    with ZipFile(download.value.path()) as packed:
        assert len(packed.namelist()) == 2


def test_all_that_match_are_chosen_by_one_click(listed: Page) -> None:
    listed.locator("#pick-all").click()
    expect(listed.get_by_role("button", name="Select all")).to_be_hidden()  # the page shows all that match
    listed.evaluate("document.querySelector('#rows .rows').dataset.number = '99'")
    listed.locator("#pick-all").click()
    listed.locator("#pick-all").click()

    listed.get_by_role("button", name="Select all").click()

    expect(listed.locator(".chosen")).to_have_text("All 99 selected")
    listed.evaluate("document.querySelector('#rows .rows').dataset.number = '4'")


def test_a_view_is_saved_under_a_name_opened_by_one_click_and_forgotten(
    page: Page, server: RunningServer, four: tuple[str, ...]
) -> None:
    page.goto(f"{server.address}?text=choose_&order=name&lang=en")
    page.get_by_label("Name of this view").fill("the four")
    page.get_by_role("button", name="Save view").click()
    page.goto(f"{server.address}?lang=en")

    page.get_by_role("link", name="the four").click()

    expect(page.locator("#rows .row")).to_have_count(4)
    expect(page.get_by_role("link", name="the four")).to_have_attribute("aria-current", "true")
    page.get_by_role("button", name="Delete").click()
    expect(page.get_by_role("link", name="the four")).to_have_count(0)


def test_rows_sent_by_a_script_are_named_by_subject_date_and_arm_in_french_on_a_phone(
    page: Page, server: RunningServer, right: str
) -> None:
    page.set_viewport_size({"width": 360, "height": 800})
    page.goto(f"{server.address}?text=S012&lang=fr")
    row = page.locator("[data-file='shift_seed1.gt3x']", has_text="S012").first

    expect(row.locator(".subject")).to_contain_text("S012")
    expect(row.locator(".date")).to_contain_text("2026-03-02")
    expect(row.locator(".side")).to_have_text("droit")
    expect(
        row.get_by_role("checkbox", name="Sélectionner S012, 2026-03-02 7\u202fh\u202f00, droit")
    ).to_be_visible()
    expect(row.get_by_role("link", name="Rapport PDF")).to_be_visible()
    row.get_by_role("checkbox").click()
    page.locator("#acts summary").click()
    expect(page.get_by_role("button", name="PDF (ZIP)")).to_be_in_viewport()
    assert page.evaluate("document.documentElement.scrollWidth") == 360


def test_on_a_phone_the_list_begins_on_the_first_screen_and_the_rest_unfolds(
    page: Page, server: RunningServer, right: str
) -> None:
    page.set_viewport_size({"width": 360, "height": 740})
    page.goto(f"{server.address}?lang=en")

    expect(page.locator("#rows .row").first).to_be_in_viewport()
    expect(page.locator("#study")).to_be_hidden()
    page.locator("summary", has_text="Study").click()
    page.locator("#study").fill("Spring")
    page.set_viewport_size({"width": 1200, "height": 740})
    expect(page.get_by_label("Subject or file")).to_be_visible()
    page.set_viewport_size({"width": 360, "height": 740})

    expect(page.locator("#study")).to_be_visible()  # what is said is never folded away
    expect(page.get_by_label("Subject or file")).to_be_hidden()


@pytest.mark.parametrize(("width", "language"), SCREENS)
def test_every_report_has_its_pdf_in_reach_and_a_phone_has_one_menu_of_actions(
    page: Page, server: RunningServer, right: str, left: str, width: int, language: str
) -> None:
    look = Look(language, "light", width)
    show_as(page, look)
    page.goto(f"{server.address}?text=S012&lang={language}")
    row = page.locator("#rows .row.is-succeeded").first

    box = row.locator("[data-key=pdf]").bounding_box() or pytest.fail("not shown")
    row.get_by_role("checkbox").click()
    menu, action = page.locator("#acts summary"), page.locator("#acts [formaction$='reports.zip']")
    if width == 390:
        expect(action).to_be_hidden()
        menu.click()
    expect(action).to_be_in_viewport()
    expect(menu).to_be_visible(visible=width == 390)
    keep_picture(page, f"library-{width}-{language}")

    assert 0 <= box["x"] <= box["x"] + box["width"] <= width
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert list_barriers(page, look) == []
