"""The content of a report: rounded values and finished sentences.

The templates (HTML and PDF) only loop over these and compute nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime

from acromion.app.report.charts.svg import NARROW, WIDE
from acromion.app.report.words.wording import Language, Words


@dataclass(frozen=True, slots=True)
class Pair:
    """A name and its value. ``code`` values use a fixed-width font and may break anywhere."""

    name: str
    value: str
    code: bool = False


@dataclass(frozen=True, slots=True)
class Table:
    """A table; its first column contains the row headings.

    ``prose``: the second column contains sentences; ``even``: all columns but the first have the same width.
    """

    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""
    prose: bool = False
    even: bool = False

    @classmethod
    def build(
        cls, entry: Words, rows: Iterable[Iterable[str]], note: str = "", *, prose: bool = False
    ) -> Table:
        """Build a table from its words (caption and columns) and rows."""
        return cls(entry["caption"], tuple(entry["columns"]), tuple(map(tuple, rows)), note, prose)


@dataclass(frozen=True, slots=True)
class Chart:
    """A chart as SVG in two widths (paper and wide screens, phones), with its text and its table.

    ``alternative`` describes the chart in a sentence; ``table`` contains its values.
    """

    title: str
    alternative: str
    wide: str
    narrow: str
    table: Table
    note: str = ""

    @classmethod
    def draw(
        cls,
        words: tuple[str, str],
        draw: Callable[[tuple[str, str], float], str],
        columns: Sequence[str],
        rows: Iterable[tuple[str, ...]],
        note: str = "",
    ) -> Chart:
        """Draw a chart in both widths; ``draw`` receives ``words`` (title and text) and a width."""
        table = Table(words[0], tuple(columns), tuple(rows))
        return cls(*words, draw(words, WIDE), draw(words, NARROW), table, note)


@dataclass(frozen=True, slots=True)
class VerdictLine:
    """How far the data can be trusted; ``level`` ("good", "caution" or "poor") selects shape and colour."""

    level: str
    label: str
    reason: str


@dataclass(frozen=True, slots=True)
class Note:
    """A title with one or more paragraphs."""

    title: str
    paragraphs: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Section:
    """A chapter after the first page; empty parts are not shown.

    ``starts_page``: on paper it and the following chapters, up to the next such one, share one page.
    ``in_appendix``: on paper it is printed only on request, after all others.
    """

    key: str
    title: str
    paragraphs: tuple[str, ...] = ()
    figures: tuple[Chart, ...] = ()
    pairs: tuple[Pair, ...] = ()
    tables: tuple[Table, ...] = ()
    sources: tuple[str, ...] = ()
    starts_page: bool = False
    in_appendix: bool = False


@dataclass(frozen=True, slots=True)
class Tile:
    """A main figure: its value, duration and range, and a scale with the published value.

    ``needed`` precedes the value if the pose must be named first. ``pose`` states how far the error of the
    calibration pose may raise the value; ``standing`` whether it is below or above the proposal, or
    the source of the published values. All except name and value may be empty.
    """

    name: str
    needed: str
    value: str
    duration: str
    range: str
    pose: str
    standing: str
    scale: str
    alternative: str


@dataclass(frozen=True, slots=True)
class Drawing:
    """A drawing with its title, its text alternative and the source of its values.

    Without a drawing the note states the reason.
    """

    title: str
    alternative: str
    svg: str
    note: str


@dataclass(frozen=True, slots=True)
class Profile:
    """The first page, the Arm Elevation Profile (docs/profile.md).

    ``quality`` lists limits of the data; ``not_measured`` what the angle does not show. ``tiles`` are time
    above 30, 60 and 90 deg, and the median velocity; ``strip`` is the day with its tasks. ``tasks``: those,
    or the quarter hours, with the most time above 60 deg; None if there are none. ``rest``: rest and minutes
    with several rises. ``sure``: the uncertainty of the time above 60 deg. ``next_steps``: each follows from
    a stated rule, the most important first. ``amendment``: on paper, states that the report replaces another;
    else empty. ``conclusion``: the clinician's, a long one only begun; None leaves space to write by hand.
    ``released``: the stamp of a released report; else empty, which leaves a line to sign. ``proposals``:
    the meaning of the values in the tiles; empty if nothing is compared.
    """

    quality: str
    not_measured: str
    tiles: tuple[Tile, ...]
    strip: Chart
    tasks: Table | None
    rest_title: str
    rest: tuple[Pair, ...]
    sure: Drawing
    next_title: str
    next_steps: tuple[str, ...]
    not_a_diagnosis: str
    proposals: str = ""
    amendment: str = ""
    conclusion: Note | None = None
    released: str = ""


@dataclass(frozen=True, slots=True)
class Sheet:
    """Common content of every report.

    ``figures`` are beside the sentences, which are the answer; ``words`` are the fixed words of the templates
    (headings, labels).
    """

    language: Language
    title: str
    subtitle: str
    header: tuple[Pair, ...]
    sentences: tuple[str, ...]
    figures: tuple[Chart, ...]
    limits: Note
    sections: tuple[Section, ...]
    report_id: str
    footer: str
    words: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Report(Sheet):
    """The content of a report on one recording, or on several.

    ``pose_caution``: the known one-sided error of the calibration pose, in words beside the figures; may be
    empty. ``range_note``: meaning of the ranges in the sentences; empty if no sentence has one. ``brief``:
    the last line of the answer as plain text: person, date, report. ``made_of``: end of the recording, the
    only date in a report; None without a clock. ``amendment``: version and reason, if it replaces an earlier
    one; else empty. ``pose_state``: evidence for the calibration pose, in a line; empty for a file with
    angles. ``needs_pose``: asks which stillness was the pose, if they disagree, before every figure; else
    empty. ``walking_note``: the angle between walking and the axis, if it is large; else empty. ``profile``:
    the first page, followed by the rest; None in a report on several. ``conclusion``: the clinician's, with
    name and date as its title; None if there is none.
    """

    verdict: VerdictLine
    pose_caution: str
    range_note: str
    intended_use: Note
    brief: str
    made_of: datetime | None
    amendment: str = ""
    pose_state: str = ""
    needs_pose: str = ""
    walking_note: str = ""
    profile: Profile | None = None
    conclusion: Note | None = None


@dataclass(frozen=True, slots=True)
class AgreementReport(Sheet):
    """The content of a report on a comparison, or on a study of several.

    ``main`` is the table that answers the question. It has no date.
    """

    main: tuple[Table, ...]


def format_brief(report: Report) -> bytes:
    """Encode the answer as a few lines of plain text, to paste into a record.

    The pose comes first if it must be named before the figures can be interpreted.
    """
    quality = " ".join(filter(None, (report.verdict.label, report.verdict.reason, report.pose_caution)))
    pose = " ".join(filter(None, (report.needs_pose, report.pose_state)))
    first, last = (pose, "") if report.needs_pose else ("", pose)
    lines = (first, *report.sentences, quality, last, report.brief)
    return ("\n".join(filter(None, lines)) + "\n").encode("utf-8")
