"""Uploads that are broken off: cancelled, left, gone on with; nothing comes back, nothing is sent twice."""

import hashlib
import re
from pathlib import Path

import pytest
from playwright.sync_api import Page, Request, Route, expect

from acromion.fusion.simulation import write_recordings
from tests.pages.steps import END_MS, find_row, find_upload, make_file, open_home, see_end
from tests.ways_in.servers import RunningServer

pytestmark = pytest.mark.browser

UPLOADS, ANALYSES = "**/api/v1/uploads/*", "**/api/v1/analyses"
RECORDINGS = "**/api/v1/recordings/*"


def lose_pieces(route: Route) -> None:
    route.abort() if route.request.method == "PATCH" else route.continue_()


def lose_later_pieces(route: Route) -> None:
    is_later = route.request.method == "PATCH" and route.request.headers["upload-offset"] != "0"
    route.abort() if is_later else route.continue_()


def lose(route: Route) -> None:
    route.abort()


def lose_wishes(route: Route) -> None:
    route.abort() if route.request.method == "POST" else route.continue_()


def list_sent(page: Page) -> list[str]:
    """Have the methods of all requests about uploads told from now on."""
    sent: list[str] = []

    def note(request: Request) -> None:
        if "/uploads" in request.url and not request.url.endswith("/inspection"):
            sent.append(request.method)

    page.on("request", note)
    return sent


def test_a_cancelled_upload_does_not_come_back_with_the_network(
    page: Page, server: RunningServer, tmp_path: Path
) -> None:
    open_home(page, server)
    page.route(UPLOADS, lose_pieces)
    page.set_input_files("#files", make_file(tmp_path, "ghost.csv"))
    row = find_upload(page, "ghost.csv")
    expect(row.locator(".pill")).to_have_text("Waiting for the network")

    with page.expect_request(lambda request: request.method == "DELETE"):
        row.get_by_role("button", name="Cancel").click()
    page.unroute(UPLOADS)
    page.wait_for_timeout(2500)  # longer than the pause before the next try

    expect(page.locator(".row", has_text="ghost.csv")).to_have_count(0)


def slow_down(page: Page, bytes_per_s: float) -> None:
    """Let the network take no more than so many bytes a second."""
    network = page.context.new_cdp_session(page)
    slow = {"offline": False, "latency": 0, "downloadThroughput": -1, "uploadThroughput": bytes_per_s}
    network.send("Network.enable")
    network.send("Network.emulateNetworkConditions", slow)


def test_over_a_slow_network_a_table_goes_packed_and_arrives_as_it_was(
    page: Page, server: RunningServer, tmp_path: Path
) -> None:
    file = make_file(tmp_path, "slow.csv", 4)
    packed: list[int] = []
    open_home(page, server)
    slow_down(page, 2e6)
    page.on("request", lambda request: note_packed(request, packed))

    page.set_input_files("#files", file)
    expect(find_row(page, "slow.csv")).to_be_visible(timeout=END_MS)

    stored = server.client.get("/api/v1/recordings").json()["items"][0]
    assert stored["sha256"] == hashlib.sha256(file.read_bytes()).hexdigest()
    assert len(packed) == 1
    assert packed[0] < 3_000_000 / 4


PACKS = """async ([offset, speed]) => {
  const script = document.querySelector('script[src$="/home.js"]').src;
  const { TusUpload } = await import(script.replace("home.js", "upload/tus.js"));
  const upload = new TusUpload(new File(["x"], "day.csv"), {}, "", "", {});
  return Object.assign(upload, { offset, speed: { plain: speed } }).shouldPack();
}"""
FIRST, SECOND = 1 << 20, 9 << 20


@pytest.mark.parametrize(
    ("sent", "bytes_per_s", "packs"),
    [(FIRST, 2e6, True), (FIRST, 8e6, False), (SECOND, 8e6, True), (FIRST, 20e6, False)],
)
def test_a_network_that_may_only_have_been_busy_is_tried_by_a_larger_piece_before_packing(
    page: Page, server: RunningServer, sent: int, bytes_per_s: float, packs: bool
) -> None:
    open_home(page, server)

    assert page.evaluate(PACKS, [sent, bytes_per_s]) is packs


def note_packed(request: Request, sizes: list[int]) -> None:
    if request.headers.get("content-encoding") == "gzip":
        sizes.append(len(request.post_data_buffer or b""))


def test_what_has_come_of_a_cancelled_upload_is_dropped_even_while_a_piece_is_taken(
    page: Page, server: RunningServer, tmp_path: Path
) -> None:
    open_home(page, server)
    slow_down(page, 2e6)
    with page.expect_request(lambda request: request.headers.get("upload-offset", "0") != "0") as piece:
        page.set_input_files("#files", make_file(tmp_path, "half.dat", 8))
    page.wait_for_timeout(300)

    with page.expect_response(lambda a: a.request.method == "DELETE" and a.status == 204, timeout=END_MS):
        find_upload(page, "half.dat").get_by_role("button", name="Cancel").click()

    headers = {"Tus-Resumable": "1.0.0"}
    assert server.client.head(piece.value.url, headers=headers).status_code == 404


def test_a_network_that_is_lost_behind_the_last_byte_loses_nothing_and_heals(
    page: Page, server: RunningServer, tmp_path: Path
) -> None:
    open_home(page, server)
    page.route(RECORDINGS, lose)
    sent = list_sent(page)
    page.set_input_files("#files", make_file(tmp_path, "healed.csv"))
    expect(find_upload(page, "healed.csv").locator(".pill")).to_have_text("Waiting for the network")
    assert "PATCH" in sent
    sent.clear()

    page.unroute(RECORDINGS)

    expect(find_row(page, "healed.csv")).to_be_visible()
    assert set(sent) <= {"GET"}  # it asks what became of the upload, and sends no byte again


def test_a_page_that_is_closed_behind_the_last_byte_finds_its_analysis_and_asks_nothing(
    page: Page, server: RunningServer, tmp_path: Path
) -> None:
    page.on("dialog", lambda dialog: dialog.accept())
    open_home(page, server)
    page.route(RECORDINGS, lose)
    page.set_input_files("#files", make_file(tmp_path, "closed_early.csv"))
    expect(find_upload(page, "closed_early.csv").locator(".pill")).to_have_text("Waiting for the network")

    page.reload()

    expect(find_row(page, "closed_early.csv")).to_be_visible()
    expect(page.locator("#interrupted")).to_be_hidden()


def test_a_refused_file_that_is_sent_again_is_analysed_again(
    page: Page, server: RunningServer, tmp_path: Path
) -> None:
    file = make_file(tmp_path, "refused.csv")
    see_end(server, server.send(file)["id"])
    open_home(page, server)

    page.set_input_files("#files", file)

    expect(find_upload(page, "refused.csv")).to_have_count(0)
    assert len(server.client.get("/api/v1/analyses?limit=2").json()["items"]) == 2


def test_the_study_of_a_file_outlasts_a_reload(page: Page, server: RunningServer, tmp_path: Path) -> None:
    file = make_file(tmp_path, "outlasts.csv", 2)
    page.on("dialog", lambda dialog: dialog.accept())
    open_home(page, server)
    page.fill("#study", "Kept")
    page.route(UPLOADS, lose_later_pieces)
    page.set_input_files("#files", file)
    expect(find_upload(page, "outlasts.csv").locator(".pill")).to_have_text("Waiting for the network")

    page.reload()
    page.unroute(UPLOADS)
    page.set_input_files("#files", file)
    expect(find_row(page, "outlasts.csv")).to_be_visible(timeout=END_MS)

    page.goto(f"{server.address}studies?lang=en")
    page.get_by_role("link", name="Kept").click()
    expect(page.get_by_role("row", name="outlasts.csv")).to_be_visible()


def test_uploads_that_were_cut_are_given_up_by_a_click(
    page: Page, server: RunningServer, tmp_path: Path
) -> None:
    page.on("dialog", lambda dialog: dialog.accept())
    open_home(page, server)
    page.route(UPLOADS, lose_later_pieces)
    page.set_input_files("#files", make_file(tmp_path, "given_up.csv", 2))
    expect(find_upload(page, "given_up.csv").locator(".pill")).to_have_text("Waiting for the network")
    page.reload()
    page.unroute(UPLOADS)

    with page.expect_response(lambda answer: answer.request.method == "DELETE") as deleted:
        page.get_by_role("button", name="Discard them").click()

    assert deleted.value.status == 204
    expect(page.locator("#interrupted")).to_be_hidden()


def test_a_known_file_is_analysed_again_at_the_second_try(
    page: Page, server: RunningServer, tmp_path: Path
) -> None:
    file = write_recordings(tmp_path, "gt9x", 0.05, 8)[0].rename(tmp_path / "known.gt3x")
    see_end(server, server.send(file)["id"])
    open_home(page, server)
    page.set_input_files("#files", file)
    row = find_upload(page, "known.gt3x")
    again = row.get_by_role("button", name="Analyse again")
    page.route(ANALYSES, lose_wishes)
    expect(row.get_by_role("link", name="Open the analysis")).to_have_attribute("href", re.compile("/an_"))

    again.click()
    expect(row.locator(".row-note")).to_contain_text("The connection was lost")
    page.unroute(ANALYSES)
    again.click()

    expect(row).to_have_count(0)
    expect(find_row(page, "known.gt3x")).to_be_visible()
