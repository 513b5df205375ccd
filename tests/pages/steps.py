"""What a person does again and again on the pages."""

import re
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Dialog, Locator, Page, expect

from tests.ways_in.servers import RunningServer

END_MS = 120_000


def open_home(page: Page, server: RunningServer, language: str = "en") -> None:
    page.goto(f"{server.address}?lang={language}")


def open_analysis(page: Page, server: RunningServer, analysis_id: str, language: str = "en") -> None:
    page.goto(f"{server.address}analyses/{analysis_id}?lang={language}")


def keep_no_drafts(page: Page) -> None:
    """Keep the drafts of this page from the server, because other tests open the same recording."""
    page.route("**/drafts/**", lambda route: route.fulfill(status=204))


def find_row(page: Page, name: str) -> Locator:
    """The row of a file on the server."""
    return page.locator("#rows .row", has_text=name).first


def find_upload(page: Page, name: str) -> Locator:
    """The row of a file that this page sends."""
    return page.locator("#uploads .row", has_text=name)


def wait_for_end(page: Page, name: str, state: str = "succeeded") -> Locator:
    row = find_row(page, name)
    expect(row).to_have_attribute("data-state", state, timeout=END_MS)
    return row


def see_end(server: RunningServer, analysis_id: str) -> dict[str, Any]:
    """Wait for the end of an analysis; the first of a fresh checkout waits for the compiler, too."""
    for _ in range(5):
        view = server.see(analysis_id, wait=60)
        if view["state"] not in ("queued", "running"):
            return view
    pytest.fail("the analysis does not end")


def make_file(folder: Path, name: str, megabytes: float = 0.001) -> Path:
    """Make a file that is no recording and like no other."""
    path = folder / name
    line = f"{name} of {folder.name} is not a recording\n".encode()
    path.write_bytes((line * (int(megabytes * 1e6) // len(line) + 1))[: max(len(line), int(megabytes * 1e6))])
    return path


def wait_for_curve(page: Page) -> None:
    """Wait until the day is drawn."""
    expect(page.locator("#curve .main-svg").first).to_be_visible()
    expect(page.locator("#view")).to_have_text(re.compile(r"\d"))


def read_view(page: Page) -> tuple[float, float]:
    """Return the seconds in view."""
    told: list[float] = page.evaluate("[acromionDay.view.fromS, acromionDay.view.toS]")
    return told[0], told[1]


def read_bands(page: Page) -> list[dict[str, Any]]:
    """Give kind, start and end of the bands on the curve."""
    program = "acromionDay.bands.list().map(({kind, name, startS, endS}) => ({kind, name, startS, endS}))"
    bands: list[dict[str, Any]] = page.evaluate(program)
    return bands


FIELD_HINTS = re.compile(r"10:20, 10\.20, 1020 (et|and) 10h20")
"""Fields take other spellings of a time, and a hint next to them lists four."""
OTHER_TIMES = {
    "en": r"\b\d{1,2}\s?h\s?\d{2}\b(?!\s?min)",
    "fr": r"(?<![\d:;-])\d{1,2}:\d{2}(?![\d:])|\b\d{2}:\d{2}:\d{2}\b|\b0\d\s?h\b|\d h\b|\dh\d",
}
READ_TEXT = """() => {
  const texts = [], walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  const isCode = ({ parentElement }) => parentElement.closest("script, style, template, code, pre");
  while (walker.nextNode()) if (!isCode(walker.currentNode)) texts.push(walker.currentNode.data);
  for (const name of ["aria-label", "title", "aria-valuetext"])
    for (const element of document.querySelectorAll(`[${name}]`)) texts.push(element.getAttribute(name));
  return texts.join("\\n");
}"""


def list_other_times(page: Page, language: str) -> list[str]:
    """Return the times on the page that are not spelled in the one way of its language.

    English: 07:05, 07:05:09. French: 7 h 05, 7 h 05 min 09 s, with narrow spaces that do not break.
    """
    return re.findall(OTHER_TIMES[language], FIELD_HINTS.sub("", page.evaluate(READ_TEXT)))


def note_questions(page: Page) -> list[str]:
    """Accept every question of the browser; gives a list to which each is added."""
    asked: list[str] = []

    def accept(dialog: Dialog) -> None:
        asked.append(dialog.type)
        dialog.accept()

    page.on("dialog", accept)
    return asked
