"""The HTML report: one file that asks for nothing, in which user text is only ever text."""

import base64
import hashlib
import re
from functools import cache
from html.parser import HTMLParser

import pytest

from app.report.analysis.report import build_report
from app.report.render.html import content_security_policy, render_html
from app.report.words.wording import LANGUAGES, Language
from tests.app.analysis_factory import make_analysis, make_subject


class Elements(HTMLParser):
    """Counts elements and attributes as a browser would see them."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str | None]] = []
        self.words: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += attrs

    def handle_data(self, data: str) -> None:
        self.words.append(data)


def read(html: bytes) -> Elements:
    elements = Elements()
    elements.feed(html.decode("utf-8"))
    return elements


@cache
def page(language: Language = "en", subject: str = "S012", file_name: str = "a.gt3x") -> bytes:
    return render_html(build_report(make_analysis(), make_subject(subject, file_name), language))


def test_nothing_is_loaded_from_anywhere() -> None:
    loading = {"src", "href", "srcset", "data", "action", "poster", "xlink:href", "background"}

    found = read(page())

    assert [value for name, value in found.attributes if name in loading] == ["#answer"]
    assert not {"script", "iframe", "object", "embed", "link", "form"} & set(found.tags)
    assert not re.search(rb"url\((?!#)|@import", page())
    assert "style" not in {name for name, _ in found.attributes}  # which the policy would block


def test_the_policy_forbids_everything_but_the_style() -> None:
    style = re.search(rb"<style>(.*?)</style>", page(), re.DOTALL)
    assert style is not None
    digest = base64.b64encode(hashlib.sha256(style[1]).digest()).decode()

    assert content_security_policy() == (
        f"default-src 'none'; style-src 'sha256-{digest}'; base-uri 'none'; form-action 'none'"
    )


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_page_declares_its_language_and_is_light(language: Language) -> None:
    assert f'<html lang="{language}">'.encode() in page(language)
    assert len(page(language)) <= 400_000


def test_no_id_appears_twice_and_every_header_cell_has_a_scope() -> None:
    ids = [value for name, value in read(page()).attributes if name == "id"]

    assert len(ids) == len(set(ids))
    assert re.findall(r"<th(?! scope=)[ >]", page().decode()) == []


def test_every_chart_has_a_title_a_description_and_a_table() -> None:
    tags = read(page()).tags

    tiles, how_sure = 4, 1
    drawn_once = tiles + how_sure
    assert tags.count("figure") * 2 + drawn_once == tags.count("svg") == tags.count("desc")
    assert tags.count("figure") == tags.count("details")


def luminance(colour: str) -> float:
    channels = [int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


@pytest.mark.parametrize("theme", [0, 1], ids=["light", "dark"])
def test_text_contrast_is_at_least_4_5(theme: int) -> None:
    colours = {
        name: luminance(re.findall(rf"--{name}: (#\w{{6}})", page().decode())[theme])
        for name in ("ink", "soft", "accent", "link", "paper", "tint")
    }

    for text in ("ink", "soft", "accent", "link"):
        for ground in ("paper", "tint"):
            dark, light = sorted((colours[text], colours[ground]))
            assert (light + 0.05) / (dark + 0.05) >= 4.5, (text, ground)
