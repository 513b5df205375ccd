"""The report as one self-contained HTML file: no script, no request, no external font."""

import base64
import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from urllib.parse import quote

from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template
from markupsafe import Markup, escape

from acromion.app.report.model import AgreementReport, Report
from acromion.app.report.words.numbers import format_duration, format_percent
from acromion.app.report.words.wording import Language, clean_text, fill, load_wording


@cache
def find_template_folder() -> Path:
    """Return the folder of the templates and fonts: in the installed package, else in the checkout."""
    here = Path(__file__).resolve()
    packaged = here.parents[2] / "templates" / "report"
    return packaged if packaged.is_dir() else here.parents[3] / "templates" / "report"


def render_html(report: Report | AgreementReport) -> bytes:
    """Render the report; the same report gives the same bytes."""
    style = Markup(read_style())  # noqa: S704 - our own style sheet
    policy = content_security_policy()
    template = load_template("report.html.j2" if isinstance(report, Report) else "agreement.html.j2")
    text: str = template.render(report=report, words=report.words, style=style, policy=policy)
    return text.encode("utf-8")


@cache
def content_security_policy() -> str:
    """Return the policy in the file: nothing may be loaded, only its own style applies.

    A server should also send this policy in the header, because a stricter one would block the style.
    """
    digest = base64.b64encode(hashlib.sha256(read_style().encode()).digest()).decode("ascii")
    return f"default-src 'none'; style-src 'sha256-{digest}'; base-uri 'none'; form-action 'none'"


@cache
def read_style() -> str:
    """Return the style sheet that every page includes."""
    return (find_template_folder() / "report.css").read_text(encoding="utf-8")


@cache
def load_template(name: str) -> Template:
    """Return one of the report's templates, compiled once."""
    environment = Environment(
        loader=FileSystemLoader(find_template_folder()),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["drawing"] = mark_drawing_safe
    environment.filters["whole"] = keep_ranges_whole
    environment.filters["brackets"] = keep_brackets_whole
    return environment.get_template(name)


def mark_drawing_safe(svg: str) -> Markup:
    """Mark a chart as safe: every text in it was escaped when it was drawn."""
    return Markup(svg)  # noqa: S704


_RANGE = re.compile(r"(?<![\d.,])\d[\d.,]*(?:\s(?:min|s|h|%))?–\d[\d.,]*(?:\s(?:min|s|h|%))?")


def keep_ranges_whole(text: str) -> Markup:
    """Escape a text and keep each of its ranges, "3.3–10.4 %" or "24 s–58 s", on one line."""
    return Markup(_RANGE.sub(r'<span class="whole">\g<0></span>', str(escape(text))))  # noqa: S704


_BRACKETS = re.compile(r"\([^()]*\d[^()]*\)")


def keep_brackets_whole(text: str) -> Markup:
    """Escape a cell and keep the range in brackets on one line, which may be below the figure."""
    return Markup(_BRACKETS.sub(r'<span class="whole">\g<0></span>', str(escape(text))))  # noqa: S704


# The index page of a run: analysed time, main figure and state of each recording.


@dataclass(frozen=True, slots=True)
class IndexRow:
    """One recording of the run. ``folder`` is None without a report; ``state`` is in words."""

    file_name: str
    folder: str | None
    analysed_s: float | None
    above_60_percent: float | None
    state: str


def render_index(rows: Sequence[IndexRow], method: str, language: Language) -> bytes:
    """Render the list as one HTML file with links to the reports beside it."""
    words = load_wording(language, "run")["index"]
    good = sum(row.folder is not None for row in rows)
    subtitle = fill(words["subtitle"], {"good": str(good), "all": str(len(rows)), "method": method})
    shown = [
        {
            "file": clean_text(row.file_name),
            "link": f"{quote(row.folder)}/report.html" if row.folder else "",
            "analysed": format_duration(row.analysed_s, language),
            "above_60": format_percent(row.above_60_percent, language),
            "state": row.state,
        }
        for row in rows
    ]
    text = load_template("index.html.j2").render(
        language=language,
        words=words,
        subtitle=subtitle,
        rows=shown,
        style=Markup(read_style()),  # noqa: S704  our own style sheet
        policy=content_security_policy(),
    )
    return text.encode("utf-8")
