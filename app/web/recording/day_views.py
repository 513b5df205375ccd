"""Views of a day: rows of the form, proposals, hours as a table."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any

from app.errors import BadParameter
from app.report.words.numbers import Clock, format_angle, format_duration, format_number, format_percent
from app.report.words.wording import Language, Words, fill, load_wording
from app.request import ReportRequest
from app.storage.day_file import DayFile
from fusion.conventions import ARM_AXES
from fusion.diary import KINDS, DiaryEntry, read_moment
from fusion.errors import UnusableDiary
from fusion.exposure.periods import place_diary, place_moment
from fusion.recording import MICROSECONDS

# Moments of a recording as people type and read them: on the device's clock, or in seconds without one.


DAY_S = 86400.0
SHOWN_US = 10_000
"""Moments are shown to the hundredth of a second, so that they may be read this much aside."""
STILL_KINDS = {"": "still", "pose": "still", "repeat": "repeat"}
"""What a still stretch is proposed as; days of earlier versions proposed poses alone."""
MOST_PROPOSED = 5


@dataclass(frozen=True, slots=True)
class DayClock:
    """When a recording began, and how long it is."""

    start: datetime | None
    duration_us: int

    @classmethod
    def of(cls, facts: Mapping[str, Any]) -> "DayClock":
        """Take it from the facts of a day file."""
        start = datetime.fromisoformat(facts["start"]) if facts["start"] else None
        return cls(start, int(facts["duration_us"]))

    @property
    def duration_s(self) -> float:
        """Seconds from the first sample to the end."""
        return self.duration_us / MICROSECONDS

    @property
    def needs_date(self) -> bool:
        """Whether an hour alone may mean two days."""
        return self.duration_s >= DAY_S

    def format(self, elapsed_s: float) -> str:
        """Write a moment so that :meth:`read` gives it back, to the hundredth of a second."""
        if self.start is None:
            return f"{elapsed_s:.2f}".rstrip("0").rstrip(".")
        moment = self.start + timedelta(seconds=round(elapsed_s, 2))
        hundredths = f".{moment.microsecond // 10_000:02d}".rstrip("0").rstrip(".")
        return moment.strftime("%Y-%m-%d %H:%M:%S" if self.needs_date else "%H:%M:%S") + hundredths

    def format_bounds(self) -> str:
        """Write from when to when a moment may be."""
        return f"{self.format(0.0)} … {self.format(self.duration_s)}"

    def read(self, text: str, name: str) -> float:
        """Read a moment that a person typed, in seconds from the first sample. Raises BadParameter."""
        clock, seconds = ("", text) if self.start is None else (text, "")
        try:
            moment = read_moment(0, clock, seconds)
            placed_us = place_moment(text if moment is None else moment, 0, self.start, self.duration_us)
            if not -SHOWN_US <= placed_us <= self.duration_us + SHOWN_US:
                raise ValueError
        except (UnusableDiary, ValueError):
            raise BadParameter(name=name, value=text[:60], allowed=self.format_bounds()) from None
        return min(max(placed_us, 0), self.duration_us) / MICROSECONDS


def place_rows(entries: Sequence[DiaryEntry], clock: DayClock) -> list[dict[str, Any]]:
    """Give the rows of a diary as the form shows them: clock times that can be typed again.

    Raises UnusableDiary.
    """
    periods = place_diary(entries, clock.start, clock.duration_us).periods
    return [
        {
            "kind": period.kind,
            "label": period.label,
            "start": clock.format(period.start_us / MICROSECONDS),
            "end": clock.format(period.end_us / MICROSECONDS),
        }
        for period in periods
    ]


@dataclass(frozen=True, slots=True)
class Window:
    """A calibration window as the form shows it: what was asked, or else what the software used."""

    start: str
    end: str
    used_start: str
    used_end: str


@dataclass(frozen=True, slots=True)
class Proposal:
    """A stretch that a person may accept."""

    kind: str
    start: str
    end: str
    sentence: str


@dataclass(frozen=True, slots=True)
class Choice:
    """An answer: ``value`` as it is sent, ``label`` as it reads.

    Of a stretch also ``start`` and ``end``, and its ``name`` on the curve.
    """

    value: str
    label: str
    name: str = ""
    start: str = ""
    end: str = ""


@dataclass(frozen=True, slots=True)
class Question:
    """What only a person knows.

    ``action`` and ``field`` send the answer; ``start`` to ``end`` is the time that it is about.
    """

    key: str
    action: str
    field: str
    heading: str
    lead: str
    choices: tuple[Choice, ...]
    start: str = ""
    end: str = ""


@dataclass(frozen=True, slots=True)
class AxisView:
    """Which sensor axis lay along the arm: what was ``asked`` ("" for none), and what the form offers.

    ``drawing`` names the drawing of the sensor, ``where`` says how its axes lie and ``nearest`` which of them
    is nearest to the axis that was found.
    """

    asked: str
    choices: tuple[tuple[str, str], ...]
    drawing: str
    where: str
    nearest: str


@dataclass(frozen=True, slots=True)
class DayView:
    """Everything the timeline's part of the page needs."""

    start: str
    duration_s: float
    needs_date: bool
    rows: list[dict[str, Any]]
    windows: tuple[Window, ...]
    level: Window
    held: str
    slips: str
    no_slips: str
    axis: AxisView
    questions: tuple[Question, ...]
    proposals: tuple[Proposal, ...]
    kinds: tuple[tuple[str, str], ...]
    has_samples: bool


def build_day(day: DayFile, request: ReportRequest, language: Language) -> DayView:
    """Build the view of a day and of its request."""
    clock, words = DayClock.of(day.facts), load_wording(language, "day")
    names = words["kind_name"]
    count = 1 if request.pose == "two-point" else max(1, len(request.calibration_windows_s))
    return DayView(
        start=str(day.facts["start"] or ""),
        duration_s=clock.duration_s,
        needs_date=clock.needs_date,
        rows=place_rows(request.select_diary(), clock),
        windows=tuple(_build_window(place, day, request, clock) for place in range(count)),
        level=_build_window(1, day, request, clock) if request.pose == "two-point" else NO_WINDOW,
        held=request.pose_held or "",
        slips="; ".join(map(clock.format, request.slip_times_s)),
        no_slips="; ".join(map(clock.format, request.no_slip_times_s)),
        axis=_build_axis(day.facts, request, words, language),
        questions=tuple(_list_questions(day.facts, request, words, Clock(clock.start, language))),
        proposals=_build_proposals(day.facts, clock, words, language),
        kinds=tuple((kind, str(names[kind])) for kind in KINDS),
        has_samples=bool(day.facts["calibration"] or day.facts.get("nearest_axis")),
    )


def _build_axis(
    facts: Mapping[str, Any], request: ReportRequest, words: Words, language: Language
) -> AxisView:
    entry, device = words["along"], facts["device"]
    drawing = device if device in entry["where"] else "other"
    nearest, apart_deg = (None if request.arm_axis else facts.get("nearest_axis")) or ("", 0.0)
    told = {"axis": format_axis(nearest), "apart": format_angle(apart_deg, language)}
    return AxisView(
        asked=request.arm_axis or "",
        choices=list_axes(),
        drawing=drawing,
        where=str(entry["where"][drawing]),
        nearest=fill(entry["nearest"], told) if nearest else "",
    )


def list_axes() -> tuple[tuple[str, str], ...]:
    """Give each axis that may lie along the arm, and how people read it."""
    return tuple((axis, format_axis(axis)) for axis in ARM_AXES)


def format_axis(axis: str) -> str:
    """Write a sensor's axis as people read it: "y", "−y"."""
    return axis.removeprefix("+").replace("-", "\u2212")


# The questions of the page: when the pose was held, whether the sensor moved, which pose came after that.


START = "start"
"""In place of a stretch: the pose was held at the start of wear."""
YES, NO = "yes", "no"
"""Whether the sensor moved on the arm."""


def name_choice(start_s: float, end_s: float) -> str:
    """Name a stretch in a form."""
    return f"{start_s:.2f}-{end_s:.2f}"


def _list_questions(
    facts: Mapping[str, Any], request: ReportRequest, words: Words, told: Clock
) -> Iterator[Question]:
    """Yield what is open; a pose after a move is asked for once the one before it is confirmed."""
    place = _Place(DayClock.of(facts), told, words)
    if facts.get("asked"):
        yield _ask_for_pose(facts, request, place)
    for number, (kind, start_s, end_s, apart_deg) in enumerate(facts.get("moves", ())):
        span = {**told.format_span(start_s, end_s), "apart": format_angle(apart_deg, told.language)}
        heading, lead = (fill(words[key], span) for key in (kind, f"{kind}_lead"))
        yes, no = ("slipped", "no_slip") if kind == "slip" else ("moved", "same_place")
        choices = (Choice(f"{number}-{YES}", words[yes]), Choice(f"{number}-{NO}", words[no]))
        shown = (place.clock.format(round(at_s)) for at_s in (start_s, end_s))
        yield Question(f"move-{number}", "moved", "answer", heading, lead, choices, *shown)
    for number, (start_s, _, stills) in enumerate(() if facts.get("asked") else facts.get("unread", ())):
        time = {"time": told.format(start_s)}
        offers = tuple(place.offer("choice", *still) for still in stills)
        heading, lead = (fill(words[key], time) for key in ("which_after", "which_after_lead"))
        yield Question(f"pose-after-{number}", "pose", "choice", heading, lead, offers)


@dataclass(frozen=True, slots=True)
class _Place:
    """Writes stretches: ``clock`` as the form reads moments, ``told`` as people do."""

    clock: DayClock
    told: Clock
    words: Words

    def offer(self, key: str, start_s: float, end_s: float) -> Choice:
        facts = {
            "time": self.told.format(start_s, with_seconds=True),
            "length": format_duration(end_s - start_s, self.told.language),
        }
        start, end = (self.clock.format(round(at_s)) for at_s in (start_s, end_s))
        label, name = fill(self.words[key], facts), f"{facts['time']}?"
        return Choice(name_choice(start_s, end_s), label, name, start, end)


def _ask_for_pose(facts: Mapping[str, Any], request: ReportRequest, place: _Place) -> Question:
    """Ask when the pose was held; the first stretch is the one in use."""
    words, spread_deg = place.words, facts.get("spread_deg", 0.0)
    apart = format_angle(spread_deg, place.told.language)
    leads = [str(words["which_not_held"])] if facts.get("not_held") else []
    if facts.get("needs_pose"):
        leads.append(fill(words["which_apart"], {"apart": apart}))
    leads = leads or [str(words["which_lead"])]
    for start_s, *_ in facts.get("unread", ()):
        leads.append(fill(words["which_next"], {"time": place.told.format(start_s)}))
    used, *others = facts["asked"]
    choices = [place.offer("choice_used", *used), *(place.offer("choice", *other) for other in others)]
    if request.pose_held != "start" and not facts.get("not_held"):
        choices.insert(1, Choice(START, words["held_start"]))
    return Question("which-pose", "pose", "choice", words["which"], " ".join(leads), tuple(choices))


NO_WINDOW = Window("", "", "", "")


def _build_window(place: int, day: DayFile, request: ReportRequest, clock: DayClock) -> Window:
    chosen, used = request.calibration_windows_s, day.facts["calibration"]
    start, end = map(clock.format, chosen[place]) if place < len(chosen) else ("", "")
    used_start, used_end = map(clock.format, used[place][:2]) if place < len(used) else ("", "")
    return Window(start, end, used_start, used_end)


def _build_proposals(
    facts: Mapping[str, Any], clock: DayClock, words: Words, language: Language
) -> tuple[Proposal, ...]:
    still = [
        (start_s, end_s, STILL_KINDS["".join(kind)], format_number(score, 2, language))
        for start_s, end_s, score, *kind in facts["still"]
    ]
    still = [*still[:MOST_PROPOSED], *(row for row in still[MOST_PROPOSED:] if row[2] == "repeat")]
    not_worn = [(start_s, end_s, "not_worn", "") for start_s, end_s in facts["not_worn"]]
    proposals = []
    for start_s, end_s, kind, score in (*still, *not_worn):
        shown = {"start": clock.format(round(start_s)), "end": clock.format(round(end_s)), "score": score}
        start, end = clock.format(start_s), clock.format(end_s)
        proposals.append(Proposal(kind, start, end, fill(words[kind], shown)))
    return tuple(proposals)


def build_hours(results: Mapping[str, Any], language: Language) -> list[tuple[str, ...]]:
    """Give the hours as rows of a table: hour, analysed, median, P90, time above 60 deg.

    An hour of which nothing was analysed has no figures: the last, when a day ends just behind the full hour.
    """
    return [
        (
            str(hour["label"]).replace("T", " "),
            format_duration(hour["analysed_s"], language),
            format_angle(hour.get("elevation_p50_deg"), language),
            format_angle(hour.get("elevation_p90_deg"), language),
            format_percent(hour.get("time_above_60_percent"), language),
        )
        for hour in results["exposure"].get("by_hour", ())
    ]
