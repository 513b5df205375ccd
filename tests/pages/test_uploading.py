"""Getting data in: chosen, dropped, broken off and gone on with, known already, understood at once."""

import re
from pathlib import Path

import pytest
from playwright.sync_api import Page, Route, expect

from acromion.fusion.simulation import write_recordings
from tests.pages.steps import END_MS, find_row, find_upload, make_file, open_home, wait_for_end
from tests.ways_in.servers import RunningServer

pytestmark = pytest.mark.browser

DROPPED_FILE = """name => {
  const transfer = new DataTransfer();
  transfer.items.add(new File(["dropped"], name));
  return transfer;
}"""
LEARN_PATCHES = """
window.patches = [];
const set = XMLHttpRequest.prototype.setRequestHeader;
XMLHttpRequest.prototype.setRequestHeader = function (name, value) {
  if (name === "Upload-Offset") window.patches.push(Number(value));
  return set.call(this, name, value);
};"""


def test_many_files_on_their_way_take_a_line_each_and_leave_the_list_in_sight(
    page: Page, server: RunningServer, tmp_path: Path, right: str
) -> None:
    page.set_viewport_size({"width": 1440, "height": 900})
    page.route("**/api/v1/uploads**", lambda route: route.abort())
    for number in range(60):
        make_file(tmp_path, f"line_{number}.csv")
    open_home(page, server)

    page.set_input_files("#folder", tmp_path)

    rows = page.locator("#uploads .row")
    expect(rows).to_have_count(60)
    assert rows.last.evaluate("row => row.offsetHeight") < 60
    assert page.locator("#rows table").evaluate("table => table.getBoundingClientRect().top") < 600


def test_the_files_of_a_folder_go_by_their_names(page: Page, server: RunningServer, tmp_path: Path) -> None:
    page.route("**/api/v1/uploads**", lambda route: route.abort())
    for number in (10, 9, 1, 2):
        make_file(tmp_path, f"P{number}.csv")
    open_home(page, server)

    page.set_input_files("#folder", tmp_path)

    expect(page.locator("#uploads .name")).to_have_text(["P1.csv", "P2.csv", "P9.csv", "P10.csv"])


def test_dropped_files_are_taken(page: Page, server: RunningServer) -> None:
    open_home(page, server)
    dropped = page.evaluate_handle(DROPPED_FILE, "dropped.csv")

    page.dispatch_event(".zone", "drop", {"dataTransfer": dropped})

    expect(find_row(page, "dropped.csv")).to_be_visible(timeout=END_MS)


def test_of_a_folder_only_recordings_are_taken(page: Page, server: RunningServer, tmp_path: Path) -> None:
    make_file(tmp_path, "in_folder.csv")
    make_file(tmp_path, "notes.docx")
    open_home(page, server)

    page.set_input_files("#folder", tmp_path)

    expect(page.locator(".whose th", has_text="in_folder.csv")).to_be_visible(timeout=END_MS)
    expect(page.get_by_text("notes.docx")).to_have_count(0)


def test_a_lost_network_costs_one_piece_and_no_more(
    page: Page, server: RunningServer, tmp_path: Path
) -> None:
    page.add_init_script(LEARN_PATCHES)
    open_home(page, server)
    lost: list[Route] = []

    def lose_twice(route: Route) -> None:
        if (
            route.request.method == "PATCH"
            and route.request.headers["upload-offset"] != "0"
            and len(lost) < 2
        ):
            lost.append(route)
            route.abort()
        else:
            route.continue_()

    page.route("**/api/v1/uploads/*", lose_twice)
    page.set_input_files("#files", make_file(tmp_path, "network.csv", 3))

    expect(find_row(page, "network.csv")).to_be_visible(timeout=END_MS)
    assert page.evaluate("patches") == [0, 1 << 20, 1 << 20, 1 << 20]


def test_after_a_reload_the_same_file_goes_on_where_it_stopped(
    page: Page, server: RunningServer, tmp_path: Path
) -> None:
    page.add_init_script(LEARN_PATCHES)
    file = make_file(tmp_path, "reload.csv", 3)
    open_home(page, server)
    page.on("dialog", lambda dialog: dialog.accept())
    page.route("**/api/v1/uploads/*", stop_second)
    page.set_input_files("#files", file)
    page.wait_for_function("() => patches.length > 1")

    page.reload()
    expect(page.locator("#interrupted")).to_contain_text("reload.csv")
    page.unroute("**/api/v1/uploads/*")
    page.set_input_files("#files", file)

    expect(find_row(page, "reload.csv")).to_be_visible(timeout=END_MS)
    assert page.evaluate("patches")[0] == 1 << 20
    expect(page.locator("#interrupted")).to_be_hidden()


def stop_second(route: Route) -> None:
    """Let the first piece through and no other."""
    route.abort() if is_later_piece(route) else route.continue_()


def is_later_piece(route: Route) -> bool:
    return route.request.method == "PATCH" and route.request.headers["upload-offset"] != "0"


def test_a_proxy_that_refuses_large_pieces_gets_smaller_ones(
    page: Page, server: RunningServer, tmp_path: Path
) -> None:
    open_home(page, server)

    def refuse_large(route: Route) -> None:
        size = len(route.request.post_data_buffer or b"")
        too_large = route.request.method == "PATCH" and size > 600_000
        route.fulfill(status=413, body="too large") if too_large else route.continue_()

    page.route("**/api/v1/uploads/*", refuse_large)
    page.set_input_files("#files", make_file(tmp_path, "proxy.csv", 2))

    expect(find_upload(page, "proxy.csv").locator(".row-note")).to_contain_text("524 kB")
    expect(find_row(page, "proxy.csv")).to_be_visible(timeout=END_MS)


def test_all_that_failed_are_tried_again_by_one_click(
    page: Page, server: RunningServer, tmp_path: Path
) -> None:
    problem = '{"title": "Full", "detail": "Full.", "fix": "Wait.", "code": "E-DISK", "retryable": true}'
    open_home(page, server)
    page.route(
        "**/api/v1/uploads",
        lambda route: route.fulfill(status=507, body=problem, content_type="application/problem+json"),
    )
    page.set_input_files("#files", [make_file(tmp_path, f"again_{number}.csv") for number in range(3)])
    expect(page.locator("#uploads .row", has_text="E-DISK")).to_have_count(3)

    page.unroute("**/api/v1/uploads")
    page.get_by_role("button", name="Retry all that failed").click()

    for number in range(3):
        expect(find_row(page, f"again_{number}.csv")).to_be_visible(timeout=END_MS)


def test_the_first_bytes_say_what_the_file_is(
    page: Page, server: RunningServer, shifts: tuple[Path, Path], tmp_path: Path
) -> None:
    file = tmp_path / "told.gt3x"
    file.write_bytes(write_recordings(tmp_path / "made", "gt9x", 0.2, 9)[0].read_bytes())
    open_home(page, server)
    page.route("**/api/v1/uploads/*", stop_second)

    page.set_input_files("#files", file)

    told = find_upload(page, "told.gt3x").locator(".understood")
    expect(told).to_have_text("ActiGraph GT9X Link · 100 Hz · 2026-03-02 07:00")
    find_upload(page, "told.gt3x").get_by_role("button", name="Cancel").click()


def test_the_wrong_kind_of_file_is_named_while_it_is_on_its_way(
    page: Page, server: RunningServer, tmp_path: Path
) -> None:
    open_home(page, server)
    page.route("**/api/v1/uploads/*", stop_second)

    page.set_input_files("#files", make_file(tmp_path, "letter.csv", 3))

    expect(find_upload(page, "letter.csv").locator(".row-note")).to_contain_text("Not a sensor recording")


def test_two_bars_and_a_stage_show_how_far_it_is(page: Page, server: RunningServer, tmp_path: Path) -> None:
    file = write_recordings(tmp_path, "gt9x", 0.1, 11)[0].rename(tmp_path / "bars.gt3x")
    open_home(page, server)

    page.set_input_files("#files", file)

    expect(page).to_have_title(re.compile(r"\(\d+/\d+\) Acromion"))
    expect(find_upload(page, "bars.gt3x").locator("progress")).to_have_count(2)
    wait_for_end(page, "bars.gt3x")
    expect(page).to_have_title("Acromion")


def test_each_file_counts_once_in_the_title(page: Page, server: RunningServer, tmp_path: Path) -> None:
    open_home(page, server)
    expect(page.locator("#rows [data-active]")).to_have_count(0, timeout=END_MS)
    page.evaluate("""window.titles = []; new MutationObserver(() => titles.push(document.title))
        .observe(document.querySelector("title"), { childList: true })""")

    page.set_input_files("#files", [make_file(tmp_path, f"title_{k}.csv") for k in range(3)])
    for k in range(3):
        wait_for_end(page, f"title_{k}.csv", "failed")
    expect(page).to_have_title("Acromion")

    titles = page.evaluate("titles")
    assert titles[0] == "(0/3) Acromion"
    assert all("/3)" in title for title in titles[:-1])


def test_the_page_of_an_analysis_follows_it_without_events(
    page: Page, server: RunningServer, tmp_path: Path
) -> None:
    page.add_init_script("delete window.EventSource")
    file = write_recordings(tmp_path, "gt9x", 0.03, 13)[0].rename(tmp_path / "polled.gt3x")
    job = server.send(file)

    page.goto(f"{server.address}analyses/{job['id']}?lang=en")

    expect(page.get_by_role("heading", name="The answer in short")).to_be_visible(timeout=END_MS)


def test_events_tell_the_page_of_an_analysis_what_has_changed(
    page: Page, server: RunningServer, tmp_path: Path
) -> None:
    file = write_recordings(tmp_path, "gt9x", 0.03, 14)[0].rename(tmp_path / "events.gt3x")
    job = server.send(file)

    with page.expect_request("**/events"):
        page.goto(f"{server.address}analyses/{job['id']}?lang=en")

    expect(page.get_by_role("heading", name="The answer in short")).to_be_visible(timeout=END_MS)


def test_a_sample_shift_is_one_click_away(page: Page, server: RunningServer) -> None:
    page.goto(f"{server.address}help?lang=en")

    page.get_by_role("button", name="Analyse a sample shift").click()

    expect(page.get_by_role("heading", name="The answer in short")).to_be_visible(timeout=END_MS)


def test_of_many_files_the_first_that_is_sent_is_in_sight(
    page: Page, server: RunningServer, tmp_path: Path
) -> None:
    page.set_viewport_size({"width": 1440, "height": 900})
    page.route("**/api/v1/uploads**", lambda route: None)  # never answered, so that all rows stay
    open_home(page, server)

    page.set_input_files("#files", [make_file(tmp_path, f"many{number:02}.csv") for number in range(12)])

    expect(find_upload(page, "many00.csv")).to_be_in_viewport()
