"""The site: every link leads somewhere, nothing comes from another host, and it works from a disk."""

import os
import re
from collections.abc import Iterator
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from playwright.sync_api import Browser, Page, Request, expect

from acromion import fusion
from tests import ROOT

GUIDE = ("start", "poses", "reading", "limits", "codes")
LOADING = {"script": "src", "img": "src", "link": "href", "iframe": "src", "source": "src"}
"""What a browser fetches by itself; a link of ``rel="canonical"`` is none."""


class PageReader(HTMLParser):
    """The addresses and the places of a page."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.places: set[str] = set()
        self.feed(path.read_text("utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = {name: value or "" for name, value in attrs}
        self.places.update(values[name] for name in ("id", "name") if name in values)
        if tag == "a" and "href" in values:
            self.links.append(values["href"])
        if tag in LOADING and LOADING[tag] in values:
            self.loaded.append(values[LOADING[tag]])


@pytest.fixture(scope="module")
def read(site: Path) -> dict[Path, PageReader]:
    return {path: PageReader(path) for path in site.rglob("*.html")}


def list_internal(read: dict[Path, PageReader]) -> Iterator[tuple[Path, str, Path, str]]:
    for path, page in read.items():
        for address in (*page.links, *page.loaded):
            parts = urlsplit(address)
            if not parts.scheme and not parts.netloc and not address.startswith("/"):
                target = path.parent / unquote(parts.path) if parts.path else path
                yield path, address, find_target(os.path.normpath(target)), unquote(parts.fragment)


@cache
def find_target(address: str) -> Path:
    """Return the file that an address within the site leads to: of a folder, its first page."""
    return Path(address, "index.html") if Path(address).is_dir() else Path(address)


@cache
def exists(target: Path) -> bool:
    return target.is_file()


def test_every_link_within_the_site_leads_to_a_file_and_a_place(
    site: Path, read: dict[Path, PageReader]
) -> None:
    checked = list(list_internal(read))

    broken = [
        (path.relative_to(site).as_posix(), address)
        for path, address, target, place in checked
        if (path.name != "404.html" and not exists(target))
        or (place and target in read and place not in read[target].places)
    ]
    assert len(checked) > 1000
    assert broken == []


def test_no_page_loads_anything_from_another_host(site: Path, read: dict[Path, PageReader]) -> None:
    foreign = [
        (path.relative_to(site).as_posix(), address)
        for path, page in read.items()
        for address in page.loaded
        if urlsplit(address).netloc
    ]
    styles = [
        path for path in site.rglob("*.css") if re.search(r"url\(['\"]?(?:https?:)?//", path.read_text())
    ]

    assert foreign == []
    assert styles == []


@pytest.mark.parametrize("name", GUIDE)
def test_the_guide_for_clinicians_stands_in_both_languages(site: Path, name: str) -> None:
    english, french = ((site / "guide" / language / f"{name}.html").read_text() for language in ("en", "fr"))

    assert '<div lang="en">' in english
    assert '<div lang="fr">' in french
    assert len(re.findall("<h[23]", english)) == len(re.findall("<h[23]", french))
    assert english.count("<img") == french.count("<img")


def test_french_punctuation_has_its_no_break_spaces(site: Path) -> None:
    text = re.sub("<[^>]+>", "", (site / "guide/fr/start.html").read_text().split('<div lang="fr">')[1])

    assert "Ce qu’il faut" in text
    assert re.findall(r"\w [;!?»]", text.split("</article>")[0]) == []


def test_the_reference_holds_every_public_name(site: Path, read: dict[Path, PageReader]) -> None:
    places = {place.rpartition(".")[2] for place in read[site / "code/reference.html"].places}

    assert sorted(set(fusion.__all__) - places) == []


def test_no_page_names_a_folder_of_the_machine_that_built_it(site: Path) -> None:
    home = str(ROOT)

    assert [path.name for path in site.rglob("*.html") if home in path.read_text("utf-8")] == []
    assert "/tmp/" not in (site / "code/recording_to_figure.html").read_text("utf-8")


@pytest.fixture
def opened(browser: Browser) -> Iterator[tuple[Page, list[str]]]:
    page = browser.new_page(viewport={"width": 360, "height": 800})
    fetched: list[str] = []

    def note(request: Request) -> None:
        fetched.append(request.url)

    page.on("request", note)
    yield page, fetched
    page.close()


@pytest.mark.browser
def test_search_from_a_disk_finds_what_a_caveat_means_and_asks_no_other_host(
    site: Path, opened: tuple[Page, list[str]]
) -> None:
    page, fetched = opened

    page.set_viewport_size({"width": 1440, "height": 900})
    page.goto((site / "index.html").as_uri())
    page.locator(".md-search__input").click()
    expect(page.get_by_text("Type to start searching")).to_be_visible(timeout=60_000)
    page.locator(".md-search__input").press_sequentially("W-GAP")

    first = page.locator(".md-search-result__item").first
    expect(first).to_contain_text("W-GAP: Holes in the recording", timeout=60_000)
    assert [address for address in fetched if not address.startswith(("file:", "data:", "blob:"))] == []


@pytest.mark.browser
@pytest.mark.parametrize(
    "name", ["index", *(f"guide/{language}/{name}" for language in ("en", "fr") for name in GUIDE), "formats"]
)
def test_a_page_fits_a_telephone(site: Path, opened: tuple[Page, list[str]], name: str) -> None:
    page, _ = opened

    page.goto((site / f"{name}.html").as_uri())

    assert page.evaluate("document.documentElement.scrollWidth") <= 360
