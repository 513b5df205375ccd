"""Nothing that axe knows of keeps anyone from the report (WCAG 2.2 AA), in either language."""

from collections.abc import Callable
from dataclasses import fields, replace
from typing import Literal

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser

from acromion.app.report.findings import FinishedAnalysis
from acromion.app.report.model import Report
from acromion.app.report.pairs import build_comparison, build_pair
from acromion.app.report.render.html import render_html
from acromion.app.report.single.report import build_report
from acromion.app.report.words.wording import LANGUAGES, Language
from acromion.fusion.exposure.types import MinuteProfile
from tests.app.analysis.test_both_arms import make_pair
from tests.app.analysis_factory import make_analysis, make_exposure, make_minutes, make_subject

pytestmark = pytest.mark.browser

RULES = {
    "runOnly": ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"],
    "resultTypes": ["violations"],
}


def first_minutes(count: int = 5) -> MinuteProfile:
    """A day of few rows: axe looks at every cell, and they are all alike."""
    day = make_minutes()
    return MinuteProfile(*(getattr(day, field.name)[:count] for field in fields(day)))


KEPT = FinishedAnalysis(
    make_analysis(exposure=replace(make_exposure(), minutes=first_minutes())), make_subject()
)
PAIR = replace(make_pair(), left=KEPT, right=KEPT)
REPORTS: dict[str, Callable[[Language], Report]] = {
    "one arm": lambda language: build_report(KEPT.findings, KEPT.subject, language),
    "both arms": lambda language: build_pair(PAIR, language),
    "before and after": lambda language: build_comparison(KEPT, KEPT, language),
}


@pytest.mark.parametrize(("scheme", "width", "language"), [("light", 1000, "en"), ("dark", 360, "fr")])
@pytest.mark.parametrize("kind", REPORTS)
def test_axe_finds_nothing(
    kind: str, language: Language, scheme: Literal["light", "dark"], width: int, browser: Browser
) -> None:
    page = browser.new_page(color_scheme=scheme, viewport={"width": width, "height": 900}, bypass_csp=True)
    page.set_content(render_html(REPORTS[kind](language)).decode())
    page.evaluate("document.querySelectorAll('details').forEach(part => part.open = true)")

    found = Axe().run(page, options=RULES).response["violations"]

    page.close()
    assert [(item["id"], item["nodes"][0]["html"][:120]) for item in found] == []


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_values_of_the_tiles_stand_on_one_line_without_our_font(
    language: Language, browser: Browser
) -> None:
    page = browser.new_page(viewport={"width": 1000, "height": 900}, bypass_csp=True)
    page.set_content(render_html(REPORTS["one arm"](language)).decode())
    page.add_style_tag(content="body { font-family: 'DejaVu Sans', Verdana, sans-serif; }")

    tops = page.eval_on_selector_all(
        ".tile .value", "tiles => tiles.map(tile => tile.getBoundingClientRect().top)"
    )

    page.close()
    assert len(tops) == 4
    assert max(tops) - min(tops) < 1
