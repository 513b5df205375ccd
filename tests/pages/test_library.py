"""The library: found, filtered, taken away as tables, opened one after the other, deleted for good."""

import csv
import re
import sqlite3
from contextlib import closing
from dataclasses import replace
from datetime import timedelta
from pathlib import Path
from zipfile import ZipFile

import pytest
from playwright.sync_api import Page, expect

from acromion.fusion.simulation import simulate_shift, write_recordings, write_shift
from tests.pages.conftest import finish, keep_picture
from tests.pages.steps import END_MS, find_row, make_file, open_home, see_end
from tests.ways_in.servers import RunningServer

pytestmark = pytest.mark.browser


def search(page: Page, text: str) -> None:
    page.get_by_label("Subject or file").fill(text)
    page.get_by_role("button", name="Search").click()


def test_recordings_are_found_by_subject_and_by_day(
    page: Page, server: RunningServer, right: str, left: str
) -> None:
    open_home(page, server)

    search(page, "s012")
    expect(page.locator("#rows .row").first).to_contain_text("S012")
    page.get_by_label("From", exact=True).fill("2026-03-03")
    page.get_by_role("button", name="Search").click()

    expect(page.get_by_text("Nothing matches")).to_be_visible()
    page.get_by_role("link", name="Show all recordings").click()
    assert page.locator("#rows .row").count() >= 2


def test_data_to_use_with_care_are_not_told_in_green_and_a_short_recording_is_called_short(
    page: Page, server: RunningServer, unstated: str
) -> None:
    open_home(page, server)
    search(page, "unstated.gt3x")
    row = find_row(page, "unstated.gt3x")

    expect(row).to_contain_text("use with care, short")
    expect(row.locator(".side")).to_have_text("arm?")
    expect(row).to_have_class(re.compile("has-caution"))
    row.get_by_role("link", name="S012", exact=True).click()

    expect(page.locator(".sentences")).to_contain_text("under 4\u00a0h, so not compared")
    page.get_by_role("link", name="State the arm").click()
    expect(page.locator("#correct")).to_be_in_viewport()


def test_groups_count_live(page: Page, server: RunningServer, right: str, tmp_path: Path) -> None:
    open_home(page, server)
    search(page, "counted")  # those of this test alone
    expect(page.locator(".chips b").first).to_have_text("0")

    job = server.send(make_file(tmp_path, "counted.csv"))
    see_end(server, job["id"])

    expect(page.locator(".chips a", has_text="No report").locator("b")).to_have_text("1")
    expect(page.locator(".chips b").first).to_have_text("1")


def test_problems_and_figures_are_taken_as_tables(
    page: Page, server: RunningServer, right: str, tmp_path: Path
) -> None:
    job = server.send(make_file(tmp_path, "table.csv"), subject="S099")
    code = see_end(server, job["id"])["problem"]["code"]
    open_home(page, server)
    search(page, "S099")

    with page.expect_download() as download:
        page.get_by_role("link", name="problems and solutions").click()
    (row,) = csv.DictReader(download.value.path().read_text().splitlines())
    page.goto(f"{server.address}?text=S012&lang=en")
    with page.expect_download() as download:
        page.get_by_role("link", name="main figures").click()

    assert (row["file_name"], row["subject"], row["code"]) == ("table.csv", "S099", code)
    assert row["fix"]
    figures = csv.DictReader(download.value.path().read_text().splitlines())
    assert {row["subject"] for row in figures} == {"S012"}


def test_all_reports_are_taken_by_one_click(
    page: Page, server: RunningServer, right: str, left: str, tmp_path: Path
) -> None:
    see_end(server, server.send(make_file(tmp_path, "no_recording.csv"), subject="S012")["id"])
    open_home(page, server)
    search(page, "S012")

    with page.expect_download() as download:
        page.get_by_role("link", name="all reports").click()

    with ZipFile(download.value.path()) as packed:
        reports = [name for name in packed.namelist() if name.endswith(".pdf")]
        assert packed.testzip() is None
        assert packed.read(reports[0]).startswith(b"%PDF-")
        without = packed.read("without-report.txt").decode()
    assert len(reports) == len(set(reports)) >= 2
    assert any(name.startswith("S012_2026-03-02_left_report") for name in reports)
    assert without.startswith("no_recording.csv: ")


def test_once_there_are_recordings_the_place_to_drop_is_a_bar_and_25_rows_fit_below_it(
    page: Page, server: RunningServer, right: str
) -> None:
    page.set_viewport_size({"width": 1440, "height": 900})
    open_home(page, server, "fr")

    bar = page.locator(".zone").bounding_box() or pytest.fail("not shown")
    measure = "rows => Math.min(...rows.map(row => row.getBoundingClientRect().height))"
    row_px = page.locator("#rows .row.is-succeeded").evaluate_all(measure)  # several tags take two lines

    first = page.locator("#rows .row").first.bounding_box()
    keep_picture(page, "list-fr")
    assert bar["height"] <= 90
    assert first is not None
    assert first["y"] + 25 * row_px <= 900


def test_the_list_shows_that_a_pose_is_not_confirmed(
    page: Page, server: RunningServer, tmp_path: Path
) -> None:
    finish(server, write_recordings(tmp_path, "gt9x", 0.05, 22)[0], subject="S022")
    open_home(page, server)

    page.get_by_role("link", name=re.compile("Finish S022.*: pose")).click()

    expect(page.get_by_role("group", name="When was the calibration pose held?")).to_be_in_viewport()


def test_one_is_opened_after_the_other(page: Page, server: RunningServer, right: str, left: str) -> None:
    page.goto(f"{server.address}?text=S012&lang=en")
    page.locator("#rows .name a").first.click()
    first = page.url

    assert "text=S012" in first
    page.get_by_role("link", name="Next").click()
    page.get_by_role("link", name="Previous").click()

    assert page.url.partition("?")[0] == first.partition("?")[0]


def test_a_recording_is_thrown_away_taken_back_and_deleted_for_good(
    page: Page, server: RunningServer, tmp_path: Path
) -> None:
    file = write_recordings(tmp_path, "gt9x", 0.02, 21)[0].rename(tmp_path / "gone.gt3x")
    analysis_id = finish(server, file, subject="S021")
    page.goto(f"{server.address}analyses/{analysis_id}?lang=en")

    page.get_by_role("link", name="Delete this recording").click()
    expect(page.get_by_text("Analyses with all their reports and files: 1")).to_be_visible()
    page.get_by_role("button", name="Move to the trash").click()
    expect(page.get_by_text("after 30 days")).to_be_visible()
    page.get_by_role("button", name="Restore: gone.gt3x").click()
    expect(find_row(page, "gone.gt3x")).to_be_visible()
    page.goto(f"{server.address}analyses/{analysis_id}?lang=en")
    page.get_by_role("link", name="Delete this recording").click()
    page.get_by_role("link", name="Delete for good").click()
    expect(page.get_by_role("heading", name="Delete gone.gt3x for good?")).to_be_visible()
    page.get_by_role("button", name="Delete for good").click()

    expect(page.get_by_role("heading", name="Trash")).to_be_visible()
    assert server.client.get(f"/api/v1/analyses/{analysis_id}").status_code == 404
    assert server.client.get("/api/v1/recordings", params={"subject": "S021"}).json()["items"] == []


def test_a_report_of_an_older_method_is_marked_and_analysed_again_by_one_click(
    page: Page, server: RunningServer, tmp_path: Path
) -> None:
    file = write_recordings(tmp_path, "gt9x", 0.02, 23)[0].rename(tmp_path / "older.gt3x")
    analysis_id = finish(server, file, subject="S023")
    age_report(server, analysis_id)
    page.set_viewport_size({"width": 1440, "height": 900})
    page.goto(f"{server.address}?group=older&lang=en")
    row = page.locator("#rows tbody.row")
    expect(row).to_have_count(1)
    expect(row.locator(".older")).to_have_text("older")

    row.get_by_role("button", name=re.compile("Analyse S023.* again")).click()

    page.goto(f"{server.address}?text=S023&lang=en")
    expect(find_row(page, "S023").locator(".quality")).to_be_visible(timeout=END_MS)
    expect(page.locator(".older")).to_have_count(0, timeout=END_MS)


def age_report(server: RunningServer, analysis_id: str) -> None:
    """Write in the database that a report was made by the method before today's."""
    with closing(sqlite3.connect(server.data / "acromion.sqlite3", timeout=120)) as database, database:
        change = "UPDATE answers SET method_version = method_version - 1 WHERE analysis_id = ?"
        assert database.execute(change, (analysis_id,)).rowcount == 1


def test_both_arms_of_a_shift_are_offered_as_a_pair_with_an_offset(
    page: Page, server: RunningServer, right: str, left: str
) -> None:
    page.goto(f"{server.address}analyses/{right}?lang=en")

    page.get_by_role("link", name="Both arms of this shift, with the left arm").click()
    expect(page.get_by_role("heading", level=1)).to_have_text("Both arms of one shift")
    expect(page.get_by_text("By the clocks of the devices: 0.0 s.")).to_be_visible()
    page.get_by_label("Right after left, in seconds").fill("12,5")
    page.get_by_role("button", name="Apply").click()

    expect(page.get_by_role("link", name="All days of S012")).to_be_visible()
    expect(page.get_by_text("As entered here: 12.5 s.")).to_be_visible()
    expect(page.get_by_role("row", name="Time above 60°")).to_be_visible()
    with page.expect_download() as download:
        page.get_by_role("link", name="PDF").click()
    assert download.value.suggested_filename == "S012_pair.en.pdf"


def test_two_visits_are_compared_and_unlike_settings_are_told(
    page: Page, server: RunningServer, tmp_path: Path
) -> None:
    days = [simulate_shift("gt9x", 0.03, seed) for seed in (31, 32)]
    days[1] = replace(days[1], start=days[0].start + timedelta(days=7))
    made = [write_shift(tmp_path / str(day.seed), day)[0] for day in days]
    first = finish(server, made[0], subject="S031", side="right", method="published")
    second = finish(server, made[1], subject="S031", side="right")

    page.goto(f"{server.address}beside/compare?first={first}&second={second}&lang=en")
    expect(page.get_by_text("made with different settings (method)")).to_be_visible()
    page.get_by_role("button", name="Analyse the earlier recording with the settings").click()

    expect(page.get_by_role("row", name="Method published smoothed")).to_be_visible()


def test_a_batch_of_the_api_has_a_page_with_counts_and_tables(
    page: Page, server: RunningServer, batch: str
) -> None:
    open_home(page, server)
    page.get_by_role("link", name="Studies").click()

    page.get_by_role("link", name="spring").click()

    expect(page.get_by_text("2 recordings · 1 with a report · 1 failed")).to_be_visible()
    expect(page.locator(".whose tbody tr")).to_have_count(2)
    with page.expect_download() as download:
        page.get_by_role("link", name="Problems and solutions").click()
    (row,) = csv.DictReader(download.value.path().read_text("utf-8-sig").splitlines())
    assert row["code"] == "E-COLS"


def test_of_a_batch_only_what_needs_attention_is_shown_and_tried_again(
    page: Page, server: RunningServer, batch: str
) -> None:
    page.goto(f"{server.address}studies/{batch}?lang=en")

    page.get_by_role("link", name="Search, tag and select in the list").click()
    page.get_by_role("link", name="No report 1").click()
    expect(page.locator("#rows .row")).to_have_count(1)
    page.get_by_role("link", name="Back to the study").click()
    page.get_by_role("button", name="Retry all that failed").click()

    expect(page.get_by_text("1 failed")).to_be_hidden()


def test_recordings_are_sorted_as_a_person_chooses(page: Page, server: RunningServer, batch: str) -> None:
    page.goto(f"{server.address}?batch={batch}&lang=en")
    heads = page.locator("#rows thead")

    heads.get_by_role("link", name="Subject").click()
    expect(heads.locator("th.subject")).to_have_attribute("aria-sort", "ascending")
    rising = page.locator("#rows .name").all_inner_texts()
    heads.get_by_role("link", name="Subject").click()
    expect(heads.locator("th.subject")).to_have_attribute("aria-sort", "descending")

    assert rising == ["S012", "unknown.csv"]
    assert page.locator("#rows .name").all_inner_texts() == ["S012", "unknown.csv"]  # without one: last


def test_a_row_is_named_by_subject_date_and_arm_and_draws_the_day(
    page: Page, server: RunningServer, right: str
) -> None:
    page.goto(f"{server.address}?text=S012&lang=en")
    row = page.locator("[data-file='shift_seed1.gt3x']", has_text="S012").first

    expect(row.locator("th")).to_contain_text("S012")
    expect(row.locator(".date")).to_have_text(re.compile(r"^2026-03-02 07:00$"))
    expect(row.locator(".side")).to_have_text("right")
    expect(row.locator(".hours")).to_have_text("3 min")
    expect(row.locator(".above_60")).to_have_text(re.compile(r"^\d+\.\d\s%$"))
    expect(row.get_by_role("img", name="Elevation through the day")).to_be_visible()


def test_a_trunk_sensor_is_set_beside_both_arms_with_an_offset_of_its_own(
    page: Page, server: RunningServer, right: str, left: str, trunk: str
) -> None:
    page.goto(f"{server.address}beside/pair?first={left}&second={right}&lang=en")

    page.get_by_label("Trunk sensor").select_option("trunk.gt3x")  # stated as the trunk's
    page.get_by_role("button", name="Apply").click()
    expect(page.get_by_role("heading", name="Arm relative to the trunk")).to_be_visible()
    expect(
        page.get_by_text(re.compile("trunk recording, relative to the left one. By the clocks"))
    ).to_be_visible()
    page.get_by_label("Trunk after left, in seconds").fill("-2.5")
    page.get_by_role("button", name="Apply").click()

    expect(page.get_by_text("As entered here: −2.5 s.")).to_be_visible()
    expect(page.get_by_role("row", name="Time shared with the trunk")).to_be_visible()
    page.get_by_role("link", name="Read").click()
    expect(page.get_by_text("Arm relative to the trunk").first).to_be_visible()
