"""Help by what happened: every code stands once, under what a person sees."""

from html.parser import HTMLParser

import pytest
from fastapi.testclient import TestClient

from app.errors import list_refusals
from app.report.words.messages import find_flag_codes
from app.web.help import HAPPENED, find_happened


class Links(HTMLParser):
    """Collects where the links of a page lead."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.found: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found += [str(value) for name, value in attrs if tag == "a" and name == "href"]


@pytest.mark.parametrize("language", ["en", "fr"])
def test_every_code_stands_once(client: TestClient, language: str) -> None:
    links = Links(client.get("/help", params={"lang": language}).text).found

    codes = sorted(link.removeprefix("/problems/") for link in links if link.startswith("/problems/"))
    assert codes == sorted({refusal.code for refusal in list_refusals()} | set(find_flag_codes()))


def test_what_happened_to_a_file_comes_first(client: TestClient) -> None:
    page = client.get("/help?lang=en").text

    assert page.index("A file is not taken for a recording") < page.index("For those who run Acromion")


def test_no_code_is_behind_two_happenings() -> None:
    codes = [code for key in HAPPENED for code in find_happened(key)]

    assert len(codes) == len(set(codes))
