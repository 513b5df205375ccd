"""A study on its page: a ranking by time above 60 deg, and the subject and arm of each recording."""

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean
from urllib.parse import urlencode

from acromion.app.http.pages.views import OPEN_POSES, build_row
from acromion.app.library.listing import Entry, HeadlineFigures
from acromion.app.report.words.numbers import (
    NARROW,
    format_duration,
    format_number,
    format_percent,
    format_range,
)
from acromion.app.report.words.wording import Language, fill, load_wording
from acromion.app.request import find_code, propose_description

STEPS = (1.0, 2.0, 5.0, 10.0, 20.0, 25.0)
MOST_TICKS = 4


@dataclass(frozen=True, slots=True)
class RankedArm:
    """An arm of a person in the ranking: its mean over whole days, with places on the scale in percent.

    ``dots``: each day; ``line``: the 95 % range of a single day, None for several days or without a range.
    ``address`` is the page of the person or, without a subject code, of the recording. ``has_open_pose``:
    nobody has confirmed the pose of a day.
    """

    name: str
    address: str
    side: str
    above: str
    detail: str
    at: str
    dots: tuple[str, ...]
    line: tuple[str, str] | None
    is_poor: bool
    has_open_pose: bool


@dataclass(frozen=True, slots=True)
class Ranking:
    """The arms with the most time above 60 deg first; ``ticks``: places on the scale and their texts.

    ``short``: the number of recordings of less than 4 h, which are left out.
    """

    arms: tuple[RankedArm, ...]
    ticks: tuple[tuple[str, str], ...]
    short: int


@dataclass(frozen=True, slots=True)
class StudyRow:
    """A recording in the table of a study: its subject and arm, stated or proposed, and its state."""

    id: str
    recording_id: str
    file: str
    folder: str
    subject: str
    side: str
    is_subject_proposed: bool
    is_side_proposed: bool
    is_over: bool
    state: str
    state_word: str
    above: str
    span: str
    hours: str

    @property
    def is_proposed(self) -> bool:
        """Whether a subject or arm waits for a person to confirm it."""
        return self.is_subject_proposed or self.is_side_proposed


_Counted = tuple[Entry, HeadlineFigures, float]


def build_ranking(entries: Sequence[Entry], language: Language) -> Ranking:
    """Rank the arms of a study by their mean time above 60 deg over days of at least 4 h.

    Recordings without a subject code are each ranked alone, because nothing says that they are of one person.
    """
    grouped: dict[tuple[str, str], list[_Counted]] = {}
    short = 0
    for entry in entries:
        headline, (subject, side) = entry.headline, _find_label(entry)
        if headline is None or headline.above_60_percent is None:
            continue
        if headline.is_short:
            short += 1
            continue
        whose = find_code(subject).casefold() or entry.job.recording_id
        group = grouped.setdefault((whose, side), [])
        group.append((entry, headline, headline.above_60_percent))
    ranked = sorted(grouped.values(), key=lambda days: -fmean(percent for *_, percent in days))
    ends = [
        headline.interval.high if headline.interval else 0.0 for days in ranked for _, headline, _ in days
    ]
    most = min(max([1.0, *ends, *(percent for days in ranked for *_, percent in days)]), 100.0)
    step = next((step for step in STEPS if step * MOST_TICKS >= most), STEPS[-1])
    count = max(1, -int(-most // step))
    top = step * count
    sign = "\u00a0%" if language != "en" else f"{NARROW}%"
    ticks = tuple(
        (_place(step * k, top), f"{step * k:g}{sign if k == count else ''}") for k in range(count + 1)
    )
    return Ranking(tuple(_rank_arm(days, top, language) for days in ranked), ticks, short)


def _rank_arm(days: Sequence[_Counted], top: float, language: Language) -> RankedArm:
    entry, headline, _ = days[0]
    (subject, side), words = _find_label(entry), load_wording(language, "page")
    percents = [percent for *_, percent in days]
    interval, line = headline.interval, None
    detail = format_range(interval, language)
    if len(days) > 1:
        low, high = format_number(min(percents), 1, language), format_percent(max(percents), language)
        detail = fill(words["studies"]["days"], {"n": str(len(days)), "low": low, "high": high})
    elif interval:
        line = (_place(interval.low, top), _place(interval.high, top))
    address = f"/person?{urlencode({'subject': subject})}"
    return RankedArm(
        name=subject or entry.job.file_name,
        address=address if subject else f"/analyses/{entry.job.id}",
        side=words["column"][f"side_{side}"] if side else "–",
        above=format_percent(fmean(percents), language),
        detail=detail,
        at=_place(fmean(percents), top),
        dots=tuple(_place(percent, top) for percent in percents) if len(days) > 1 else (),
        line=line,
        is_poor=any(headline.verdict == "poor" for _, headline, _ in days),
        has_open_pose=any(headline.calibration_state in OPEN_POSES for _, headline, _ in days),
    )


def _place(percent: float, top: float) -> str:
    return f"{100 * min(percent, top) / top:.1f}%"


def _find_label(entry: Entry) -> tuple[str, str]:
    """Return subject and arm of the recording, which a report that is being set again does not have yet."""
    return entry.subject or entry.label.subject, entry.side or entry.label.side or ""


def build_study_row(entry: Entry, language: Language) -> StudyRow:
    """Build the row of a recording; a missing subject or arm is proposed from file and folder names."""
    job, headline = entry.job, entry.headline
    row, words = build_row(job, language), load_wording(language, "page")
    proposal = propose_description(f"{entry.folder}/{job.file_name}")
    subject, side = _find_label(entry)
    state, state_word = row.state, row.state_word
    if headline:
        state, state_word = headline.verdict, words["verdict_short"][headline.verdict]
        state_word += f", {words['column']['short']}" if headline.is_short else ""
    elif not row.is_over:
        state_word = f"{row.state_word} · {row.percent}{NARROW}%"
    return StudyRow(
        id=job.id,
        recording_id=job.recording_id,
        file=job.file_name,
        folder=entry.folder,
        subject=subject or proposal.subject,
        side=side or proposal.side or "",
        is_subject_proposed=not subject and bool(proposal.subject),
        is_side_proposed=not side and bool(proposal.side),
        is_over=row.is_over,
        state=state,
        state_word=state_word,
        above=format_percent(headline.above_60_percent, language) if headline else "",
        span=format_range(headline.interval, language) if headline else "",
        hours=format_duration(headline.recorded_s, language) if headline else "",
    )
