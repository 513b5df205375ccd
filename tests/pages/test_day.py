"""Looking and correcting: the curve, the calibration window, the periods of the day, another analysis."""

import re
from datetime import time
from pathlib import Path
from urllib.parse import parse_qs

import pytest
from playwright.sync_api import Page, expect

from acromion.fusion.simulation import write_recordings
from tests.clock_spellings import FRACTIONS, READ, REFUSED
from tests.pages.conftest import finish, keep_picture
from tests.pages.steps import END_MS, open_analysis, read_bands, read_view, wait_for_curve
from tests.ways_in.servers import RunningServer
from tests.workbooks import write

pytestmark = pytest.mark.browser


SHOWS_SAMPLES = "(({x}) => x.slice(1).some((at, k) => at - x[k] < 0.011))(acromionDay.curve.values)"


def set_window(page: Page, start: str, end: str) -> None:
    fields = page.locator(".window").first.locator("input")
    fields.nth(0).fill(start)
    fields.nth(1).fill(end)
    fields.nth(1).press("Tab")


def add_period(page: Page, kind: str, label: str = "") -> None:
    page.get_by_role("button", name="Add a period").click()
    row = page.locator("#periods tr").last
    row.locator("[name=kind]").select_option(kind)
    row.locator("[name=label]").fill(label)
    page.keyboard.press("Tab")


def test_the_whole_shift_is_seen_first_and_zoomed_to_the_sample(day: Page) -> None:
    whole = read_view(day)

    for _ in range(10):
        day.get_by_role("button", name="Zoom in").click()

    from_s, to_s = read_view(day)
    assert whole[0] == 0.0
    assert whole[1] == pytest.approx(180, abs=1)
    assert to_s - from_s == pytest.approx(whole[1] / 2**10, abs=0.03)
    day.wait_for_function(SHOWS_SAMPLES)
    day.get_by_role("button", name="Whole day").click()
    assert read_view(day) == whole


def test_the_view_is_moved_by_keys_wheel_and_drag(day: Page) -> None:
    day.locator("#curve").focus()
    for key in ("+", "+", "ArrowRight"):
        day.keyboard.press(key)
    from_s, to_s = read_view(day)

    day.locator("#curve").scroll_into_view_if_needed()
    box = day.locator("#curve").bounding_box() or pytest.fail("not shown")
    day.mouse.move(box["x"] + 300, box["y"] + 100)
    day.mouse.wheel(0, -100)
    day.wait_for_function("span => acromionDay.view.spanS < span", arg=to_s - from_s)
    before = read_view(day)
    day.mouse.down()
    day.mouse.move(box["x"] + 200, box["y"] + 100)
    day.mouse.up()

    assert to_s - from_s == pytest.approx(45, abs=0.5)
    assert read_view(day)[0] > before[0]


def test_an_error_of_the_curve_stays_in_its_panel(page: Page, server: RunningServer, right: str) -> None:
    page.route("**/curve?*", lambda route: route.fulfill(status=500, body="broken"))

    open_analysis(page, server, right)

    expect(page.get_by_text("The curve could not be drawn.")).to_be_visible()
    expect(page.get_by_role("heading", name="The answer in short")).to_be_visible()
    expect(page.get_by_role("button", name="Update")).to_be_visible()


def test_a_server_that_does_not_answer_is_said_where_it_matters(day: Page, tmp_path: Path) -> None:
    diary = tmp_path / "diary.csv"
    diary.write_text("kind,label,start,end\n")
    day.route(re.compile("/stillness|/diary|/again"), lambda route: route.abort())

    set_window(day, "07:00:01", "07:00:09")
    expect(day.locator(".window [data-stillness]").first).to_have_text("")
    expect(day.get_by_role("alert")).to_be_hidden()

    day.set_input_files("#import", diary)
    expect(day.get_by_role("alert")).to_contain_text("The server does not respond.")


def test_the_calibration_window_is_a_band_with_its_stillness(day: Page) -> None:
    (band,) = [band for band in read_bands(day) if band["kind"] == "calibration"]

    assert band["name"] == "Calibration window"
    assert 0 <= band["startS"] < band["endS"] <= 30
    told = re.compile(r"stillness 0\.\d\d of 1, still enough")
    expect(day.locator(".window [data-stillness]").first).to_have_text(told)


def test_a_window_that_moved_is_told_to_be_so(day: Page) -> None:
    set_window(day, "07:00:34", "07:00:40")

    expect(day.locator(".window [data-stillness]").first).to_have_text(
        "cannot be used: the arm moved during it"
    )


def test_a_handle_is_moved_by_keys_and_speaks_its_time(day: Page) -> None:
    set_window(day, "07:00:02", "07:00:08")
    day.locator(".window").first.get_by_role("button", name="Show").click()
    handle = day.locator("#handle-start")
    handle.focus()

    day.keyboard.press("ArrowRight")
    told = handle.get_attribute("aria-valuetext")
    other = day.locator("#handle-end")
    other.focus()
    expect(other).to_be_focused()
    day.keyboard.press("Shift+ArrowRight")

    assert told == "07:00:03"
    assert handle.get_attribute("role") == "slider"
    assert handle.get_attribute("aria-label") == "Start of Calibration window"
    expect(other).to_have_attribute("aria-valuetext", "07:01:08")
    assert day.locator(".window input").nth(1).input_value() == "07:01:08"


def test_a_handle_is_dragged(day: Page) -> None:
    add_period(day, "break", "tea")
    day.locator("#curve-box").scroll_into_view_if_needed()
    box = day.locator("#handle-end").bounding_box() or pytest.fail("no handle")
    before = read_bands(day)[-1]

    day.mouse.move(box["x"] + 12, box["y"] + 50)
    day.mouse.down()
    day.mouse.move(box["x"] + 60, box["y"] + 50)
    day.mouse.up()

    after = read_bands(day)[-1]
    assert after["endS"] > before["endS"]
    assert after["startS"] == before["startS"]


def test_a_correction_is_analysed_and_shown_beside_what_was(own_day: Page) -> None:
    set_window(own_day, "07:00:03", "07:00:09")
    add_period(own_day, "break", "coffee")

    own_day.get_by_role("button", name="Update").click()

    heading = own_day.get_by_role("heading", name="Before and now")
    expect(heading).to_be_visible(timeout=END_MS)
    expect(own_day.get_by_role("row", name="Time with the arm above 60°")).to_be_visible(timeout=END_MS)
    moved = "Calibration window not stated 07:00:03 – 07:00:09"
    expect(own_day.get_by_role("row", name=moved)).to_be_visible()
    expect(
        own_day.get_by_role("row", name=re.compile(r"Periods not stated coffee 07:0\d:\d\d"))
    ).to_be_visible()
    wait_for_curve(own_day)
    assert ("break", "coffee") in [(band["kind"], band["name"]) for band in read_bands(own_day)]


def test_a_task_that_is_new_has_its_figure_now_and_none_before(own_day: Page) -> None:
    add_period(own_day, "task", "lifting")

    own_day.get_by_role("button", name="Update").click()

    row = own_day.get_by_role("row", name=re.compile(r"lifting: above 60° – \d+\.\d %"))
    expect(row).to_be_visible(timeout=END_MS)


def test_a_drawn_task_has_the_figure_of_the_report(own_day: Page) -> None:
    add_period(own_day, "task", "stacking")
    own_day.get_by_role("button", name="Update").click()
    changed = own_day.get_by_role("row", name=re.compile(r"stacking: above 60°"))
    expect(changed).to_be_visible(timeout=END_MS)
    reported = changed.locator("td").nth(1).inner_text()

    expect(own_day.locator("#tasks-now li", has_text="stacking")).to_contain_text(f"({reported})")


@pytest.mark.parametrize(("language", "score"), [("en", r"0\.\d\d"), ("fr", r"0,\d\d")])
def test_proposals_are_written_in_the_numbers_of_the_language(
    page: Page, server: RunningServer, right: str, language: str, score: str
) -> None:
    open_analysis(page, server, right, language)
    wait_for_curve(page)

    expect(page.locator(".proposals li").first).to_contain_text(re.compile(score))


def test_what_cannot_be_is_refused_beside_what_was_typed(own_day: Page) -> None:
    add_period(own_day, "break", "tea")
    row = own_day.locator("#periods tr").last
    own_day.locator("#pose").select_option("two-point")  # which needs two windows

    own_day.get_by_role("button", name="Update").click()

    expect(own_day.locator("#refused")).to_contain_text("E-PARAMETER")
    expect(own_day.locator("#refused").get_by_role("link", name="Back to all recordings")).to_have_count(0)
    expect(row.locator("[name=label]")).to_have_value("tea")


def test_of_a_window_whose_one_end_is_typed_the_other_stays_as_shown(own_day: Page) -> None:
    start, end = own_day.locator(".window").first.locator("input").all()
    shown = end.get_attribute("placeholder") or pytest.fail("no window was found")

    start.fill("07:00:01")
    with own_day.expect_request("**/again") as sent:
        own_day.get_by_role("button", name="Update").click()

    windows = parse_qs(sent.value.post_data or "")
    assert (windows["window_start"], windows["window_end"]) == (["07:00:01"], [shown])


def test_a_time_is_shown_as_it_was_read(day: Page) -> None:
    add_period(day, "break", "tea")
    row = day.locator("#periods tr").last
    row.locator("[name=start]").fill("7h01")
    row.locator("[name=end]").fill("07.01.30")
    row.locator("[name=end]").press("Tab")

    expect(row.locator("[name=start]")).to_have_value("07:01:00")
    expect(row.locator("[name=end]")).to_have_value("07:01:30")
    band = read_bands(day)[-1]
    assert (round(band["startS"]), round(band["endS"])) == (60, 90)


def test_a_number_that_is_no_clock_time_is_marked_and_not_sent(day: Page) -> None:
    add_period(day, "break", "tea")
    field = day.locator("#periods tr").last.locator("[name=start]")

    field.fill("1075")
    field.press("Tab")

    expect(field).to_have_attribute("aria-invalid", "true")
    expect(field).to_have_value("1075")
    expect(day.get_by_role("button", name="Update")).to_be_disabled()


def test_times_at_which_the_sensor_slipped_are_shown_as_they_were_read(day: Page) -> None:
    field = day.get_by_label("The sensor slipped at")

    field.fill("7h01; 0702; later")
    field.press("Tab")

    expect(field).to_have_value("07:01:00; 07:02:00; later")


READ_CLOCK = """texts => {
    const clock = new acromionDay.clock.constructor("2026-03-02T00:00:00", 86399.98, "");
    return texts.map((text) => clock.read(text)).map((second) => Number.isNaN(second) ? null : second);
}"""


def test_the_page_reads_clock_times_as_a_diary_does(day: Page) -> None:
    times = {text: time.fromisoformat(told) for text, told in READ.items()}
    expected_s = {
        text: 3600 * t.hour + 60 * t.minute + t.second + t.microsecond / 1e6 for text, t in times.items()
    }
    refused = [*REFUSED, *FRACTIONS]

    assert dict(zip(READ, day.evaluate(READ_CLOCK, list(READ)), strict=True)) == expected_s
    assert [
        text for text, second in zip(refused, day.evaluate(READ_CLOCK, refused), strict=True) if second
    ] == []


def test_a_recording_without_a_clock_asks_for_seconds(
    page: Page, server: RunningServer, tmp_path: Path
) -> None:
    table = write_recordings(tmp_path, "lsm9ds1", 0.05, 5, 100.0)[0]
    table.write_text(re.sub("(?m)^# start.*\n", "", table.read_text()))
    open_analysis(page, server, finish(server, table))
    wait_for_curve(page)
    add_period(page, "break", "tea")
    row = page.locator("#periods tr").last

    row.get_by_label("Start (seconds)").fill("60")
    row.get_by_label("End (seconds)").fill("1h30")
    row.get_by_label("End (seconds)").press("Tab")

    expect(row.get_by_label("Start (seconds)")).to_have_value("60")
    expect(row.get_by_label("End (seconds)")).to_have_attribute("aria-invalid", "true")


def test_every_change_is_undone(day: Page) -> None:
    before = read_bands(day)
    add_period(day, "task", "shelves")
    set_window(day, "07:00:02", "07:00:08")

    while day.get_by_role("button", name="Undo").is_enabled():
        day.get_by_role("button", name="Undo").click()

    assert read_bands(day) == before
    expect(day.locator("#status")).to_have_text("Undone.")


def test_a_diary_in_excel_is_imported_and_a_row_that_becomes_a_mark_has_no_end(
    day: Page, tmp_path: Path
) -> None:
    diary = tmp_path / "diary.xlsx"
    diary.write_bytes(
        write(
            ("start", "end", "kind", "label"),
            (time(7, 0, 30), time(7, 1), "break", "café"),
            (time(7, 1, 30), None, "mark", "pain"),
        )
    )

    day.set_input_files("#import", diary)
    rows = day.locator("#periods tr")
    expect(rows).to_have_count(2)
    flag = day.locator("#curve .annotation-text")
    expect(flag.get_by_text("pain", exact=True)).to_have_count(1)
    rows.first.locator("[name=kind]").select_option("mark")
    expect(flag.get_by_text("café", exact=True)).to_have_count(1)
    keep_picture(day, "marks")

    expect(rows.last.locator("[name=label]")).to_have_value("pain")
    expect(rows.first.locator("[name=end]")).to_have_value("")
    expect(rows.first.locator("[name=end]")).not_to_be_visible()
    expect(day.get_by_role("button", name="Update")).to_be_enabled()


def test_postures_of_a_sensor_are_imported_beside_the_other_rows_and_shown_on_request(
    day: Page, tmp_path: Path
) -> None:
    diary, posture = tmp_path / "diary.csv", tmp_path / "thigh.csv"
    diary.write_text("start,end,kind,label\n07:00:30,07:01:00,task,shelves\n")
    start = day.locator("[data-start]").get_attribute("data-start") or ""
    posture.write_text(f"datetime,activity\n{start[:10]} 07:00:40,sit\n{start[:10]} 07:00:50,walk\n")

    day.set_input_files("#import", diary)
    expect(day.locator("#periods tr")).to_have_count(1)
    day.set_input_files("#import", posture)
    expect(day.locator("#periods tr")).to_have_count(3)

    assert [band["name"] for band in read_bands(day) if band["kind"] != "calibration"] == ["shelves"]
    measured = day.locator("#periods tr").last
    expect(measured).not_to_be_visible()
    day.get_by_label("Show the rows with the posture from a sensor").check()
    expect(measured).to_be_visible()
    expect(measured.locator("[name=label]")).to_have_value("upright")
    keep_picture(day, "postures")


def test_a_diary_is_imported_and_exported(day: Page, tmp_path: Path) -> None:
    diary = tmp_path / "diary.csv"
    diary.write_text("start;end;kind;label\n07:00:30;07:01:00;pause;café\n07:01:00;07:02:00;task;shelves\n")

    day.set_input_files("#import", diary)
    expect(day.locator("#periods tr")).to_have_count(2)
    with day.expect_download() as download:
        day.get_by_role("button", name="Export as CSV").click()

    text = download.value.path().read_text("utf-8-sig")
    assert text.splitlines() == [
        "start;end;kind;label",
        "07:00:30;07:01:00;break;café",
        "07:01:00;07:02:00;task;shelves",
    ]


def test_a_proposal_is_applied_only_when_it_is_accepted(day: Page) -> None:
    fields = day.locator(".window").first.locator("input")
    assert fields.nth(0).input_value() == ""

    day.get_by_role("button", name=re.compile("Use as calibration")).last.click()

    assert re.match(r"07:0\d:\d\d", fields.nth(0).input_value())
    assert day.get_by_role("button", name="Undo").is_enabled()


def test_a_hole_in_the_file_is_told_and_not_drawn(page: Page, server: RunningServer, tmp_path: Path) -> None:
    table = write_recordings(tmp_path, "lsm9ds1", 0.05, 5, 100.0)[0]
    lines = table.read_text().splitlines(keepends=True)
    holed = tmp_path / "holed.csv"
    holed.write_text("".join(lines[:9000] + lines[11_000:]))
    analysis_id = finish(server, holed)

    open_analysis(page, server, analysis_id)
    wait_for_curve(page)

    assert page.evaluate("acromionDay.curve.values.y.slice(0, -1).includes(null)")
    expect(page.locator(".verdict")).not_to_have_class(re.compile("is-good"))
    expect(page.locator(".head")).to_contain_text("2 min 40 s of 3 min recorded")
