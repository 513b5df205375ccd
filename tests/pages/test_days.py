"""Several days on the page: from a recording to the days of its person, choosing among them."""

import re
from dataclasses import replace
from datetime import datetime

import pytest
from playwright.sync_api import Page, expect

from acromion.fusion.simulation import simulate_shift, write_shift
from tests.pages.conftest import finish
from tests.pages.steps import find_row, open_home
from tests.ways_in.servers import RunningServer

pytestmark = pytest.mark.browser


def open_days(page: Page, server: RunningServer, left: str, right: str) -> None:
    page.goto(f"{server.address}days?analysis={left}&analysis={right}")


def test_a_day_is_taken_away_and_the_form_stays_for_another_choice(
    page: Page, server: RunningServer, right: str, left: str
) -> None:
    open_days(page, server, left, right)
    chosen = page.locator("input[name=analysis]:checked")
    expect(chosen).to_have_count(2)

    chosen.first.uncheck()
    page.get_by_role("button", name="Apply").click()

    expect(page.get_by_role("alert")).to_contain_text("a profile needs at least two recordings")
    expect(page.locator("input[name=analysis]:checked")).to_have_count(1)


COUNTS_H = 4.2
"""Days under 4 h do not count."""


@pytest.fixture(scope="module")
def visits(server: RunningServer, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    """The analyses of two visits of S077, in March and in November, of one study."""
    folder, made = tmp_path_factory.mktemp("visits"), []
    for name, seed, month in (("march", 7, 3), ("today", 8, 11)):
        shift = replace(
            simulate_shift("gt9x", COUNTS_H, seed),
            start=datetime(2026, month, 24, 7, 0, 0),  # noqa: DTZ001 - the device's own clock
        )
        file = write_shift(folder / name, shift, actilife_csv=False)[0].rename(folder / f"{name}.gt3x")
        made.append(
            finish(server, file, subject="S077", side="right", study="WorkerContext moved", pose_held="start")
        )
    return made[0], made[1]


def test_whether_today_is_better_than_march_is_told_in_three_clicks(
    page: Page, server: RunningServer, visits: tuple[str, str]
) -> None:
    open_home(page, server)
    page.get_by_label("Subject or file").fill("S077")
    page.keyboard.press("Enter")

    find_row(page, "2026-11-24").get_by_role("link", name="S077", exact=True).click()
    page.get_by_role("link", name="Compare with: march.gt3x").click()

    expect(page.locator(".sentences p").first).to_contain_text(
        re.compile("Time above 60° changed from .* to")
    )
    expect(page.locator(".sentences p").first).to_contain_text("usual day-to-day variation")


def test_two_visits_are_named_by_their_dates(
    page: Page, server: RunningServer, visits: tuple[str, str]
) -> None:
    page.goto(f"{server.address}beside/compare?first={visits[0]}&second={visits[1]}&lang=en")

    expect(page.locator(".curve-name").first).to_have_text("Before · 2026-03-24 07:00")
    expect(page.locator(".curve-name").last).to_have_text("After · 2026-11-24 07:00")


@pytest.mark.parametrize("address", ["beside/compare?first={0}&second={1}", "days?analysis={0}&analysis={1}"])
def test_a_report_of_several_leads_back(
    page: Page, server: RunningServer, visits: tuple[str, str], address: str
) -> None:
    place = server.address + address.format(*visits)
    page.goto(place)

    page.get_by_role("link", name=re.compile("^Read")).click()
    page.get_by_role("link", name="Back to the page").click()

    expect(page).to_have_url(place)
