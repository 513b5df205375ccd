"""Several curves above one another: both arms of a shift, two visits; they move together."""

from math import sin

import pytest
from playwright.sync_api import Page

from tests.pages.conftest import keep_picture
from tests.pages.steps import see_end
from tests.ways_in.servers import RunningServer

pytestmark = pytest.mark.browser

SEEN = "acromionCurves.curves.map(({view}) => [view.fromS + view.byS, view.toS + view.byS])"
MINUTE_S = 60.0


PLOTS = """[...document.querySelectorAll("#curves .curve")].map((curve) => {
  const lines = [...curve.querySelectorAll(".gridlayer path")].map((line) => line.getBoundingClientRect());
  const frame = curve.parentElement.parentElement.getBoundingClientRect();
  return [lines[0].left - frame.left, frame.right - lines[0].right];
})"""
"""The distance of each drawn grid from the left and the right edge of the box around the curves, in px."""
LOADS = 3


def open_two(page: Page, server: RunningServer, address: str) -> None:
    page.goto(f"{server.address}beside/{address}")
    page.locator("#curves .curve .main-svg").nth(1).wait_for()


@pytest.mark.parametrize("kind", ["pair", "compare"])
def test_both_curves_show_the_same_time(
    page: Page, server: RunningServer, left: str, right: str, kind: str
) -> None:
    open_two(page, server, f"{kind}?first={left}&second={right}")

    page.locator("#curves .curve").nth(1).press("+")
    page.locator("#curves .curve").nth(0).press("ArrowRight")

    (from_s, to_s), other = page.evaluate(SEEN)
    assert 0 < from_s < to_s
    assert other == pytest.approx([from_s, to_s])


@pytest.mark.parametrize("language", ["en", "fr"])
@pytest.mark.parametrize("width_px", [1440, 1000, 390])
def test_curves_are_equally_wide_on_one_time_axis_at_every_load(
    page: Page, server: RunningServer, left: str, right: str, width_px: int, language: str
) -> None:
    page.set_viewport_size({"width": width_px, "height": 900})
    addresses = (
        f"pair?first={left}&second={right}&offset_s=60",
        f"compare?first={left}&second={right}",
    )
    for address in addresses * LOADS:
        open_two(page, server, f"{address}&lang={language}")

        first, second = page.evaluate(PLOTS)

        assert first == second == pytest.approx([46, 12], abs=1), address
        assert page.locator("#curves .xtick").count() > 1
        keep_picture(page, f"curves-{address[:4]}-{language}-{width_px}")
    assert page.locator("#curves .curve").first.locator(".xtick text:visible").count() == 0


def test_a_recording_that_began_later_is_drawn_later(
    page: Page, server: RunningServer, left: str, right: str
) -> None:
    open_two(page, server, f"pair?first={left}&second={right}&offset_s={MINUTE_S:g}")

    shifts = page.evaluate("acromionCurves.curves.map(({view}) => view.byS)")

    assert shifts == [0, MINUTE_S]


def test_a_curve_is_dragged_and_the_other_follows(
    page: Page, server: RunningServer, left: str, right: str
) -> None:
    open_two(page, server, f"pair?first={left}&second={right}")
    curve = page.locator("#curves .curve").nth(1)
    curve.press("+")
    before = page.evaluate(SEEN)[0][0]
    box = curve.bounding_box()
    assert box
    middle, height = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

    page.mouse.move(middle, height)
    page.mouse.down()
    page.mouse.move(middle - 100, height)
    page.mouse.up()

    (after, _), (other, _) = page.evaluate(SEEN)
    assert after > before
    assert other == pytest.approx(after)


@pytest.fixture(scope="module")
def compared(server: RunningServer) -> str:
    """The id of a comparison with a reference, in a study."""
    times = [k / 20 for k in range(600)]
    rows = "".join(f"{t},{45 + 30 * sin(1.3 * t + 2 * sin(0.17 * t)):.3f}\n" for t in times)
    files = {name: (f"{name}.csv", "time_s,elevation_deg\n" + rows) for name in ("recording", "reference")}
    wishes = {"study": "Against the laboratory", "subject": "S088"}
    sent = server.client.post("/api/v1/validations", files=files, data=wishes).json()
    assert see_end(server, sent["id"])["state"] == "succeeded"
    return str(sent["id"])


def test_a_comparison_with_a_reference_draws_both_angles(
    page: Page, server: RunningServer, compared: str
) -> None:
    page.goto(f"{server.address}validations/{compared}?lang=en")
    page.locator("#curves .curve .main-svg").first.wait_for()

    assert page.evaluate("acromionCurves.curves[0].lines().map(({x}) => x.length > 100)") == [True, True]
