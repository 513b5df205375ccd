"""The report as a tagged PDF (PDF/UA-1 and PDF/A-3a). Only this module uses the PDF engine.

Typst receives the report as a JSON file beside the template, so that no text is ever read as markup. Only our
fonts are used, so that every machine with the same zlib writes the same bytes.
"""

import io
import json
import re
from collections.abc import Mapping
from dataclasses import asdict
from datetime import UTC, datetime
from typing import Any

import pikepdf
import typst

from acromion.app.report.model import AgreementReport, Report
from acromion.app.report.render.html import find_template_folder
from acromion.app.request import Paper

STANDARDS = ("ua-1", "a-3a")
NO_CLOCK = datetime(1970, 1, 1, tzinfo=UTC)
_SCREEN_ONLY = {"table"}
"""Parts of a figure that paper does not show."""

_TYPST_PAPERS: dict[Paper, str] = {"a4": "a4", "letter": "us-letter"}
_MIME_TYPES = {"json": "application/json", "csv": "text/csv"}

# Characters in the shipped Inter font; any other would make the PDF an invalid archive.
_UNCOVERED = re.compile(
    "[^\u0020-\u007e\u00a0-\u0148\u014a-\u017f\u0300-\u0304\u0391-\u03a1\u03a3-\u03ce\u0400-\u045f"
    "\u1e00-\u1ef9\u2010-\u2027\u202f-\u203a\u20ac\u2190-\u2193\u2212\u2264\u2265]"
)


def render_pdf(
    report: Report | AgreementReport,
    attachments: Mapping[str, bytes],
    paper: Paper = "a4",
    *,
    has_appendix: bool = False,
) -> bytes:
    """Render the report with its attachments; the same input gives the same bytes."""
    files = _gather_files(report, attachments, paper, has_appendix=has_appendix)
    document = _compile(files, pdf_standards=list(STANDARDS))
    packed = io.BytesIO()  # the engine does not compress table tags, two thirds of the file
    with pikepdf.open(io.BytesIO(document)) as pdf:
        pdf.save(packed, object_stream_mode=pikepdf.ObjectStreamMode.generate, deterministic_id=True)
    return packed.getvalue()


def render_first_page(report: Report | AgreementReport, paper: Paper, dots_per_inch: int) -> bytes:
    """Render the first page of the PDF as a PNG, for documents that show it."""
    files = _gather_files(report, {}, paper, has_appendix=False)
    return _compile(files, format="png", ppi=dots_per_inch)


def _gather_files(
    report: Report | AgreementReport, attachments: Mapping[str, bytes], paper: Paper, *, has_appendix: bool
) -> dict[str, bytes]:
    folder = find_template_folder()
    template = "report.typ" if isinstance(report, Report) else "agreement.typ"
    return {
        "main.typ": (folder / template).read_bytes(),
        "pieces.typ": (folder / "pieces.typ").read_bytes(),
        "report.json": _encode(report, tuple(attachments), paper, has_appendix=has_appendix),
        **{f"attached/{name}": content for name, content in attachments.items()},
    }


def _compile(files: dict[str, bytes], **options: Any) -> bytes:
    """Run the engine; of several pages return the first."""
    fonts = [str(find_template_folder() / "fonts")]
    made: bytes | list[bytes] = typst.compile(
        files, font_paths=fonts, ignore_system_fonts=True, timestamp=0, **options
    )
    return made if isinstance(made, bytes) else made[0]


def replace_uncovered(text: str) -> str:
    """Replace a character that our font lacks by its code: "[U+4E2D]"."""
    return _UNCOVERED.sub(lambda found: f"[U+{ord(found[0]):04X}]", text)


def _encode(
    report: Report | AgreementReport, attached: tuple[str, ...], paper: Paper, *, has_appendix: bool
) -> bytes:
    values = asdict(report)
    made_of = values.pop("made_of", None) or NO_CLOCK
    values["date"] = list(made_of.timetuple()[:6])
    values["paper"], values["appendix"] = _TYPST_PAPERS[paper], has_appendix
    values["language"], _, values["region"] = report.language.partition("-")
    values["attached"] = [
        {"name": name, "mime": _MIME_TYPES.get(name.rsplit(".", 1)[-1], "application/octet-stream")}
        for name in attached
    ]
    return json.dumps(_spell_all(values), ensure_ascii=False).encode("utf-8")


def _spell_all(value: Any) -> Any:
    if isinstance(value, str):
        return replace_uncovered(value)
    if isinstance(value, dict):
        return {key: _spell_all(inner) for key, inner in value.items() if key not in _SCREEN_ONLY}
    if isinstance(value, list | tuple):
        return [_spell_all(inner) for inner in value]
    return value
