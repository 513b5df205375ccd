"""A new label is on its row at once: links stay, no row moves, and the report follows without an analysis."""

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Page, expect

from acromion.fusion.simulation import write_recordings
from tests.pages.conftest import finish, keep_picture
from tests.pages.steps import END_MS
from tests.ways_in.servers import RunningServer

pytestmark = pytest.mark.browser

SCREENS = [(width, language) for width in (1440, 1000, 390) for language in ("en", "fr")]


@pytest.fixture(scope="module")
def labelled(server: RunningServer, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    """The reports of two recordings, the older one first."""
    folder = tmp_path_factory.mktemp("labels")
    older, newer = (
        finish(
            server,
            write_recordings(folder / str(seed), "gt9x", 0.02, seed)[0].rename(folder / name),
            side="right",
        )
        for name, seed in (("label_a.gt3x", 81), ("label_b.gt3x", 82))
    )
    return older, newer


@pytest.fixture(params=SCREENS, ids=lambda screen: f"{screen[0]}-{screen[1]}")
def listed(
    request: pytest.FixtureRequest, browser: Browser, server: RunningServer, labelled: tuple[str, str]
) -> Iterator[Page]:
    """The list of both recordings on one screen, in one language."""
    width, language = request.param
    context = browser.new_context(viewport={"width": width, "height": 900})
    page = context.new_page()
    page.goto(f"{server.address}?text=label_&lang={language}")
    yield page
    context.close()


def choose(page: Page, name: str, field: str, value: str) -> None:
    """Set a field of one row of the list."""
    page.locator(f"#rows .row[data-file='{name}'] input[name=recording]").check()
    if (menu := page.locator("#acts summary")).is_visible():  # on a phone
        menu.click()
    page.locator(f"#acts [name={field}]").fill(value)
    page.locator(f"#acts [formaction$='/acts/{field}']").click()


def test_a_new_subject_leaves_the_rows_and_their_links_in_place(listed: Page) -> None:
    width = listed.viewport_size["width"] if listed.viewport_size else 0
    subject = f"L{width}{listed.locator('html').get_attribute('lang')}"
    rows = listed.locator("#rows .row")
    before = [rows.nth(k).get_attribute("data-file") for k in range(2)]
    assert before == ["label_b.gt3x", "label_a.gt3x"]

    choose(listed, "label_a.gt3x", "subject", subject)

    row = listed.locator("#rows .row[data-file='label_a.gt3x']")
    expect(row.locator(".name").first).to_contain_text(subject)
    expect(row.locator("[data-key=open]")).to_have_count(1)
    expect(row.locator("progress")).to_have_count(0)
    expect(row).not_to_have_attribute("data-active", "", timeout=END_MS)
    assert [rows.nth(k).get_attribute("data-file") for k in range(2)] == before
    keep_picture(listed, f"label-{subject}")
    listed.goto(str(row.locator("[data-key=open]").evaluate("link => link.href")))
    expect(listed.locator("body")).to_contain_text(subject)
