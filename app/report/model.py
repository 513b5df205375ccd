"""The content of a report: rounded values and finished sentences, with nothing left to compute.

The templates (HTML and PDF) only loop over these.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime

from app.report.charts.svg import NARROW, WIDE
from app.report.words.wording import Language, Words


@dataclass(frozen=True, slots=True)
class Pair:
    """A name and its value. ``code`` values are set in a fixed-width face and may break anywhere."""

    name: str
    value: str
    code: bool = False


@dataclass(frozen=True, slots=True)
class Table:
    """A table whose first column heads its rows.

    ``prose``: the second column holds sentences; ``even``: all columns but the first are equally wide.
    """

    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""
    prose: bool = False
    even: bool = False

    @classmethod
    def lay(
        cls, entry: Words, rows: Iterable[Iterable[str]], note: str = "", *, prose: bool = False
    ) -> Table:
        """Lay rows out under the caption and the columns of their words."""
        return cls(entry["caption"], tuple(entry["columns"]), tuple(map(tuple, rows)), note, prose)


@dataclass(frozen=True, slots=True)
class Chart:
    """A chart twice, as SVG for paper and wide screens and for a telephone, with its text and its table.

    ``alternative`` says in a sentence what the chart shows; ``table`` holds the values behind it.
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
        """Draw a chart in both widths; ``words`` are its title and text, ``draw`` takes them and a width."""
        table = Table(words[0], tuple(columns), tuple(rows))
        return cls(*words, draw(words, WIDE), draw(words, NARROW), table, note)


@dataclass(frozen=True, slots=True)
class VerdictLine:
    """How far the data can be trusted; ``level`` is "good", "caution" or "poor", for shape and colour."""

    level: str
    label: str
    reason: str


@dataclass(frozen=True, slots=True)
class Note:
    """A titled paragraph, or several."""

    title: str
    paragraphs: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Section:
    """A chapter after the first page; what is empty vanishes."""

    key: str
    title: str
    paragraphs: tuple[str, ...] = ()
    figures: tuple[Chart, ...] = ()
    pairs: tuple[Pair, ...] = ()
    tables: tuple[Table, ...] = ()
    sources: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Tile:
    """A main figure: its value, how long, its range, and a scale with the published value, which is named.

    ``needed`` comes before the value if the pose has to be named first; ``pose`` says how far the error of
    the calibration pose may raise it; may be empty, as all but name and value may.
    """

    name: str
    needed: str
    value: str
    duration: str
    range: str
    pose: str
    published: str
    scale: str
    alternative: str


@dataclass(frozen=True, slots=True)
class Drawing:
    """A drawing with its title, its text alternative and where its values come from.

    Without a drawing the note says why.
    """

    title: str
    alternative: str
    svg: str
    note: str


@dataclass(frozen=True, slots=True)
class Profile:
    """The first page, the Arm Elevation Profile (docs/profile.md).

    ``quality`` names what limits the data; ``tiles`` are time above 30, 60 and 90 deg, and rises above 60 deg
    an hour; ``strip`` is the day with its tasks. ``tasks``: the tasks, or the quarter hours, with the most
    time above 60 deg; None without any. ``sure``: the doubts about the time above 60 deg. ``next_steps``:
    each by a stated rule. ``amendment``: on paper, that the report replaces another; else empty.
    """

    quality: str
    tiles: tuple[Tile, ...]
    strip: Chart
    tasks: Table | None
    sure: Drawing
    next_title: str
    next_steps: tuple[str, ...]
    not_a_diagnosis: str
    amendment: str = ""


@dataclass(frozen=True, slots=True)
class Sheet:
    """What every report has. ``figures`` stand beside the sentences, which are the answer; ``words`` are the
    fixed words of the templates (headings, labels).
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
    """All that the template of a report of one recording, or of several, may use.

    ``pose_caution``: the known one-sided error of the calibration pose, in words beside the figures; may be
    empty.
    ``range_note``: what the ranges in the sentences hold; empty where no sentence has one.
    ``brief``: the last line of the answer as plain text: whose, when, which report.
    ``made_of``: end of the recording, the only date a report bears; None without a clock.
    ``amendment``: which version this is and why, where it replaces an earlier one; else empty.
    ``pose_state``: how the calibration pose is known, in a line; empty for ready angles.
    ``needs_pose``: which stillness was the pose, if they disagree: it comes before every figure; else empty.
    ``walking_note``: how far walking lies from the axis, if that is far; else empty.
    ``profile``: the first page, behind which the rest then stands; None in a report of several.
    ``conclusion``: what a clinician concludes: name and date as its title; None where nobody has.
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
    """All that the template of a comparison, or of a study of several, may use.

    ``main`` is the table that answers the question. It has no date of its own.
    """

    main: tuple[Table, ...]


def format_brief(report: Report) -> bytes:
    """Write the answer as a few lines of plain text, to paste into a record.

    The pose comes first if it has to be named before the figures mean much.
    """
    quality = " ".join(filter(None, (report.verdict.label, report.verdict.reason, report.pose_caution)))
    pose = " ".join(filter(None, (report.needs_pose, report.pose_state)))
    first, last = (pose, "") if report.needs_pose else ("", pose)
    lines = (first, *report.sentences, quality, last, report.brief)
    return ("\n".join(filter(None, lines)) + "\n").encode("utf-8")
