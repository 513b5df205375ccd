"""Saying what the pose was: the question, the pose held again, the axis without a pose, a slip."""

from urllib.parse import parse_qs

import numpy as np
import pytest
from playwright.sync_api import Page, Request, expect

from tests.factories import hold
from tests.pages.conftest import finish, keep_picture, repeat
from tests.pages.steps import open_analysis, read_bands, wait_for_curve
from tests.ways_in.servers import RunningServer

pytestmark = pytest.mark.browser

WORK = [(30.0, 2.0), (80.0, 2.0)] * 18


@pytest.fixture(scope="session")
def unnamed(server: RunningServer, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The id of an analysis of 2 min 32 s: after 72 s of work the arm is held at 60 deg, then hanging."""
    file = tmp_path_factory.mktemp("unnamed") / "unnamed.csv"
    made = hold(*WORK, (60.0, 10.0), *WORK[:10], (0.0, 10.0), *WORK[:20], rate_hz=50.0)
    (segment,) = made.recording.segments
    noise = np.random.default_rng(0).normal(0.0, 1.0, (len(segment), 6)) * ([0.001] * 3 + [0.05] * 3)
    rows = np.column_stack([segment.acc_g, segment.gyr_dps]) + noise
    seconds = np.arange(len(rows)) / 50.0
    names = "time_s,acc_x_g,acc_y_g,acc_z_g,gyr_x_dps,gyr_y_dps,gyr_z_dps"
    np.savetxt(file, np.column_stack([seconds, rows]), "%.5f", ",", header=names, comments="")
    return finish(server, file, subject="S060", side="left")


@pytest.fixture
def day(page: Page, server: RunningServer, right: str) -> Page:
    """The page of a finished analysis of three minutes, its curve drawn."""
    open_analysis(page, server, right)
    wait_for_curve(page)
    return page


def read_form(request: Request) -> dict[str, list[str]]:
    return parse_qs(request.post_data or "", keep_blank_values=False)


def test_the_page_asks_which_stretch_was_the_pose_and_one_click_answers(
    page: Page, server: RunningServer, unnamed: str
) -> None:
    open_analysis(page, server, unnamed)
    question = page.get_by_role("region", name="Which one was the calibration pose?")
    choices = question.get_by_role("button", name="–").filter(has_not_text="Show")
    expect(choices).to_have_count(2)
    keep_picture(page, "which-pose")

    choices.nth(1).click()
    page.wait_for_url("**before=*")

    expect(page.get_by_role("heading", name="The answer in short")).to_be_visible()
    expect(page.get_by_role("region", name="Which one was the calibration pose?")).to_have_count(0)
    changed = page.get_by_role("region", name="What the correction changed").first
    expect(changed).to_contain_text("found automatically")


def test_the_pose_held_again_is_a_band_of_its_own_that_is_sent_and_undone(day: Page) -> None:
    day.get_by_role("button", name="I held the pose here too", exact=True).first.click()
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


def test_axis_and_slip_reach_the_next_analysis(day: Page) -> None:
    day.locator("#pose").select_option("axis")
    day.get_by_role("radio", name="−y").check(force=True)
    day.get_by_label("The sensor slipped at").fill("07:01:30")
    with day.expect_request("**/again") as sent:
        day.get_by_role("button", name="Analyse again").click()

    form = read_form(sent.value)
    assert (form["pose"], form["axis"], form["slips"]) == (["axis"], ["-y"], ["07:01:30"])
    day.wait_for_url("**before=*")
    settings = day.get_by_role("region", name="Settings and origin")
    expect(settings).to_contain_text("none held: the sensor’s −y axis lay along the arm")
    expect(settings).to_contain_text("07:01:30")


def test_a_window_that_cannot_be_used_leads_to_the_curve_where_another_is_chosen(
    page: Page, server: RunningServer, right: str
) -> None:
    failed = repeat(server, right, "failed", calibration=["60,70"])
    open_analysis(page, server, failed)

    page.get_by_role("button", name="Analyse, then choose on the curve").click()

    wait_for_curve(page)
    expect(page.get_by_role("heading", name="Correct and analyse again")).to_be_visible()
