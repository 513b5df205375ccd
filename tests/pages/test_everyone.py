"""For everyone: keyboard, screen reader, both languages, light and dark, 360 px wide, behind a proxy."""

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Page, expect

from acromion.app.report.words.numbers import format_clock, format_duration, format_elapsed, format_moment
from acromion.app.report.words.wording import Language
from tests.pages.conftest import keep_picture
from tests.pages.steps import END_MS, list_other_times, open_home, wait_for_curve, wait_for_end
from tests.ways_in.servers import RunningServer

pytestmark = pytest.mark.browser

RULES = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"]
LOOKS_RULES = [
    "color-contrast",
    "target-size",
    "link-in-text-block",
    "meta-viewport",
    "scrollable-region-focusable",
]
PAGES = {
    "home": "",
    "analysis": "analyses/{right}",
    "corrected": "analyses/{corrected}",
    "report": "analyses/{corrected}/report.html",
    "report of an old version": "analyses/{earlier}/report.html",
    "report of two": "beside/compare/report.html?first={left}&second={right}",
    "help": "help",
    "poses": "help/poses",
    "reading": "help/reading",
    "example": "example",
    "live": "live",
    "api_docs": "api/v1/docs",
    "export": "help/export",
    "problem": "problems/E-EPOCH",
    "trash": "trash",
    "trail": "trail",
    "terms": "retention",
    "groups": "aggregate",
    "delete": "recordings/{recording}/delete",
    "finish": "recordings/{recording}/finish",
    "pair": "beside/pair?first={left}&second={right}",
    "of trunk": "analyses/{trunk}",
    "trunk": "beside/pair?first={left}&second={right}&trunk={trunk}",
    "compare": "beside/compare?first={left}&second={right}",
    "days": "days?analysis={left}&analysis={right}",
    "no days": "days?analysis={left}",
    "columns": "analyses/{unknown}/columns",
    "failed": "analyses/{unknown}",
    "offered": "analyses/{offered}/columns",
    "named": "columns",
    "persons": "persons",
    "person": "person?subject=S012",
    "studies": "studies",
    "study": "studies/{batch}",
    "repeated": "analyses/{repeated}",
    "attempt": "analyses/{right}?attempt={repeated}",
    "absent": "analyses/an_none",
}
SANDBOXED = ("report", "report of an old version", "report of two")
"""Pages in which no script runs, nor that of axe: it looks at them without their policy."""
SHOWN = ("right", "left", "corrected", "unknown", "offered", "repeated", "batch", "trunk")


@dataclass(frozen=True, slots=True)
class Look:
    """A reader's language, theme and screen."""

    language: str
    scheme: Literal["light", "dark"]
    width: int


SCREENS = [(width, language) for width in (1440, 1000, 390) for language in ("en", "fr")]
"""Widths and languages of the walks through the pages."""
LOOKS = [
    pytest.param(Look("en", "light", 1200), id="en-light-desktop"),
    pytest.param(Look("fr", "dark", 1200), id="fr-dark-desktop"),
    pytest.param(Look("fr", "light", 360), id="fr-light-phone"),
    pytest.param(Look("en", "dark", 360), id="en-dark-phone"),
]


@pytest.fixture(scope="session")
def addresses(server: RunningServer, request: pytest.FixtureRequest) -> dict[str, str]:
    """Every page by its name."""
    found = {name: request.getfixturevalue(name) for name in SHOWN}
    found["recording"] = server.see(found["right"])["recording_id"]
    own = {"recording_id": server.see(found["corrected"])["recording_id"]}
    found["earlier"] = server.client.get("/api/v1/analyses", params=own).json()["items"][-1]["id"]
    return {name: server.address + path.format_map(found) for name, path in PAGES.items()}


def show_as(page: Page, look: Look) -> None:
    """Show a page in the theme and on the screen of a look."""
    page.set_viewport_size({"width": look.width, "height": 800})
    page.emulate_media(color_scheme=look.scheme, reduced_motion="reduce")


@pytest.fixture(scope="module")
def sandboxed(browser: Browser) -> Iterator[Page]:
    """A page that runs scripts whatever the policy of its document."""
    opened = browser.new_page(bypass_csp=True)
    yield opened
    opened.close()


@pytest.mark.parametrize("look", LOOKS)
def test_every_page_fits_and_has_no_barrier(
    page: Page, sandboxed: Page, addresses: dict[str, str], look: Look
) -> None:
    show_as(page, look)
    show_as(sandboxed, look)
    found = {}

    for name, address in addresses.items():
        opened = sandboxed if name in SANDBOXED else page
        answer = opened.goto(f"{address}{'&' if '?' in address else '?'}lang={look.language}")
        assert answer is not None
        assert answer.status == (404 if name == "absent" else 200), name
        if name == "analysis":
            wait_for_curve(page)
        keep_picture(opened, f"{name}-{look.language}-{look.scheme}-{look.width}")
        found[name] = list_barriers(opened, look)
        if opened.evaluate("document.documentElement.scrollWidth") > look.width:
            found[name].append("wider than the screen")
        if name not in SANDBOXED:
            found[name] += list_other_times(page, look.language)

    assert {name: problems for name, problems in found.items() if problems} == {}


@pytest.mark.parametrize("language", ["en", "fr-CA"])
def test_the_script_spells_times_as_the_server_does(
    page: Page, server: RunningServer, language: Language
) -> None:
    open_home(page, server, language)
    lengths_s = (0, 4.24, 9.96, 31, 179, 599.6, 4000, 7200, 24480)
    moment = datetime(2026, 11, 26, 7, 5, 9, tzinfo=UTC)

    times = page.evaluate(
        """async (lengths_s) => {
          const style = document.querySelector("link[href$='page.css']").href;
          const times = await import(style.replace("page.css", "times.js"));
          return [...lengths_s.map(times.formatDuration), times.formatMoment("2026-11-26T07:05:09-05:00"),
            times.formatClock(7 * 3600 + 5 * 60 + 9, 0), times.formatElapsed(3725)];
        }""",
        lengths_s,
    )

    assert times == [
        *(format_duration(length_s, language) for length_s in lengths_s),
        format_moment(moment, language),
        format_clock(moment, language, with_seconds=True),
        format_elapsed(3725),
    ]


@pytest.mark.parametrize("key", ["Enter", "Space"])
def test_the_whole_way_is_gone_by_the_keyboard(
    page: Page, server: RunningServer, tmp_path: Path, key: str
) -> None:
    name = f"keys_{key}.csv"
    file = tmp_path / name
    file.write_text(f"by the keyboard alone: {key}\n")
    await_choosers(page)
    open_home(page, server)
    press_until(page, "document.activeElement.dataset.opens === 'files'")
    with page.expect_file_chooser() as chooser:
        page.keyboard.press(key)
    chooser.value.set_files(file)
    wait_for_end(page, name, "failed")

    press_until(page, f"document.activeElement.closest('[data-file=\"{name}\"] .name')")
    page.keyboard.press("Enter")

    expect(page.get_by_role("heading", level=1)).to_have_text(name)


def await_choosers(page: Page) -> None:
    """Have the browser hand over choosers from now on: asked for with the key itself, Enter may be first."""
    page.on("filechooser", lambda _: None)


def list_barriers(page: Page, look: Look, part: str | None = None) -> list[str]:
    """Return what axe finds on the page, or in a part of it: each by its rule and the first element.

    Every rule is asked of one look; of the others what differs: colours where it is dark, sizes on a phone.
    """
    if look.language == "fr":
        return []
    rules = RULES if look.scheme == "light" else LOOKS_RULES
    options = {"runOnly": rules, "resultTypes": ["violations"], "preload": False}
    violations = Axe().run(page, context=part, options=options).response["violations"]
    return [f"{found['id']}: {found['nodes'][0]['html'][:120]}" for found in violations]


def press_until(page: Page, condition: str) -> None:
    for _ in range(60):
        page.keyboard.press("Tab")
        if page.evaluate(condition):
            return
    pytest.fail(condition)


def test_a_day_is_corrected_by_the_keyboard_alone(own_day: Page) -> None:
    page = own_day
    press_until(page, "document.activeElement.id === 'add'")

    page.keyboard.press("Enter")
    page.keyboard.type("tea")
    press_until(page, "document.activeElement.id === 'again'")
    page.keyboard.press("Enter")

    expect(page.get_by_role("heading", name="Before and now")).to_be_visible(timeout=END_MS)


def test_the_skip_link_is_the_first_stop(page: Page, server: RunningServer) -> None:
    open_home(page, server)

    page.keyboard.press("Tab")
    page.keyboard.press("Enter")

    assert page.evaluate("document.activeElement.id") == "content"
