"""Saying what the pose was: the question, the pose held again, the axis without a pose, a slip."""

from itertools import count
from pathlib import Path
from urllib.parse import parse_qs

import numpy as np
import pytest
from playwright.sync_api import Locator, Page, Request, expect

from acromion.fusion.recording import Recording
from tests.factories import hold, record
from tests.fusion.pose.test_poses import ASIDE, RATE_HZ, Course, take_off, tilted
from tests.pages.conftest import finish, keep_picture, repeat
from tests.pages.steps import END_MS, open_analysis, read_bands, wait_for_curve
from tests.ways_in.servers import RunningServer

pytestmark = pytest.mark.browser

HEADER = "timestamp,acc_x_g,acc_y_g,acc_z_g,gyr_x_dps,gyr_y_dps,gyr_z_dps"
WORK = [(30.0, 2.0), (80.0, 2.0)] * 18


def send(server: RunningServer, folder: Path, name: str, made: Recording) -> str:
    """Analyse a recording as a table; gives the id of the analysis."""
    (segment,) = made.segments
    rows = np.column_stack([segment.acc_g, segment.gyr_dps])
    stamps = np.datetime64("2026-03-02T07:00:00.000") + (np.arange(len(rows)) * 1000.0 / RATE_HZ).astype(
        "m8[ms]"
    )
    lines = (
        f"{stamp},{','.join(f'{value:.5f}' for value in row)}"
        for stamp, row in zip(stamps, rows, strict=True)
    )
    (folder / name).write_text("\n".join([HEADER, *lines]), "utf-8")
    return finish(server, folder / name, subject=name.partition(".")[0], side="left")


SEEDS = count()


@pytest.fixture
def unnamed(server: RunningServer, tmp_path: Path) -> str:
    """The id of an analysis of 2 min 32 s: after 72 s of work the arm is held at 60 deg, then hanging.

    Each test has its own recording: an answer makes a new version, and an old one asks nothing.
    """
    made = hold(*WORK, (60.0, 10.0), *WORK[:10], (0.0, 10.0), *WORK[:20], rate_hz=RATE_HZ).recording
    (segment,) = made.segments
    noise = np.random.default_rng(next(SEEDS)).normal(0.0, 1.0, (len(segment), 6))
    noise *= [0.001] * 3 + [0.05] * 3
    acc_g, gyr_dps = segment.acc_g + noise[:, :3], segment.gyr_dps + noise[:, 3:]
    recording = record(acc_g, gyr_dps, RATE_HZ)
    return send(server, tmp_path, "unnamed.csv", recording)


@pytest.fixture(scope="session")
def put_back(server: RunningServer, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The id of an analysis: ten minutes of work, 12 minutes on a desk, the pose again and ten minutes."""
    return send(server, tmp_path_factory.mktemp("put_back"), "putback.csv", take_off(ASIDE, 12.0).record())


@pytest.fixture(scope="session")
def slipped(server: RunningServer, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The id of an analysis: walking, work, and walking with the sensor turned by 25 deg."""
    course = Course().hold(10.0).walk(120.0).move(300.0).walk(120.0, tilted(25.0)).move(60.0)
    return send(server, tmp_path_factory.mktemp("slipped"), "slipped.csv", course.record())


def questions(page: Page) -> Locator:
    return page.locator(".question h2")


def click_answer(page: Page, name: str) -> None:
    """Answer a question, and wait for the next version of the report."""
    page.get_by_role("button", name=name, exact=True).click()
    page.wait_for_url("**before=*")
    expect(page.get_by_role("heading", name="The answer in short")).to_be_visible(timeout=END_MS)


def read_form(request: Request) -> dict[str, list[str]]:
    return parse_qs(request.post_data or "", keep_blank_values=False)


def test_an_assumed_pose_is_asked_about_and_one_click_confirms_it(
    page: Page, server: RunningServer, unnamed: str
) -> None:
    open_analysis(page, server, unnamed)
    question = page.get_by_role("region", name="When was the pose held?")
    expect(question).to_contain_text("Needs the pose: the arm was still several times")
    expect(question.get_by_role("button").first).to_have_text("07:01:12, 9.4\u202fs – yes, this is the pose")
    keep_picture(page, "which-pose")

    click_answer(page, "07:01:12, 9.4\u202fs – yes, this is the pose")

    expect(questions(page)).to_have_count(0)
    expect(page.locator(".verdict").first).to_contain_text(
        "Calibration pose: stated by the user (07:01:12, 9.4\u202fs)"
    )
    changed = page.get_by_role("region", name="Before and now").first
    expect(changed).to_contain_text("not stated")
    expect(page.get_by_role("region", name="Versions of this report")).to_contain_text(
        "the calibration window (07:01:12"
    )


def test_an_answer_waits_until_unsent_changes_are_sent_or_discarded(
    page: Page, server: RunningServer, unnamed: str
) -> None:
    open_analysis(page, server, unnamed)
    wait_for_curve(page)
    address, reason = page.url, page.locator("#reason")
    reason.fill("Diary from the foreman.")

    page.get_by_role("button", name="07:01:42, 9.1\u202fs", exact=True).click()

    note = page.locator("[data-unsent-first]")
    expect(note).to_be_visible()
    assert page.url == address
    note.get_by_role("link").click()
    expect(page.get_by_role("heading", name="Correct the report")).to_be_in_viewport()
    expect(reason).to_have_value("Diary from the foreman.")

    note.get_by_role("button", name="Discard them").click()
    click_answer(page, "07:01:42, 9.1\u202fs")
    expect(page.locator(".verdict").first).to_contain_text(
        "Calibration pose: stated by the user (07:01:42, 9.1\u202fs)"
    )


def test_an_old_version_asks_nothing(page: Page, server: RunningServer, unnamed: str) -> None:
    open_analysis(page, server, unnamed)
    click_answer(page, "07:01:42, 9.1\u202fs")

    open_analysis(page, server, unnamed)

    expect(page.locator("#old")).to_be_visible()
    expect(questions(page)).to_have_count(0)


FIND_COVERED = """() => {
  const labels = [...document.querySelectorAll("#curve .annotation-text-g")];
  const boxes = labels.map((one) => one.getBoundingClientRect());
  const meet = (one, other) => one.left < other.right - 1 && other.left < one.right - 1
    && one.top < other.bottom - 1 && other.top < one.bottom - 1;
  return labels.filter((_, place) => boxes.some((box, other) => other < place && meet(box, boxes[place])))
    .map((one) => one.textContent);
}"""
"""Return the texts of labels on the curve that cover an earlier one."""


def test_candidates_are_drawn_on_the_curve(page: Page, server: RunningServer, unnamed: str) -> None:
    open_analysis(page, server, unnamed)
    wait_for_curve(page)

    labels = page.locator("#curve .annotation-text")
    expect(labels.filter(has_text="07:01:42?")).to_be_visible()
    for width in (1440, 390):
        page.set_viewport_size({"width": width, "height": 900})
        page.wait_for_function("acromionDay.curve.widthPx() < innerWidth - 60")
        assert labels.count() > 1
        assert page.evaluate(FIND_COVERED) == []


def test_a_sensor_put_back_is_asked_about_and_then_the_pose_after_it(
    page: Page, server: RunningServer, put_back: str
) -> None:
    open_analysis(page, server, put_back)
    click_answer(page, "It was held at the start of wear")
    expect(questions(page)).to_have_text(["Was the sensor put back in the same place at 07:22?"])
    keep_picture(page, "put-back")

    click_answer(page, "Moved")

    expect(questions(page)).to_have_text(["When was the pose held after 07:16?"])
    page.locator(".choices button[type=submit]").first.click()
    expect(page.locator(".question")).to_have_count(0, timeout=END_MS)
    expect(page.get_by_role("region", name="Versions of this report")).to_contain_text(
        "the time of a sensor slip (07:16:"
    )


def test_of_an_assumed_pose_the_page_says_that_the_one_after_a_slip_is_next(
    page: Page, server: RunningServer, tmp_path: Path
) -> None:
    moved = send(server, tmp_path, "moved.csv", take_off(tilted(40.0), 12.0).record())
    open_analysis(page, server, moved)

    click_answer(page, "Moved")

    expect(page.get_by_role("region", name="When was the pose held?")).to_contain_text(
        "The page then asks for a pose held after 07:16."
    )


def test_that_the_sensor_did_not_slip_is_kept_in_the_versions(
    page: Page, server: RunningServer, slipped: str
) -> None:
    open_analysis(page, server, slipped)
    expect(questions(page).last).to_contain_text("Did the sensor slip")
    keep_picture(page, "slip")

    click_answer(page, "No slip")

    expect(page.get_by_role("heading", name="Did the sensor slip")).to_have_count(0)
    expect(page.get_by_role("region", name="Versions of this report")).to_contain_text(
        "the absence of a sensor slip (07:"
    )
    expect(page.locator("dl.facts")).to_contain_text("Sensor did not slip at")


def test_the_pose_held_again_is_a_band_of_its_own_that_is_sent_and_undone(day: Page) -> None:
    day.get_by_role("button", name="The pose was also held here", exact=True).first.click()
    assert [band["name"] for band in read_bands(day)] == ["Calibration window", "Calibration window 2"]

    day.get_by_role("button", name="Undo").click()
    assert [band["name"] for band in read_bands(day)] == ["Calibration window"]


def test_without_a_pose_the_page_asks_for_the_axis_and_draws_it(day: Page) -> None:
    day.locator("#pose").select_option("axis")

    axis = day.get_by_role("group", name="Which axis of the sensor lay along the upper arm")
    expect(axis.get_by_role("img")).to_be_visible()
    expect(axis).to_contain_text("GT9X Link: y runs along the case")
    expect(day.locator(".window").first).to_be_hidden()
    keep_picture(day, "axis")


def test_axis_and_slip_reach_the_next_analysis(own_day: Page) -> None:
    own_day.locator("#pose").select_option("axis")
    own_day.get_by_role("radio", name="−y").check(force=True)
    own_day.get_by_label("The sensor slipped at").fill("07:01:30")
    with own_day.expect_request("**/again") as sent:
        own_day.get_by_role("button", name="Update").click()

    form = read_form(sent.value)
    assert (form["pose"], form["axis"], form["slips"]) == (["axis"], ["-y"], ["07:01:30"])
    own_day.wait_for_url("**before=*")
    settings = own_day.locator("dl.facts")
    expect(settings).to_contain_text("none held: the sensor’s −y axis was strapped along the arm")
    expect(settings).to_contain_text("07:01:30")


def test_a_window_that_cannot_be_used_leads_to_the_curve_where_another_is_chosen(
    page: Page, server: RunningServer, right: str
) -> None:
    failed = repeat(server, right, "failed", calibration=["60,70"])
    open_analysis(page, server, failed)

    page.get_by_role("button", name="Analyse, then choose on the curve").click()

    wait_for_curve(page)
    expect(page.get_by_role("heading", name="Correct the report")).to_be_visible()
