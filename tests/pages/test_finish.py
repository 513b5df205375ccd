"""Finishing a recording after its upload: person, arm, pose and breaks are asked on one card."""

import re
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from itertools import count
from pathlib import Path

import pytest
from playwright.sync_api import Locator, Page, expect
from sqlalchemy import update

from acromion.app.library.database.tables import analyses
from acromion.app.library.jobs import JobStore
from acromion.app.report.words.numbers import format_duration
from acromion.app.report.words.wording import Language, fill, load_wording
from acromion.app.settings import Settings
from acromion.fusion.simulation import write_recordings
from tests.fusion.pose.test_poses import ASIDE, Course, tilted
from tests.pages.conftest import keep_picture
from tests.pages.steps import END_MS, find_row, make_file, open_home, see_end, wait_for_end
from tests.pages.test_everyone import SCREENS, Look, list_barriers
from tests.pages.test_pose import send
from tests.simulated_week import write_week
from tests.ways_in.servers import RunningServer

pytestmark = pytest.mark.browser

SEEDS = count(700)
MOST_ACTS = 12


class Hand:
    """A person at the page: every click, drop and key counts, but not the typed text."""

    def __init__(self, page: Page) -> None:
        self.page, self.acts = page, 0

    def drop(self, *files: Path) -> None:
        self.acts += 1
        self.page.set_input_files("#files", files)

    def click(self, place: Locator) -> None:
        self.acts += 1
        place.click()

    def type(self, text: str) -> None:
        self.page.keyboard.type(text)

    def press(self, key: str) -> None:
        self.acts += 1
        self.page.keyboard.press(key)


def make_shift(folder: Path, name: str) -> Path:
    """Write a recording of three minutes from 07:00 whose pose nobody has stated."""
    return write_recordings(folder, "gt9x", 0.05, next(SEEDS))[0].rename(folder / name)


def wait_for_questions(page: Page) -> Locator:
    card = page.locator("#finish")
    expect(card.locator("[name=start]")).to_be_visible(timeout=END_MS)
    return card


@pytest.mark.parametrize(("width", "language"), SCREENS)
def test_a_dropped_recording_is_finished_with_person_arm_pose_and_lunch_in_twelve_acts(
    page: Page, server: RunningServer, tmp_path: Path, width: int, language: Language
) -> None:
    page.set_viewport_size({"width": width, "height": 900})
    words, times = load_wording(language, "page"), load_wording(language, "day")["time_field"]
    number = next(SEEDS)
    file = make_shift(tmp_path, f"P{number}_right.gt3x")
    open_home(page, server, language)
    hand = Hand(page)

    hand.drop(file)
    card = page.locator("#finish")
    expect(card).to_be_in_viewport(timeout=END_MS)
    card = wait_for_questions(page)
    subject, right = card.locator("[name=subject]"), card.locator("[name=side][value=right]")
    expect(subject).to_have_value("")  # a proposal is shown, and not used before it is accepted
    expect(right).not_to_be_checked()
    expect(card.locator(".stretch:visible").first).to_be_visible()
    keep_picture(page, f"finish-asked-{width}-{language}")
    barriers = list_barriers(page, Look(language, "light", width), "#finish")

    proposed = words["finish"]["from_name"]
    hand.click(card.get_by_role("button", name=fill(proposed, {"value": f"P{number}"})))
    hand.click(card.get_by_role("button", name=fill(proposed, {"value": words["drop"]["side_right"]})))
    hand.click(card.locator("[name=choice]").first)
    expect(card.locator(".stretch.is-chosen:visible")).to_have_count(1)
    hand.click(card.locator("[name=label]"))
    hand.type("lunch")
    hand.press("Tab")
    hand.type("7h02")
    hand.press("Tab")
    expect(card.locator("[name=start]")).to_have_value("07:02:00")
    hand.type("07.01")
    expect(card.locator("[name=end]")).to_have_attribute("aria-invalid", "true")
    expect(card.get_by_text(times["reversed"])).to_be_visible()
    expect(card.get_by_role("button", name=words["finish"]["save"])).to_be_disabled()
    keep_picture(page, f"finish-marked-{width}-{language}")
    card.locator("[name=end]").fill("")
    expect(
        card.get_by_role("button", name=words["finish"]["save"])
    ).to_be_disabled()  # a break without its end
    subject.focus()
    expect(card.get_by_text(words["finish"]["break_incomplete"])).to_be_visible()
    card.locator("[name=end]").focus()
    hand.type("07.02.30")
    hand.press("Tab")
    expect(card.locator("[name=end]")).to_have_value("07:02:30")
    expect(card.locator("[name=end]")).to_have_attribute("aria-invalid", "false")
    hand.click(card.get_by_role("button", name=words["finish"]["save"]))

    expect(page).to_have_url(re.compile("/analyses/"))
    expect(page.get_by_role("heading", name=words["analysis"]["answer"])).to_be_visible(timeout=END_MS)
    expect(page.get_by_role("heading", level=1)).to_have_text(f"P{number}")
    settings = server.see(re.findall(r"an_[0-9a-f]{16}", page.url)[0])["settings"]
    assert (settings["subject"], settings["side"]) == (f"P{number}", "right")
    assert len(settings["calibration_windows_s"]) == 1
    lunch = [(row["kind"], row["label"], row["start"], row["end"]) for row in settings["periods"]]
    assert lunch == [("break", "lunch", "07:02:00", "07:02:30")]
    assert hand.acts <= MOST_ACTS
    assert barriers == []


@pytest.mark.parametrize("answer", [("lunch", "07:01:00", ""), ("lunch", "", "07:02:00"), ("lunch", "", "")])
def test_a_break_without_start_or_end_is_refused(
    server: RunningServer, right: str, answer: tuple[str, str, str]
) -> None:
    place = f"/recordings/{server.see(right)['recording_id']}/finish"
    form = {"analysis": right, "subject": "S012", "side": "right", "kind": "break"}

    told = server.client.post(place, data=form | dict(zip(("label", "start", "end"), answer, strict=True)))

    assert told.status_code == 422
    assert "E-PARAMETER" in told.text


def test_what_was_skipped_stays_assumed_and_is_marked_in_the_list(
    page: Page, server: RunningServer, tmp_path: Path
) -> None:
    file = make_shift(tmp_path, "skipped.gt3x")
    open_home(page, server)
    page.set_input_files("#files", file)

    page.locator("#finish [name=subject]").fill("S9")
    page.once("dialog", lambda dialog: dialog.dismiss())
    page.locator("#finish").get_by_role("link", name="Not now").click()
    expect(page.locator("#finish [name=subject]")).to_have_value("S9")  # nothing typed is lost unasked
    page.once("dialog", lambda dialog: dialog.accept())
    page.locator("#finish").get_by_role("link", name="Not now").click()

    expect(page.locator("#finish")).to_have_count(0)
    row = wait_for_end(page, "skipped.gt3x")
    marks = row.locator(".open-question")
    expect(marks).to_have_text(["who?", "arm?", "pose?"])
    assert (
        marks.evaluate_all("all => Math.min(...all.map((one) => one.clientHeight))") >= 24
    )  # a finger's size
    marks.last.click()
    card = wait_for_questions(page)
    keep_picture(page, "finish-page-en")
    card.get_by_label("I do not know").check()
    card.get_by_role("button", name="Save").click()

    expect(page.get_by_role("heading", name="The answer in short")).to_be_visible(timeout=END_MS)
    expect(page.locator(".verdict").first).to_contain_text("Calibration pose: assumed")
    expect(page.locator(".verdict").first).to_contain_text("not confirmed")


def test_a_list_of_participants_proposes_for_each_file_of_a_drop(
    page: Page, server: RunningServer, tmp_path: Path
) -> None:
    files = [make_shift(tmp_path, name) for name in ("first.gt3x", "second.gt3x")]
    people = tmp_path / "people.csv"
    people.write_text("file,subject,arm\nfirst.gt3x,K71,left\nsecond.gt3x,K72,droit\n")
    open_home(page, server)

    page.set_input_files("#files", files)
    card = page.locator("#finish")
    expect(card).to_contain_text("1/2", timeout=END_MS)
    card.locator("[type=file]").set_input_files(people)
    wait_for_questions(page)
    offers = card.get_by_role("button", name="from the list of participants")
    expect(offers).to_have_count(2)
    for _ in range(2):
        offers.first.click()
    one = card.locator("[name=subject]").input_value()
    card.get_by_role("button", name="Save").click()
    expect(card).to_contain_text("2/2")
    wait_for_questions(page)
    expect(offers).to_have_count(2)
    offers.first.click()
    other = card.locator("[name=subject]").input_value()
    page.once("dialog", lambda dialog: dialog.accept())
    card.get_by_role("link", name="Not now").click()

    assert {one, other} == {"K71", "K72"}
    expect(page.locator("#finish")).to_have_count(0)
    expect(find_row(page, one)).to_be_visible(timeout=END_MS)


def test_a_pose_held_at_another_time_is_typed_and_a_window_that_moved_is_refused_on_the_card(
    page: Page, server: RunningServer, tmp_path: Path
) -> None:
    job = server.send(make_shift(tmp_path, "typed.gt3x"))
    page.goto(f"{server.address}recordings/{job['recording_id']}/finish?lang=en")
    card = wait_for_questions(page)

    card.get_by_label("At another time").check()
    card.locator("[name=pose_start]").fill("07:00:05")
    card.locator("[name=pose_end]").fill("07:00:04")
    expect(card.get_by_text("The end is not after the start.")).to_be_visible()
    card.locator("[name=pose_end]").fill("07:00:11")
    card.get_by_role("button", name="Save").click()

    expect(page.get_by_role("heading", name="The answer in short")).to_be_visible(timeout=END_MS)
    expect(page.locator(".verdict").first).to_contain_text("Calibration pose: stated by the user (07:00:05")


def test_if_no_stretch_can_be_proposed_the_time_of_the_pose_can_be_typed(
    page: Page, server: RunningServer, tmp_path: Path
) -> None:
    late = Course().move(620.0).hold(10.0, ASIDE).walk(120.0, tilted(15.0))  # after the first ten minutes
    send(server, tmp_path, "restless.csv", late.record())
    page.goto(f"{server.address}?text=restless&lang=en")

    mark = page.locator(".open-question")
    expect(mark).to_have_text("pose?")
    mark.click()

    card = wait_for_questions(page)
    expect(card.locator(".stretch")).to_have_count(0)
    expect(card).to_contain_text("Calibration pose: none found.")
    card.get_by_label("At another time").check()
    expect(card.locator("[name=pose_start]")).to_be_visible()


@pytest.fixture(scope="module")
def idle(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningServer]:
    """A server without workers: the test decides how far an analysis is."""
    folder = tmp_path_factory.mktemp("idle")
    running = RunningServer(folder / "data", folder / "log", workers=0)
    yield running
    running.stop()


@pytest.mark.parametrize(("width", "language"), SCREENS)
def test_what_is_dropped_is_in_sight_with_the_time_left_also_on_the_first_run(
    page: Page, idle: RunningServer, tmp_path: Path, width: int, language: Language
) -> None:
    page.set_viewport_size({"width": width, "height": 900})
    words, store = load_wording(language, "page"), JobStore(Settings(data_dir=idle.data))
    file = make_shift(tmp_path, f"progress{width}{language}.gt3x")
    open_home(page, idle, language)
    page.evaluate("scrollTo(0, document.body.scrollHeight)")

    page.set_input_files("#files", file)
    bar = page.locator("#finish .line-bar")
    expect(bar).to_be_in_viewport(timeout=END_MS)
    job = store.claim()
    assert job is not None
    store.renew(job.id, str(job.token), "preparing", 0.4)

    # 6 of 10 s of preparation, then 3 s as for any file and 0.15 s for its 0.5 MB
    left = fill(words["row"]["time_left"], {"duration": format_duration(10.0, language)})
    for place in (bar, find_row(page, file.name)):
        expect(place).to_contain_text(words["stage"]["preparing"])
        expect(place).to_contain_text(left)
    keep_picture(page, f"progress-{width}-{language}")
    store.renew(job.id, str(job.token), "reading", 0.2)
    began = (datetime.now(UTC) - timedelta(minutes=1)).isoformat()
    store.run(update(analyses).where(analyses.c.id == job.id).values(started_at=began))
    expect(bar).to_contain_text(words["row"]["longer"])
    store.cancel(job.id)
    store.close()


@pytest.fixture(scope="module")
def two_days(server: RunningServer, tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """A recording of two shifts, which was read as a whole."""
    week = write_week(tmp_path_factory.mktemp("two-days"), days=2, minutes=65)
    job = server.send(week.path)
    assert see_end(server, job["id"])["state"] == "succeeded"
    return {"id": job["id"], "recording": job["recording_id"]}


@pytest.mark.parametrize(("width", "language"), [screen for screen in SCREENS if screen[0] != 1000])
def test_a_recording_of_two_days_is_asked_for_its_shifts_with_their_dates(
    page: Page, server: RunningServer, two_days: dict[str, str], width: int, language: Language
) -> None:
    page.set_viewport_size({"width": width, "height": 900})
    words = load_wording(language, "page")["finish"]
    page.goto(
        f"{server.address}recordings/{two_days['recording']}/finish?analysis={two_days['id']}&lang={language}"
    )
    card = wait_for_questions(page)

    starts = card.locator("[name=shift_start]")
    dates = [starts.nth(place).input_value()[:10] for place in range(starts.count())]
    assert dates == ["2026-03-02", "2026-03-03"]
    expect(card.locator("[name=cut]:checked")).to_have_count(
        0
    )  # a proposal is not used before it is accepted
    expect(card.locator(".stretch:visible")).to_have_count(2)
    keep_picture(page, f"shifts-asked-{width}-{language}")
    barriers = list_barriers(page, Look(language, "light", width), "#finish")

    mark = card.locator(".stretch:visible").first
    before = mark.get_attribute("width")
    card.locator("[name=shift_end]").first.fill("2026-03-02 07h30")
    expect(card.get_by_label(words["cut_lines"])).to_be_checked()
    expect(mark).not_to_have_attribute("width", str(before))
    card.locator("[name=shift_end]").first.blur()
    expect(card.locator("[name=shift_end]").first).to_have_value("2026-03-02 07:30:00")
    card.locator("[name=shift_end]").first.fill("2026-03-02 06:00")
    expect(card.locator("[name=shift_end]").first).to_have_attribute("aria-invalid", "true")
    expect(card.get_by_role("button", name=words["save"])).to_be_disabled()
    card.get_by_label(words["cut_hours"]).check()
    expect(card.locator("[name=hours_start]")).to_be_visible()
    keep_picture(page, f"shifts-hours-{width}-{language}")
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert barriers == []


def test_the_confirmed_shifts_are_reported_and_lead_to_each_other(
    page: Page, server: RunningServer, two_days: dict[str, str]
) -> None:
    page.set_viewport_size({"width": 1440, "height": 900})
    page.goto(f"{server.address}recordings/{two_days['recording']}/finish?analysis={two_days['id']}&lang=en")
    card = wait_for_questions(page)

    card.locator("[name=subject]").fill("W65")
    card.locator("[name=side][value=right]").check(force=True)
    card.locator(".stretch:visible").first.click()
    expect(card.get_by_label("These shifts")).to_be_checked()
    card.get_by_label("The sensor was not removed").check()
    card.get_by_role("button", name="Save").click()

    expect(page.get_by_text("Shift 1 of 2 of this recording")).to_be_visible(timeout=END_MS)
    expect(page.get_by_role("heading", name="The answer in short")).to_be_visible(timeout=END_MS)
    keep_picture(page, "shift-1-of-2")
    page.locator(".shift-days a", has_text="2026-03-03").click()
    expect(page.get_by_text("Shift 2 of 2 of this recording")).to_be_visible()
    expect(page.get_by_role("heading", name="The answer in short")).to_be_visible(timeout=END_MS)
    expect(page.locator(".verdict").first).to_contain_text("Calibration pose")
    page.goto(f"{server.address}person?subject=W65&lang=en")
    for date in ("2026-03-02", "2026-03-03"):
        expect(page.get_by_text(date).first).to_be_visible()
    keep_picture(page, "shifts-person")


def test_a_file_that_is_no_recording_is_not_asked_to_be_finished(
    page: Page, server: RunningServer, tmp_path: Path
) -> None:
    open_home(page, server)

    page.set_input_files("#files", make_file(tmp_path, "letter.csv"))

    card = page.locator("#finish")
    expect(card.locator("[data-problem]")).to_be_visible(timeout=END_MS)
    expect(card.get_by_role("heading", name="Finish this recording")).to_have_count(0)
    expect(card).to_have_accessible_name("letter.csv")
