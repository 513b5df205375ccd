"""How to read page 1: a page with pictures, linked from every tile; where a pose is chosen, why to lean."""

import pytest
from playwright.sync_api import Page, expect

from tests.pages.conftest import keep_picture
from tests.pages.steps import open_analysis
from tests.ways_in.servers import RunningServer

pytestmark = pytest.mark.browser


def test_the_figures_lead_to_how_to_read_them_and_back(shown: Page) -> None:
    came_from = shown.url

    shown.get_by_role("link", name="How to read this").press("Enter")
    expect(shown.get_by_role("heading", name="A tile", exact=True)).to_be_in_viewport()
    shown.go_back()

    assert shown.url == came_from


@pytest.mark.parametrize(
    ("language", "headings"),
    [
        ("en", ["What these figures cannot show", "Method", "Glossary"]),
        ("fr", ["Ce que ces chiffres ne montrent pas", "Méthode", "Glossaire"]),
    ],
)
def test_pictures_limits_method_and_glossary_stand_on_one_page(
    page: Page, server: RunningServer, language: str, headings: list[str]
) -> None:
    page.goto(f"{server.address}help/reading?lang={language}")

    for part in ("angle", "tile", "day", "sure"):
        expect(page.locator(f"section[aria-labelledby={part}] svg").locator("visible=true")).to_have_count(1)
    for name in headings:
        expect(page.get_by_role("heading", name=name, exact=True)).to_be_visible()
    keep_picture(page, f"reading-{language}")


@pytest.mark.parametrize(
    ("language", "reason"),
    [
        ("en", "Leaning to the side reads within 2°"),
        ("fr", "est exact à 2° près, car le bras pend"),
    ],
)
def test_where_a_pose_is_chosen_the_reason_to_lean_stands_beside_it(
    page: Page, server: RunningServer, right: str, language: str, reason: str
) -> None:
    open_analysis(page, server, right, language)

    expect(page.locator(".field", has=page.locator("#pose"))).to_contain_text(reason)
