"""The live page: a replay by mouse and keyboard, in both languages, after a reload and a lost link."""

import re
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Page, WebSocketRoute, expect

from tests.pages.conftest import open_page
from tests.pages.test_everyone import Look, list_barriers
from tests.ways_in.servers import RunningServer

pytestmark = pytest.mark.browser


@pytest.fixture
def playing(page: Page, server: RunningServer, right: str) -> Iterator[Page]:
    """A stored recording of three minutes, played at its own pace; it is stopped in the end."""
    recording = server.see(right)["recording_id"]
    page.goto(f"{server.address}live?lang=en&recording={recording}")
    expect(page.locator(f'option[value="{recording}"]')).to_be_attached()
    page.click("#begin")
    expect(page.locator("#latency")).to_contain_text("ms")
    yield page
    if page.locator("#session").is_visible():
        page.keyboard.press("s")
        expect(page.locator("#end")).to_be_visible()


def read_elapsed_s(page: Page) -> int:
    hours, minutes, seconds = (page.text_content("#elapsed") or "").split(":")
    return 3600 * int(hours) + 60 * int(minutes) + int(seconds)


def test_home_leads_to_it(page: Page, server: RunningServer) -> None:
    page.goto(f"{server.address}?lang=en")

    page.click("text=Live: the angle as it happens")

    expect(page.locator("h1")).to_have_text("Live")


def test_a_replay_shows_the_angle_and_what_was_lost(playing: Page) -> None:
    expect(playing.locator("#angle")).to_have_text(re.compile(r"^\d+°$"))
    expect(playing.locator("#lost")).to_have_text("0")
    expect(playing.locator("#above")).to_contain_text("s")
    expect(playing.locator("#rises")).to_have_text(re.compile(r"^\d+$"))
    assert re.match(r"rotate\(-", playing.get_attribute("#limb", "transform") or "")


def test_the_strip_is_drawn(playing: Page) -> None:
    colours = playing.locator("#strip").evaluate(
        "(c) => new Set(c.getContext('2d').getImageData(0, 0, c.width, c.height).data).size"
    )

    assert colours > 3


def test_a_reload_goes_on_with_the_same_session(playing: Page) -> None:
    before_s = read_elapsed_s(playing)

    playing.reload()
    expect(playing.locator("#latency")).to_contain_text("ms")

    assert read_elapsed_s(playing) >= before_s


def test_a_lost_link_is_said_and_comes_back(page: Page, server: RunningServer) -> None:
    links: list[WebSocketRoute] = []
    refusing = [False]

    def route(link: WebSocketRoute) -> None:
        links.append(link)
        if refusing[0]:
            link.close()
        else:
            link.connect_to_server()

    page.route_web_socket(re.compile("api/v1/live"), route)
    page.goto(f"{server.address}live?lang=en")
    page.click("#begin")
    expect(page.locator("#latency")).to_contain_text("ms")

    refusing[0] = True
    links[0].close()
    expect(page.locator("#link")).to_be_visible()
    refusing[0] = False

    expect(page.locator("#link")).to_be_hidden()
    page.keyboard.press("s")
    expect(page.locator("#end")).to_be_visible()


def test_the_pose_is_asked_for_by_a_key(playing: Page) -> None:
    playing.keyboard.press("p")

    expect(playing.locator("#pose")).to_contain_text("Let the arm hang along the body.")


def test_it_is_stopped_by_a_key_and_a_replay_adds_nothing(playing: Page) -> None:
    playing.keyboard.press("s")

    expect(playing.locator("#ended-words")).to_have_text("It was a replay: nothing was added.")
    expect(playing.locator("#report")).to_be_hidden()


def test_another_session_can_follow(playing: Page) -> None:
    playing.keyboard.press("s")
    playing.click("#again")

    expect(playing.locator("#start")).to_be_visible()


def test_a_session_of_a_server_that_was_restarted_is_said(page: Page, server: RunningServer) -> None:
    page.goto(f"{server.address}live?lang=en")
    page.evaluate("() => sessionStorage.setItem('acromion-live', 'of-another-time')")

    page.reload()

    expect(page.locator("#problem")).to_be_visible()


@pytest.mark.parametrize(
    "look", [Look("en", "light", 1200), Look("en", "dark", 360), Look("fr", "light", 360)]
)
def test_everyone_can_use_it(browser: Browser, server: RunningServer, right: str, look: Look) -> None:
    recording = server.see(right)["recording_id"]
    with open_page(browser, look.scheme) as page:
        page.set_viewport_size({"width": look.width, "height": 740})
        page.goto(f"{server.address}live?lang={look.language}&recording={recording}")
        expect(page.locator(f'option[value="{recording}"]')).to_be_attached()
        page.focus("#begin")
        page.keyboard.press("Enter")
        expect(page.locator("#latency")).to_contain_text("ms")

        assert list_barriers(page, look) == []
        assert page.evaluate("() => document.documentElement.scrollWidth") <= look.width
        page.keyboard.press("s")
        expect(page.locator("#end")).to_be_visible()


def test_cues_are_quiet_until_chosen_and_can_be_paused(page: Page, server: RunningServer) -> None:
    page.goto(f"{server.address}live?lang=en")
    expect(page.locator("input[name=rule]:checked")).to_have_count(0)
    page.click("summary")
    page.check("input[value=hold]")
    page.fill("input[name=hold-angle]", "10")
    page.fill("input[name=hold-limit]", "1")
    page.select_option("#speed", "20")
    page.click("#begin")

    expect(page.locator("#cue")).to_contain_text("Above 10° for 1")
    page.keyboard.press("c")

    expect(page.locator("#quiet")).to_have_attribute("aria-pressed", "true")
    expect(page.locator("#cue")).to_be_hidden()
    page.keyboard.press("s")
    expect(page.locator("#end")).to_be_visible()
