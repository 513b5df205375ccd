"""The recording's page is page 1 of the report, alive: its figures, its day, moments to look at, tasks."""

import io
import json
import re
from pathlib import Path

import pypdf
import pytest
from playwright.sync_api import Page, expect

from fusion.simulation import write_recordings
from tests.pages.conftest import finish
from tests.pages.steps import open_analysis, read_bands, read_view, wait_for_curve
from tests.pages.test_day import add_period, set_window
from tests.ways_in.servers import RunningServer

pytestmark = pytest.mark.browser


def plain(text: str) -> str:
    return re.sub(r"\s+", " ", text)


@pytest.fixture
def day(page: Page, server: RunningServer, right: str) -> Page:
    """The page of a finished analysis of three minutes, its curve drawn."""
    open_analysis(page, server, right)
    wait_for_curve(page)
    return page


def test_the_page_opens_with_who_when_and_which_arm(shown: Page) -> None:
    opening = plain(shown.locator("main .intro").inner_text())

    assert opening.startswith("S012 Recorded 2 March 2026, 07:00 to 07:03 Arm right")
    assert opening.count("S012") == 1


def test_the_tiles_are_those_of_page_1_of_the_report(shown: Page, server: RunningServer, right: str) -> None:
    pdf = server.client.get(f"/api/v1/analyses/{right}/report.pdf", params={"lang": "en"}).content
    first = plain(pypdf.PdfReader(io.BytesIO(pdf)).pages[0].extract_text())

    values = [plain(value) for value in shown.locator(".tile .value").all_inner_texts()]

    assert len(values) == 4
    assert all(value in first for value in values)
    expect(shown.locator(".tile svg").first).to_be_visible()


def test_quality_comes_behind_the_answer_with_its_details_folded(shown: Page) -> None:
    places = shown.evaluate(
        """() => [".sentences", ".tiles", ".page-one .on-wide", ".page-one .halves", ".page-one .verdict"]
            .map((name) => document.querySelector(name).getBoundingClientRect().top)"""
    )

    assert places == sorted(places)
    expect(shown.locator(".figures")).to_be_hidden()


def test_a_moment_of_the_list_is_shown_on_the_curve(day: Page) -> None:
    day.get_by_text("The highest episodes above 60").click()
    first = day.locator("ol.looks button").first
    start, end = first.get_attribute("data-from"), first.get_attribute("data-to")
    span = day.evaluate("([a, b]) => [a, b].map((at) => acromionDay.clock.read(at))", [start, end])

    first.click()

    assert read_view(day) == pytest.approx(tuple(span))
    assert span[1] - span[0] < 60.0
    expect(day.locator("#curve .annotation-text", has_text=re.compile("^1$"))).to_be_visible()


def test_a_task_that_is_drawn_has_its_bar_at_once(day: Page) -> None:
    expect(day.locator("#tasks-now")).to_be_hidden()

    add_period(day, "task", "shelves")

    row = day.locator("#tasks-now li", has_text="shelves")
    expect(row).to_contain_text(re.compile(r"\d+\.\d\s%"))
    told = row.inner_text()
    day.locator("#periods tr [name=end]").fill("07:00:40")
    day.locator("#periods tr [name=start]").fill("07:00:20")
    day.keyboard.press("Tab")
    expect(row).not_to_have_text(told)
    band = read_bands(day)[-1]
    assert (band["startS"], band["endS"]) == (20.0, 40.0)


def test_a_window_that_cannot_work_is_not_sent(day: Page) -> None:
    again = day.get_by_role("button", name="Analyse again")
    expect(again).to_be_enabled()

    set_window(day, "07:00:03", "07:00:03.5")

    expect(day.locator(".window").first).to_contain_text("cannot be used: it is too short")
    expect(again).to_be_disabled()
    expect(day.get_by_text("A window or a time cannot be used")).to_be_visible()
    set_window(day, "07:00:03", "07:00:09")
    expect(again).to_be_enabled()


def test_stillness_is_told_while_a_window_moves(day: Page) -> None:
    set_window(day, "07:00:02", "07:00:08")
    told = day.locator(".window [data-stillness]").first
    expect(told).to_contain_text("stillness")
    day.locator(".window").first.get_by_role("button", name="Show").click()
    day.locator("#curve-box").scroll_into_view_if_needed()
    box = day.locator("#handle-end").bounding_box() or pytest.fail("not shown")

    day.mouse.move(box["x"] + 12, box["y"] + 50)
    day.mouse.down()
    with day.expect_response("**/stillness?*"):
        day.mouse.move(box["x"] + 60, box["y"] + 50)
    day.mouse.up()


def test_printing_the_page_prints_page_1_of_the_report(day: Page) -> None:
    day.emulate_media(media="print")

    expect(day.locator(".tiles")).to_be_visible()
    expect(day.locator("#correction")).to_be_hidden()
    expect(day.locator("#day")).to_be_hidden()
    expect(day.locator(".print-only")).to_contain_text(re.compile(r"report [0-9a-f]{16}"))


def test_corrections_stand_beside_the_curve_where_there_is_room(
    page: Page, server: RunningServer, right: str
) -> None:
    page.set_viewport_size({"width": 1440, "height": 900})
    open_analysis(page, server, right)
    wait_for_curve(page)

    curve = page.locator("#curve").bounding_box() or pytest.fail("not shown")
    panel = page.locator("#correction").bounding_box() or pytest.fail("not shown")

    assert panel["x"] >= curve["x"] + curve["width"]


def test_two_fingers_zoom_the_curve(day: Page) -> None:
    before = read_view(day)
    day.evaluate(
        """() => {
            const curve = document.getElementById("curve"), left = curve.getBoundingClientRect().left;
            curve.setPointerCapture = () => {}; // of fingers that no screen has seen
            const touch = (name, pointerId, x) => curve.dispatchEvent(new PointerEvent(name,
                { pointerId, clientX: left + x, clientY: 5, buttons: 1, bubbles: true }));
            touch("pointerdown", 11, 300), touch("pointerdown", 12, 400);
            touch("pointermove", 11, 250), touch("pointermove", 12, 450);
            touch("pointerup", 11, 250), touch("pointerup", 12, 450);
        }"""
    )

    after = read_view(day)
    assert after[1] - after[0] == pytest.approx((before[1] - before[0]) / 2, rel=0.01)


def test_from_half_an_hour_on_the_curve_shows_the_minutes_of_the_report(
    page: Page, server: RunningServer, tmp_path: Path
) -> None:
    long = finish(server, write_recordings(tmp_path, "gt9x", 0.6, 71)[0], subject="S071", side="right")
    findings = server.client.get(f"/api/v1/analyses/{long}/report.html", params={"lang": "en"}).text
    table = re.findall(
        r"<tr><th[^>]*>\d\d:\d\d</th><td>(\d+)°</td><td>(\d+)°</td><td>(\d+)°</td></tr>", findings
    )
    open_analysis(page, server, long)
    wait_for_curve(page)

    (run,) = json.loads(page.locator("#day").get_attribute("data-minutes") or "[]")
    drawn = page.evaluate(
        "document.getElementById('curve').data.map(({fill, y}) => [fill || '', y.slice(0, 2)])"
    )
    assert len(run) == 36
    assert drawn == [["toself", [run[0][4]] * 2], ["", [run[0][3]] * 2]]
    assert [tuple(map(int, row)) for row in table] == [tuple(round(v) for v in minute[2:]) for minute in run]

    page.get_by_role("button", name="Zoom in").click()

    page.wait_for_function("document.getElementById('curve').data.length === 1")
