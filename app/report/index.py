"""The page beside the reports of one run: which recording, how much of it, what came out."""

from collections.abc import Sequence
from dataclasses import dataclass
from urllib.parse import quote

from markupsafe import Markup

from app.report.html import content_security_policy, load_template, read_style
from app.report.numbers import format_duration, format_percent
from app.report.subject import clean_text
from app.report.wording import Language, fill, load_wording


@dataclass(frozen=True, slots=True)
class IndexRow:
    """One recording of the run. ``folder`` is None where there is no report; ``state`` is in words."""

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
    text = load_template("index.html.j2").render(
        language=language,
        words=words,
        subtitle=subtitle,
        rows=[_show(row, language) for row in rows],
        style=Markup(read_style()),  # noqa: S704  our own style sheet
        policy=content_security_policy(),
    )
    return text.encode("utf-8")


def _show(row: IndexRow, language: Language) -> dict[str, str]:
    return {
        "file": clean_text(row.file_name),
        "link": f"{quote(row.folder)}/report.html" if row.folder else "",
        "analysed": format_duration(row.analysed_s, language),
        "above_60": format_percent(row.above_60_percent, language),
        "state": row.state,
    }
