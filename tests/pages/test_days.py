"""Several days on the page: from a recording to the days of its person, choosing among them."""

import re
from dataclasses import replace
from datetime import datetime

import pytest
from playwright.sync_api import Page, expect

from fusion.simulation import simulate_shift, write_shift
from tests.pages.conftest import finish
from tests.pages.steps import find_row, open_analysis, open_home
from tests.ways_in.servers import RunningServer

pytestmark = pytest.mark.browser


def open_days(page: Page, server: RunningServer, left: str, right: str) -> None:
    page.goto(f"{server.address}days?analysis={left}&analysis={right}")


def test_a_recording_leads_to_the_days_of_its_person(
    page: Page, server: RunningServer, right: str, left: str
) -> None:
    open_analysis(page, server, right)

    page.get_by_role("link", name="Several days of S012 together").click()

    expect(page.get_by_role("heading", level=1)).to_have_text("Arm Elevation Profile of several days")


def test_a_day_is_taken_away_and_the_form_stays_for_another_choice(
    page: Page, server: RunningServer, right: str, left: str
) -> None:
    open_days(page, server, left, right)
    chosen = page.locator("input[name=analysis]:checked")
    expect(chosen).to_have_count(2)

    chosen.first.uncheck()
    page.get_by_role("button", name="Apply").click()

    expect(page.get_by_role("alert")).to_contain_text("a profile takes two recordings or more")
    expect(page.locator("input[name=analysis]:checked")).to_have_count(1)


def test_a_day_is_set_after_a_change(page: Page, server: RunningServer, right: str, left: str) -> None:
    open_days(page, server, left, right)

    page.locator(f"input[name=after][value={right}]").check()
    page.get_by_role("button", name="Apply").click()

    expect(page.locator(".sentences")).to_contain_text("Nobody has days that count both before and after")
    expect(page.locator(f"input[name=after][value={right}]")).to_be_checked()


def test_the_pdf_is_one_click_away(page: Page, server: RunningServer, right: str, left: str) -> None:
    open_days(page, server, left, right)

    with page.expect_download() as download:
        page.get_by_role("link", name="PDF").click()

    assert re.fullmatch(r"S012_profile\.en\.pdf", download.value.suggested_filename)


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
            finish(server, file, subject="S077", side="right", study="Bench moved", pose_held="start")
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

    expect(page.locator(".sentences p").first).to_contain_text(re.compile("Time above 60° went from .* to"))
    expect(page.locator(".sentences p").first).to_contain_text("usual day-to-day variation")


def test_two_visits_are_named_by_their_dates(
    page: Page, server: RunningServer, visits: tuple[str, str]
) -> None:
    page.goto(f"{server.address}beside/compare?first={visits[0]}&second={visits[1]}&lang=en")

    expect(page.locator(".curve-name").first).to_have_text("Before · 2026-03-24 07:00")
    expect(page.locator(".curve-name").last).to_have_text("After · 2026-11-24 07:00")


@pytest.mark.parametrize(("language", "mark"), [("en", "."), ("fr", ",")])
def test_the_table_of_two_visits_has_units(
    page: Page, server: RunningServer, visits: tuple[str, str], language: str, mark: str
) -> None:
    page.goto(f"{server.address}beside/compare?first={visits[0]}&second={visits[1]}&lang={language}")
    points = re.compile(rf"\d{re.escape(mark)}\d\spoints?$")

    cells = page.locator("tr", has_text=re.compile("(Time|Temps).*60°")).first.locator("td")
    expect(cells.nth(0)).to_have_text(re.compile(rf"\d{re.escape(mark)}\d\s%$"))
    expect(cells.nth(2)).to_have_text(points)
    expect(cells.nth(3)).to_have_text(points)
    angles = page.locator("tr", has_text=re.compile("Median elevation|Élévation médiane")).locator("td")
    expect(angles.nth(0)).to_have_text(re.compile(r"\d°$"))


def test_a_persons_visits_stand_against_the_minimal_detectable_change(
    page: Page, server: RunningServer, visits: tuple[str, str]
) -> None:
    page.goto(f"{server.address}days?analysis={visits[0]}&analysis={visits[1]}&lang=en")

    expect(page.locator(".sentences")).to_contain_text("From 24 March 2026")
    expect(page.locator(".sentences")).to_contain_text("the usual variation between two single days")
    drawn = page.locator("section", has=page.get_by_role("heading", name="Day after day: time above 60°"))
    expect(drawn).to_contain_text("the minimal detectable change between two single days")


def test_a_study_is_compared_before_and_after_a_day(
    page: Page, server: RunningServer, visits: tuple[str, str]
) -> None:
    page.goto(f"{server.address}batches?lang=en")
    page.get_by_role("link", name="Bench moved").click()

    page.get_by_label("First day after a change").fill("2026-06-01")
    page.get_by_role("button", name="All together").click()

    expect(page.locator(".sentences")).to_contain_text(
        re.compile(r"mean time above 60° went from .*\(1\sday\)")
    )


def test_the_other_language_keeps_every_day(
    page: Page, server: RunningServer, visits: tuple[str, str]
) -> None:
    page.goto(f"{server.address}days?analysis={visits[0]}&analysis={visits[1]}&lang=en")

    page.get_by_role("banner").get_by_role("link", name="Français").click()

    expect(page.locator("input[name=analysis]:checked")).to_have_count(2)


@pytest.mark.parametrize("address", ["beside/compare?first={0}&second={1}", "days?analysis={0}&analysis={1}"])
def test_a_report_of_several_leads_back(
    page: Page, server: RunningServer, visits: tuple[str, str], address: str
) -> None:
    place = server.address + address.format(*visits)
    page.goto(place)

    page.get_by_role("link", name=re.compile("^Read")).click()
    page.get_by_role("link", name="Back to the page").click()

    expect(page).to_have_url(place)
