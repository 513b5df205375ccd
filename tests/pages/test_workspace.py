"""The recording's page: the answer, one curve to read and to draw on, the draft, and its changes."""

import io
import json
import re
from pathlib import Path

import pypdf
import pytest
from playwright.sync_api import Page, expect

from acromion.fusion.simulation import write_recordings
from tests.pages.conftest import finish, keep_picture
from tests.pages.steps import END_MS, keep_no_drafts, open_analysis, read_bands, read_view, wait_for_curve
from tests.pages.test_day import add_period, set_window
from tests.ways_in.servers import RunningServer

pytestmark = pytest.mark.browser


def plain(text: str) -> str:
    return re.sub(r"\s+", " ", text)


def test_the_page_opens_with_who_when_and_which_arm(shown: Page) -> None:
    opening = plain(shown.locator("main .intro").inner_text())

    assert opening.startswith("S012 Recorded 2 March 2026, 07:00 to 07:03 Arm right")
    assert opening.count("S012") == 1


def test_the_figures_are_those_of_page_1_of_the_report(
    shown: Page, server: RunningServer, right: str
) -> None:
    pdf = server.client.get(f"/api/v1/analyses/{right}/report.pdf", params={"lang": "en"}).content
    first = plain(pypdf.PdfReader(io.BytesIO(pdf)).pages[0].extract_text())

    rows = shown.get_by_role("row", name=re.compile("Time with the arm above|Median velocity"))
    values = [plain(row.locator("td").inner_text()).split()[0] for row in rows.all()]

    assert len(values) == 4
    assert all(value in first for value in values)


def test_sentence_quality_and_pose_come_first_then_one_curve(shown: Page) -> None:
    places = shown.evaluate(
        """() => [".sentences", ".verdict", "#curve", ".figure-table", "#conclusion", "#report"]
            .map((name) => document.querySelector(name).getBoundingClientRect().top)"""
    )

    assert places == sorted(places)
    expect(shown.locator(".verdict")).to_contain_text("Calibration pose: ")
    assert shown.locator("main svg:not(.main-svg):visible").count() == 0
    assert shown.locator(".curve, iframe").count() == 1


def test_without_accounts_a_release_promises_no_name(shown: Page) -> None:
    release = shown.get_by_role("region", name="Release")

    expect(release).to_contain_text("the date, but no name")


def test_files_and_settings_are_folded_away(shown: Page) -> None:
    everything = shown.get_by_role("link", name="Everything (ZIP)")
    expect(everything).to_be_hidden()
    expect(shown.locator("dl.facts")).to_be_hidden()

    shown.get_by_text("Files", exact=True).last.click()

    expect(everything).to_be_visible()


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
    again = day.get_by_role("button", name="Update")
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


def test_printing_the_page_prints_answer_curve_and_figures(day: Page) -> None:
    day.emulate_media(media="print")

    for part in (".sentences", "#curve", ".figure-table"):
        expect(day.locator(part)).to_be_visible()
    for part in (".drawer", ".tools", "#highest"):
        expect(day.locator(part)).to_be_hidden()


NAMES = {
    "en": ("Task", "Break", "Pose", "Draft · 2 changes", "Update"),
    "fr": ("Tâche", "Pause", "Pose", "Brouillon · 2 modifications", "Mettre à jour"),
}


@pytest.mark.parametrize("language", ["en", "fr"])
@pytest.mark.parametrize("width_px", [1440, 1000, 390])
def test_a_task_is_dragged_and_the_pose_marked_on_the_curve_that_one_reads(
    page: Page, server: RunningServer, right: str, width_px: int, language: str
) -> None:
    page.set_viewport_size({"width": width_px, "height": 900})
    keep_no_drafts(page)
    open_analysis(page, server, right, language)
    wait_for_curve(page)
    task, _, pose, draft, update = NAMES[language]
    keep_picture(page, f"workspace-{language}-{width_px}")

    choose_drag(page, task)
    drag_over_curve(page, 0.25, 0.5)
    choose_drag(page, pose)
    page.locator("#curve").press("Enter")

    (window, drawn) = read_bands(page)
    assert (window["kind"], drawn["kind"]) == ("calibration", "task")
    assert (drawn["startS"], drawn["endS"]) == pytest.approx((45, 90), abs=2)
    assert window["endS"] - window["startS"] == pytest.approx(10, abs=0.1)
    expect(page.locator("#tasks-now li")).to_contain_text(re.compile(r"\d+[.,]\d\s%"))
    bar = page.locator(".draft-bar")
    expect(bar).to_contain_text(draft)
    expect(bar.get_by_role("button", name=update)).to_be_in_viewport()
    keep_picture(page, f"workspace-draft-{language}-{width_px}")


def test_a_break_is_dragged_and_undone(day: Page) -> None:
    before = read_bands(day)
    choose_drag(day, "Break")
    drag_over_curve(day, 0.6, 0.4)
    assert [band["kind"] for band in read_bands(day)] == ["calibration", "break"]
    expect(day.locator("#draft")).to_have_text("Draft · 1 change")

    day.get_by_role("button", name="Undo").click()

    assert read_bands(day) == before
    expect(day.locator("#draft")).to_have_text("No changes")


def choose_drag(page: Page, name: str) -> None:
    """Choose what dragging on the curve does."""
    page.locator(".drag").get_by_text(name, exact=True).click()


def drag_over_curve(page: Page, start: float, end: float) -> None:
    """Drag from one part of the drawn time to another, each from 0 to 1."""
    page.locator("#curve").scroll_into_view_if_needed()
    box = page.locator("#curve").bounding_box() or pytest.fail("not shown")
    first, last = (box["x"] + 46 + part * (box["width"] - 58) for part in (start, end))
    page.mouse.move(first, box["y"] + 120)
    page.mouse.down()
    page.mouse.move((first + last) / 2, box["y"] + 120)
    page.mouse.move(last, box["y"] + 120)
    page.mouse.up()


def test_only_moments_that_are_listed_have_a_flag_on_the_curve(day: Page) -> None:
    flags = day.locator("#curve .annotation-text", has_text=re.compile(r"^\d+$"))
    expect(flags).to_have_count(0)
    day.get_by_text("The highest episodes above 60").click()
    expect(flags).to_have_count(day.locator("ol.looks button").count())


def test_what_changed_stands_beside_what_was_with_the_difference(
    page: Page, server: RunningServer, corrected: str
) -> None:
    open_analysis(page, server, corrected)
    table = page.get_by_role("region", name="Before and now").locator("table")

    heads = table.locator("thead th").all_inner_texts()
    assert heads == ["Figure", "Before (version 1)", "Now (version 2)", "Difference"]
    for name, told in (("packing: above 60°", "new"), ("Data quality", "same"), ("Periods", "changed")):
        expect(table.get_by_role("row", name=name).locator("td").last).to_have_text(told)


def test_a_conclusion_becomes_a_released_pdf_in_five_clicks(own_day: Page) -> None:
    own_day.evaluate("window.clicks = sessionStorage.clicks = 0")
    own_day.add_init_script(COUNT_CLICKS)
    own_day.evaluate(COUNT_CLICKS)

    own_day.get_by_label("What you conclude").click()
    own_day.keyboard.type("Overhead work is the load.")
    own_day.keyboard.press("Tab")
    own_day.keyboard.type("M. Tremblay")
    own_day.get_by_role("button", name="Add to the report").click()
    expect(own_day.locator(".meta").first).to_contain_text("version 2", timeout=END_MS)
    own_day.get_by_role("button", name="Release this report").click()
    expect(own_day.get_by_text(re.compile("Released by"))).to_be_visible()
    with own_day.expect_download() as download:
        own_day.get_by_role("link", name="PDF in English").click()

    text = plain("".join(page.extract_text() for page in pypdf.PdfReader(download.value.path()).pages))
    assert "Overhead work is the load." in text
    assert int(own_day.evaluate("sessionStorage.clicks")) <= 5


COUNT_CLICKS = """addEventListener("click", (event) => {
  if (event.isTrusted) sessionStorage.clicks = Number(sessionStorage.clicks) + 1;
}, true)"""


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
