"""Times are typed as people write them, in one field on every page, and marked where they cannot be used."""

import re

import pytest
from playwright.sync_api import Locator, Page, expect

from acromion.app.report.words.wording import Language, fill, load_wording
from acromion.fusion.simulation import write_recordings
from tests.pages.conftest import finish, keep_picture
from tests.pages.steps import open_analysis, wait_for_curve
from tests.pages.test_everyone import SCREENS, Look, list_barriers
from tests.ways_in.servers import RunningServer

pytestmark = pytest.mark.browser

ONE_TIME = ("07.01", "0701", "7h01", "07:01")
BOUNDS = {"from": "07:00:00", "to": "07:03:00"}


@pytest.fixture(scope="module")
def unclocked(server: RunningServer, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The id of a recording without a clock."""
    table = write_recordings(tmp_path_factory.mktemp("unclocked"), "lsm9ds1", 0.05, 5, 100.0)[0]
    table.write_text("# times\n" + re.sub("(?m)^# start.*\n", "", table.read_text()))  # no other test's bytes
    return str(server.see(finish(server, table))["recording_id"])


def find_note(page: Page, field: Locator) -> Locator:
    """Return the message that is read with a field."""
    return page.locator(f"#{(field.get_attribute('aria-describedby') or '').split()[0]}")


@pytest.mark.parametrize(("width", "language"), SCREENS)
def test_a_period_is_typed_in_any_spelling_and_marked_where_it_cannot_be(
    page: Page, server: RunningServer, corrected: str, width: int, language: Language
) -> None:
    page.set_viewport_size({"width": width, "height": 900})
    words = load_wording(language, "day")["time_field"]
    open_analysis(page, server, corrected, language)
    wait_for_curve(page)
    row = page.locator("#periods tr").first
    start, end = row.locator("[name=start]"), row.locator("[name=end]")

    for text in ONE_TIME:
        start.fill(text)
        start.press("Tab")
        expect(start).to_have_value("07:01:00")
    end.fill("07.00")
    expect(end).to_have_attribute("aria-invalid", "true")  # while it is typed: reversed
    expect(find_note(page, end)).to_have_text(words["reversed"])
    start.fill("12:34")
    expect(find_note(page, start)).to_have_text(re.compile(re.escape(fill(words["outside"], BOUNDS))[:20]))
    start.fill("1")
    expect(start).to_have_attribute("aria-invalid", "false")  # may still become a time
    start.press("Tab")
    expect(find_note(page, start)).to_have_text(words["unreadable"])
    start.fill("07:00:30")
    end.fill("07:01:15")
    end.press("Tab")
    for field in (start, end, row.locator("[name=label]"), row.locator("[name=kind]")):
        expect(field).not_to_have_attribute("aria-invalid", "true")
        field.scroll_into_view_if_needed()
        box = field.bounding_box() or pytest.fail("not shown")
        assert 0 <= box["x"] <= box["x"] + box["width"] <= width
    slips = page.locator("#slips")
    slips.fill("7h01; 1075")
    expect(find_note(page, slips)).to_have_text(words["unreadable"])
    slips.fill("7h01; 0702")
    slips.press("Tab")
    expect(slips).to_have_value("07:01:00; 07:02:00")
    keep_picture(page, f"times-{width}-{language}")
    assert list_barriers(page, Look(language, "light", width), "#correction") == []


def test_without_a_clock_the_field_says_seconds_and_takes_no_clock_time(
    page: Page, server: RunningServer, unclocked: str
) -> None:
    page.goto(f"{server.address}recordings/{unclocked}/finish?lang=en")
    start = page.locator("#finish").get_by_label("Start (seconds)").last

    start.fill("10:20")
    start.press("Tab")
    expect(find_note(page, start)).to_have_text("Not a number of seconds.")
    start.fill("10.20")
    start.press("Tab")

    expect(start).to_have_value("10.20")
    expect(start).to_have_attribute("aria-invalid", "false")


@pytest.fixture(scope="module")
def over_a_change(server: RunningServer, tmp_path_factory: pytest.TempPathFactory) -> str:
    """An analysis of three minutes in Paris, in which the clocks go from 02:00 to 03:00 after 90 s."""
    table = write_recordings(tmp_path_factory.mktemp("change"), "lsm9ds1", 0.05, 6, 100.0)[0]
    start = "# start: 2026-03-29T01:58:30"
    table.write_text(re.sub("(?m)^# start.*$", start, table.read_text()))
    return finish(server, table, time_zone="Europe/Paris")


def test_the_curve_follows_the_clocks_of_the_stated_zone(
    page: Page, server: RunningServer, over_a_change: str
) -> None:
    open_analysis(page, server, over_a_change)
    wait_for_curve(page)

    shown = page.evaluate("[0, 89, 90, 170].map((second) => acromionDay.clock.format(second))")
    assert shown == ["01:58:30", "01:59:59", "03:00:00", "03:01:20"]
    assert page.evaluate("acromionDay.clock.read('03:00:10')") == 100
    assert page.evaluate("acromionDay.clock.parse('02:30').fault") == "outside"


def test_a_wrong_clock_is_corrected_in_the_form(
    page: Page, server: RunningServer, over_a_change: str
) -> None:
    open_analysis(page, server, over_a_change)
    wait_for_curve(page)
    page.get_by_label("Add to the device’s clock").fill("-1h02m")
    page.get_by_role("button", name="Update").click()

    expect(page.get_by_label("Add to the device’s clock")).to_have_value("-1:02:00", timeout=120_000)
    wait_for_curve(page)
    assert page.evaluate("acromionDay.clock.format(0)") == "00:56:30"
    keep_picture(page, "corrected clock")
    page.goto(page.url.split("?")[0] + "/report.html")
    expect(page.get_by_text("Clock corrected").first).to_be_attached()


def test_an_unknown_zone_is_refused_in_the_form_with_the_nearest(
    page: Page, server: RunningServer, over_a_change: str
) -> None:
    open_analysis(page, server, over_a_change)
    wait_for_curve(page)
    page.get_by_label("Time zone", exact=True).fill("Toronto")
    page.get_by_role("button", name="Update").click()

    expect(page.locator("#refused")).to_contain_text("America/Toronto")
