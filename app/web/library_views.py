"""Views of the library: rows, groups with their counts, pages."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from urllib.parse import urlencode

from fastapi import Request

from app.jobs.job import Job, JobState
from app.jobs.library.figures import HeadlineFigures
from app.jobs.library.listing import (
    FALLING,
    GROUPS,
    ORDERS,
    Entry,
    Group,
    Library,
    LibraryFilter,
    Order,
    SavedView,
    Took,
)
from app.report.words.numbers import format_duration, format_percent
from app.report.words.wording import Language, Words, fill, load_wording
from app.services import Services
from app.web.rendering import Page
from app.web.views import JobRow, build_row, format_time
from fusion.conventions import METHOD_VERSION

PER_PAGE = 50
SORTED: tuple[Order, ...] = ("subject", "date", "side", "hours", "quality", "above_60")
SPARK_PX = 20.0
SPARK_TOP_DEG = 120.0


@dataclass(frozen=True, slots=True)
class ShownEntry:
    """A row of the list: whose, of when and of which arm, then the main figures of its report.

    ``when`` is the beginning of the recording, or when it was added (``is_added``) where that is not known.
    ``figures`` is None without a report. ``attempt``: a newer analysis that runs or has failed; the report
    of the row stays what it was.
    """

    row: JobRow
    recording_id: str
    name: str
    when: str
    is_added: bool
    arm: str
    figures: "ShownFigures | None" = None
    tags: tuple[tuple[str, str], ...] = ()
    """Each with the address of all that have it."""
    attempt: JobRow | None = None

    @property
    def active(self) -> JobRow | None:
        """The analysis of the row that is under way."""
        return next((row for row in (self.attempt, self.row) if row and not row.is_over), None)


@dataclass(frozen=True, slots=True)
class ShownFigures:
    """The main figures of a report; ``spark`` draws the day, "" where it is not known."""

    hours: str
    verdict: str
    quality: str
    is_older: bool
    is_pose_open: bool
    above: str
    spark: str
    spark_words: str


@dataclass(frozen=True, slots=True)
class Heading:
    """A column by which the list is sorted; ``turned`` is "ascending" or "descending" where it is."""

    order: str
    name: str
    address: str
    turned: str


@dataclass(frozen=True, slots=True)
class Chip:
    """A group that can be chosen, with how many are in it."""

    name: str
    count: int
    address: str
    is_chosen: bool


@dataclass(frozen=True, slots=True)
class LibraryView:
    """The list of the first page, or of a batch: what is ``wanted``, its rows, and the links around them.

    ``number``: of the chosen group; ``source_query``: by which the page asks for its rows again.
    """

    entries: Sequence[ShownEntry]
    headings: Sequence[Heading]
    wanted: LibraryFilter
    tags: Sequence[str]
    views: Sequence[SavedView]
    number: int
    older: int
    query: str
    chips: Sequence[Chip]
    count: str
    is_empty: bool
    page: int
    pages: int
    earlier_page: str
    later_page: str
    source_query: str


@dataclass(frozen=True, slots=True)
class Neighbours:
    """What was shown before and after an analysis in the list that it was opened from."""

    previous_id: str | None
    next_id: str | None
    query: str
    back: str


def read_filter(request: Request) -> LibraryFilter:
    """Read the filter of an address."""
    return parse_filter(request.query_params)


def parse_filter(asked: Mapping[str, str]) -> LibraryFilter:
    """Read a filter; a value that cannot be is ignored."""
    group: Group = next((known for known in GROUPS if known == asked.get("group")), "all")
    order: Order = next((known for known in ORDERS if known == asked.get("order")), "newest")
    first_day, last_day = (_read_day(asked.get(name, "")) for name in ("first_day", "last_day"))
    text, batch = asked.get("text", "").strip()[:100], asked.get("batch", "")[:40]
    is_reversed = asked.get("reversed", "") == "1"
    tag = asked.get("tag", "")[:100]
    return LibraryFilter(text, first_day, last_day, group, order, batch, is_reversed, tag)


def write_filter(wanted: LibraryFilter, **changes: str) -> str:
    """Write a filter as the query of an address."""
    parameters = {
        "text": wanted.text,
        "first_day": wanted.first_day,
        "last_day": wanted.last_day,
        "group": "" if wanted.group == "all" else wanted.group,
        "order": "" if wanted.order == "newest" else wanted.order,
        "batch": wanted.batch,
        "tag": wanted.tag,
        "reversed": "1" if wanted.is_reversed else "",
    }
    return urlencode({name: value for name, value in (parameters | changes).items() if value})


def build_library(page: Page, wanted: LibraryFilter) -> LibraryView:
    """Build everything that the list of the first page, or of a batch, needs."""
    words, services = page.words(), page.services
    library = Library(services.store.reader)
    counts = library.count(wanted)
    pages = max(1, -(-counts[wanted.group] // PER_PAGE))
    asked = page.request.query_params.get("page", "")
    number = min(int(asked) if asked.isdecimal() and 0 < int(asked) < 1_000_000 else 1, pages)
    facts = {"done": str(counts["all"] - counts["active"]), "all": str(counts["all"])}
    done = fill(words["list"]["summary"], facts)
    entries = library.find_page(wanted, PER_PAGE, (number - 1) * PER_PAGE)
    took = find_took(services, entries)
    return LibraryView(
        entries=[build_entry(entry, page.language, took) for entry in entries],
        headings=[_build_heading(order, str(words["column"][order]), wanted) for order in SORTED],
        wanted=wanted,
        tags=library.find_tags(),
        views=() if wanted.batch else services.views.find_all(),
        number=counts[wanted.group],
        older=counts["older"],
        query=write_filter(wanted),
        chips=[
            Chip(
                str(words["group"][group]),
                counts[group],
                write_filter(wanted, group="" if group == "all" else group),
                group == wanted.group,
            )
            for group in GROUPS
            if counts[group] or group in ("all", wanted.group)
        ],
        count=f"{done}. {words['row']['close_hint']}" if counts["active"] else done,
        is_empty=not counts["all"] and wanted == LibraryFilter(),
        page=number,
        pages=pages,
        earlier_page=write_filter(wanted, page=str(number - 1)) if number > 1 else "",
        later_page=write_filter(wanted, page=str(number + 1)) if number < pages else "",
        source_query=write_filter(wanted, page=str(number) if number > 1 else ""),
    )


def find_took(services: Services, entries: Sequence[Entry]) -> tuple[Took, ...]:
    """Say how long earlier analyses took, where one of these runs."""
    jobs = (job for entry in entries for job in (entry.job, entry.attempt) if job)
    is_running = any(job.state is JobState.RUNNING for job in jobs)
    return Library(services.store.reader).find_took() if is_running else ()


def build_entry(entry: Entry, language: Language, took: Sequence[Took] = ()) -> ShownEntry:
    """Show a recording with its report or, without one, its newest analysis."""
    job, words, attempt = entry.job, load_wording(language, "page"), entry.attempt
    if attempt is not None and attempt.state is JobState.CANCELLED:
        attempt = None
    start = (entry.headline.start if entry.headline else None) or ""
    return ShownEntry(
        row=build_row(job, language, took),
        recording_id=job.recording_id,
        name=job.request.subject or job.file_name,
        when=start[:16].replace("T", " ") or format_time(job.created_at),
        is_added=not start,
        arm=str(words["column"][f"side_{job.request.side}"]) if job.request.side else "",
        figures=_build_figures(entry.headline, words, language) if entry.headline else None,
        tags=tuple((tag, urlencode({"tag": tag})) for tag in entry.tags),
        attempt=build_row(attempt, language, took) if attempt else None,
    )


def _build_figures(headline: HeadlineFigures, words: Words, language: Language) -> ShownFigures:
    spark, lowest, highest = draw_spark(headline.day)
    return ShownFigures(
        hours=format_duration(headline.recorded_s, language),
        verdict=headline.verdict,
        quality=str(words["verdict_short"].get(headline.verdict, "")),
        is_older=0 < headline.method_version < int(METHOD_VERSION),
        is_pose_open=headline.calibration_state == "assumed",
        above=format_percent(headline.above_60_percent, language),
        spark=spark,
        spark_words=fill(words["column"]["spark"], {"low": lowest, "high": highest}) if spark else "",
    )


def draw_spark(day: str) -> tuple[str, str, str]:
    """Draw a day of :func:`app.jobs.library.figures.summarise_day` as an SVG path, 100 by 20, 0 to 120 deg.

    Gives the path with its lowest and highest angle; "" for each where no angle is known.
    """
    angles = [float(text) if text else None for text in day.split(",")]
    known = [angle for angle in angles if angle is not None]
    if not known:
        return "", "", ""
    step, parts, is_open = 100 / len(angles), [], False
    for place, angle in enumerate(angles):
        if angle is not None:
            height = SPARK_PX * (1 - min(angle, SPARK_TOP_DEG) / SPARK_TOP_DEG)
            parts.append(f"V{height:.1f}" if is_open else f"M{step * place:.1f} {height:.1f}")
        is_open = angle is not None
        if is_open:
            parts.append(f"H{step * (place + 1):.1f}")
    return "".join(parts), f"{min(known):.0f}", f"{max(known):.0f}"


def find_neighbours(page: Page, job: Job) -> Neighbours:
    """Find what was shown before and after an analysis in the list that it was opened from."""
    wanted = read_filter(page.request)
    before, after = Library(page.services.store.reader).find_neighbours(job, wanted)
    return Neighbours(
        before, after, write_filter(wanted), f"/batches/{wanted.batch}" if wanted.batch else "/"
    )


def _build_heading(order: Order, name: str, wanted: LibraryFilter) -> Heading:
    """Build the head of a column; a second click turns the order round."""
    is_chosen = wanted.order == order
    is_falling = (order in FALLING) != (is_chosen and wanted.is_reversed)
    again = "1" if is_chosen and not wanted.is_reversed else ""
    turned = ("descending" if is_falling else "ascending") if is_chosen else ""
    return Heading(order, name, write_filter(wanted, order=order, reversed=again), turned)


def _read_day(text: str) -> str:
    try:
        return date.fromisoformat(text).isoformat()
    except ValueError:
        return ""
