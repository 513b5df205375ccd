"""What the library's page shows: rows, groups with their counts, pages."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import date
from typing import Any
from urllib.parse import urlencode

from fastapi import Request

from app.jobs.job import Job, JobState
from app.jobs.library import GROUPS, ORDERS, Entry, Group, Library, LibraryFilter, Order
from app.report.words.numbers import format_percent
from app.report.words.wording import Language, fill, load_wording
from app.services import Services
from app.web.views import JobRow, now_utc, show_row

PER_PAGE = 50


@dataclass(frozen=True, slots=True)
class ShownEntry:
    """A row of the list; ``told`` is what a report says at first sight, "" without one.

    ``attempt``: a newer analysis that runs or has failed; the report of the row stays what it was.
    """

    row: JobRow
    verdict: str
    told: str
    attempt: JobRow | None = None

    @property
    def active(self) -> JobRow | None:
        """What goes on for the row just now."""
        return next((row for row in (self.attempt, self.row) if row and not row.is_over), None)


@dataclass(frozen=True, slots=True)
class Chip:
    """A group that can be chosen, with how many are in it."""

    name: str
    count: int
    address: str
    is_chosen: bool


def read_filter(request: Request) -> LibraryFilter:
    """Read what was asked for; what cannot be is as if it had not been asked."""
    asked = request.query_params
    group: Group = next((known for known in GROUPS if known == asked.get("group")), "all")
    order: Order = next((known for known in ORDERS if known == asked.get("order")), "newest")
    first_day, last_day = (_read_day(asked.get(name, "")) for name in ("first_day", "last_day"))
    text, batch = asked.get("text", "").strip()[:100], asked.get("batch", "")[:40]
    return LibraryFilter(text, first_day, last_day, group, order, batch)


def write_filter(wanted: LibraryFilter, **changes: str) -> str:
    """Write a filter as the query of an address."""
    told = {
        "text": wanted.text,
        "first_day": wanted.first_day,
        "last_day": wanted.last_day,
        "group": "" if wanted.group == "all" else wanted.group,
        "order": "" if wanted.order == "newest" else wanted.order,
        "batch": wanted.batch,
    }
    return urlencode({name: value for name, value in (told | changes).items() if value})


def show_library(
    services: Services, request: Request, wanted: LibraryFilter, language: Language
) -> dict[str, Any]:
    """Give everything the list of the first page, or of a batch, needs."""
    library = Library(services.store.reader)
    counts = library.count(wanted)
    pages = max(1, -(-counts[wanted.group] // PER_PAGE))
    page = min(_read_page(request.query_params.get("page", "")), pages)
    entries = library.find_page(wanted, PER_PAGE, (page - 1) * PER_PAGE)
    words = load_wording(language, "page")["list"]
    return {
        "entries": [show_entry(entry, language) for entry in entries],
        "wanted": wanted,
        "query": write_filter(wanted),
        "chips": _list_chips(wanted, counts, language),
        "count": fill(words["summary"], _tell_counts(counts)),
        "is_empty": not counts["all"] and wanted == LibraryFilter(),
        "page": page,
        "pages": pages,
        "earlier_page": write_filter(wanted, page=str(page - 1)) if page > 1 else "",
        "later_page": write_filter(wanted, page=str(page + 1)) if page < pages else "",
        "source_query": write_filter(wanted, page=str(page) if page > 1 else ""),
    }


def show_entry(entry: Entry, language: Language) -> ShownEntry:
    """Show a recording with its report or, without one, its newest analysis."""
    row, attempt = show_row(entry.job, language, now_utc()), _show_attempt(entry, language)
    if entry.headline is None:
        return ShownEntry(row, "", "", attempt)
    words = load_wording(language, "page")
    facts = {
        "verdict": str(words["verdict_short"].get(entry.headline.verdict, "")),
        "start": (entry.headline.start or "")[:16].replace("T", " "),
        "percent": format_percent(entry.headline.above_60_percent, language),
    }
    return ShownEntry(row, entry.headline.verdict, fill(words["row"]["told"], facts), attempt)


def _show_attempt(entry: Entry, language: Language) -> JobRow | None:
    """Leave aside what a person has cancelled."""
    if entry.attempt is None or entry.attempt.state is JobState.CANCELLED:
        return None
    return show_row(entry.attempt, language, now_utc())


def find_neighbours(services: Services, request: Request, job: Job) -> dict[str, Any]:
    """Give what was shown before and after an analysis in the list it was opened from."""
    wanted = read_filter(request)
    before, after = Library(services.store.reader).find_neighbours(job, wanted)
    back = f"/batches/{wanted.batch}" if wanted.batch else "/"
    return {"previous_id": before, "next_id": after, "query": write_filter(wanted), "back": back}


def _list_chips(wanted: LibraryFilter, counts: Mapping[Any, int], language: Language) -> list[Chip]:
    names = load_wording(language, "page")["group"]
    return [
        Chip(
            str(names[group]),
            counts[group],
            write_filter(wanted, group="" if group == "all" else group),
            group == wanted.group,
        )
        for group in GROUPS
        if counts[group] or group in ("all", wanted.group)
    ]


def _tell_counts(counts: Mapping[Any, int]) -> dict[str, str]:
    return {"done": str(counts["all"] - counts["active"]), "all": str(counts["all"])}


def _read_day(text: str) -> str:
    try:
        return date.fromisoformat(text).isoformat()
    except ValueError:
        return ""


def _read_page(text: str) -> int:
    return int(text) if text.isdecimal() and 0 < int(text) < 1_000_000 else 1
