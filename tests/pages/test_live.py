"""The live page: a replay by mouse and keyboard, in both languages, after a reload and a lost link."""

import json
import re
from collections.abc import Iterator

import pytest
from playwright.sync_api import BrowserContext, CDPSession, Page, WebSocketRoute, expect
from websockets.sync.client import connect

from tests.pages.conftest import open_page
from tests.pages.steps import see_end
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


def test_in_full_screen_figures_are_read_from_three_metres(playing: Page) -> None:
    # 16 arc minutes, the least of ISO 9241-303, are 14 mm at 3 m: capitals of 50 px on a 24-inch screen of
    # 1920 x 1080, a font of 70 px. The countdown is read on the way: 13 arc minutes.
    playing.set_viewport_size({"width": 1920, "height": 1080})
    playing.keyboard.press("f")
    expect(playing.locator("#session:fullscreen")).to_be_attached()
    playing.keyboard.press("p")
    expect(playing.locator("#pose")).to_be_visible()

    measure = "(part) => parseFloat(getComputedStyle(part).fontSize)"
    assert playing.locator("#angle").evaluate(measure) > 300
    assert playing.locator("#above").evaluate(measure) >= 69
    assert playing.locator("#pose").evaluate(measure) >= 55
    assert playing.evaluate("document.getElementById('session').scrollHeight <= innerHeight")


def test_it_is_stopped_by_a_key_and_a_replay_adds_nothing(playing: Page) -> None:
    playing.keyboard.press("s")

    expect(playing.locator("#ended-words")).to_have_text("This was a replay: no recording was added.")
    expect(playing.locator("#report")).to_be_hidden()


@pytest.mark.parametrize(
    ("language", "words", "hint"),
    [
        ("en", "No page was showing the session", "you can return within a minute"),
        ("fr", "Plus aucune page ne montrait la session", "vous pouvez y revenir pendant une minute"),
    ],
)
def test_what_happens_to_a_session_whose_page_is_closed_is_said_before_and_after(
    page: Page, server: RunningServer, language: str, words: str, hint: str
) -> None:
    def route(link: WebSocketRoute) -> None:
        onwards = link.connect_to_server()
        onwards.on_message(lambda text: link.send(str(text).replace('"was_left":false', '"was_left":true')))

    page.route_web_socket(re.compile("api/v1/live"), route)
    page.goto(f"{server.address}live?lang={language}")
    page.select_option("#source", "phone")
    expect(page.locator("#start")).to_contain_text(hint)
    page.select_option("#source", "demo")
    page.click("#begin")
    expect(page.locator("#latency")).to_contain_text("ms")
    page.keyboard.press("s")

    expect(page.locator("#ended-words")).to_contain_text(words)


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
def test_everyone_can_use_it(context: BrowserContext, server: RunningServer, right: str, look: Look) -> None:
    recording = server.see(right)["recording_id"]
    with open_page(context, look.scheme) as page:
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
    page.click("main summary")
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


FAKE_PORT = """
navigator.serial.requestPort = async () => ({
  open: async ({ baudRate }) => { window.baudRate = baudRate; },
  close: async () => { window.isClosed = true; },
  readable: new ReadableStream({
    start(controller) {
      const text = new TextEncoder();
      const names = "time_us,counter,acc_x_g,acc_y_g,acc_z_g,gyr_x_dps,gyr_y_dps,gyr_z_dps";
      controller.enqueue(text.encode("# device: LSM9DS1\\n" + names + "\\n"));
      let row = 0;
      window.feeding = setInterval(() => {
        let lines = "";
        for (let k = 0; k < 10; k++, row++)
          lines += `${10000 * row},${row},0.0${row % 7},0.866,0.5,0.1,0.2,0.${row % 9}\\n`;
        controller.enqueue(text.encode(lines));
      }, 20);
    },
    cancel() { clearInterval(window.feeding); },
  }),
});
"""


def test_a_board_by_web_serial_is_read_and_becomes_a_recording(page: Page, server: RunningServer) -> None:
    # The sensor's z lies at 60 deg from the vertical (0.5 g of it), which is strapped along the arm.
    page.add_init_script(FAKE_PORT)
    page.goto(f"{server.address}live?lang=en")
    page.select_option("#source", "serial")
    page.select_option("#axis", "+z")
    page.fill("#subject", "S060")
    page.click("#begin")

    expect(page.locator("#angle")).to_have_text("60°")
    page.keyboard.press("s")
    expect(page.locator("#ended-words")).to_contain_text("Every sample is stored")
    expect(page.locator("#report")).to_be_visible()
    assert page.evaluate("() => [window.baudRate, window.isClosed]") == [115200, True]
    kept = server.client.get("/api/v1/recordings").json()["items"]
    assert "S060" in {one["subject"] for one in kept}


def test_a_moment_is_marked_by_a_button(page: Page, server: RunningServer) -> None:
    page.add_init_script(FAKE_PORT)
    page.goto(f"{server.address}live?lang=en")
    page.select_option("#source", "serial")
    page.select_option("#axis", "+z")
    page.click("#begin")
    expect(page.locator("#angle")).to_have_text("60°")

    page.fill("#mark-label", "pain")
    page.click("#mark")

    expect(page.locator("#marked")).to_contain_text(re.compile(r"Marks: 1\. The last at 0:00:\d\d: pain"))


def test_a_port_that_is_refused_is_said(page: Page, server: RunningServer) -> None:
    page.add_init_script("navigator.serial.requestPort = async () => { throw new Error('none chosen'); }")
    page.goto(f"{server.address}live?lang=en")
    page.select_option("#source", "serial")
    page.click("#begin")

    expect(page.locator("#problem")).to_contain_text("none chosen")


EVEN_CLOCK = """
window.Accelerometer = class extends Accelerometer {
  #readings = 0;
  constructor(options) {
    super(options);
    super.addEventListener("reading", () => this.#readings++);
  }
  get timestamp() { return (this.#readings * 1000) / 60; }
};
"""


def test_the_phone_s_own_sensors_are_read(page: Page, server: RunningServer) -> None:
    # Emulated: the phone lies still, its y 120 deg from the vertical. Its clock counts the readings: a busy
    # machine hands them over at no even rate.
    page.add_init_script(EVEN_CLOCK)
    page.context.grant_permissions(["accelerometer", "gyroscope"])
    tools = page.context.new_cdp_session(page)
    for kind in ("accelerometer", "gyroscope"):
        tools.send("Emulation.setSensorOverrideEnabled", {"enabled": True, "type": kind, "metadata": {}})
    page.goto(f"{server.address}live?lang=en")
    page.select_option("#source", "phone")
    page.select_option("#axis", "+y")
    page.click("#begin")

    for number in range(2000):
        if page.locator("#angle").text_content() == "120°":
            break
        shake = 0.01 * (number % 5)
        reading = {"x": 8.4928 + shake, "y": -4.9033, "z": 0.02 * (number % 3)}
        send_reading(tools, "accelerometer", reading)
        send_reading(tools, "gyroscope", {"x": 0.001 * (number % 4), "y": 0.0, "z": 0.001})

    expect(page.locator("#angle")).to_have_text("120°")
    page.keyboard.press("s")
    expect(page.locator("#end")).to_be_visible()


def send_reading(tools: CDPSession, kind: str, xyz: dict[str, float]) -> None:
    reading = {"type": kind, "reading": {"xyz": xyz}}
    tools.send("Emulation.setSensorOverrideReadings", reading)


def test_a_session_that_is_kept_is_compared_with_its_report(server: RunningServer, right: str) -> None:
    recording = server.see(right)["recording_id"]
    asked = {"type": "start", "source": "recording", "recording": recording, "speed": 20, "keeps": True}
    with connect(f"{server.address.replace('http', 'ws')}api/v1/live") as socket:
        socket.send(json.dumps(asked))
        session = json.loads(socket.recv())["session"]
        ended = next(found for text in socket if (found := json.loads(text))["type"] == "ended")

    assert see_end(server, ended["analysis"])["state"] == "succeeded"
    told = server.client.get(f"/api/v1/live/{session}/difference?lang=fr").json()
    assert told["compared_s"] > 160
    assert 0 < told["rmse_deg"] < 5
    assert sum(told["live_percent"]) == pytest.approx(100.0)
    assert told["text"].startswith("Direct comparé au rapport")


def test_before_its_report_is_made_there_is_no_comparison(server: RunningServer) -> None:
    assert server.client.get("/api/v1/live/none/difference").status_code == 404
