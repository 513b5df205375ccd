"""The subject of a report and the software that made it: what a report needs beside the analysis."""

import unicodedata
from dataclasses import dataclass
from typing import Literal

from app.request import LONGEST_CONCLUSION, Conclusion

MAX_TEXT = 200
LONGEST_CODE = 24
"""Of a subject code at the head of a page; the provenance holds it whole."""
_UNSEEN = frozenset({"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"})


@dataclass(frozen=True, slots=True)
class Software:
    """Version and revision as printed in every report."""

    version: str
    revision: str


@dataclass(frozen=True, slots=True)
class ReportSubject:
    """``subject`` is a code, never a name; all texts come from outside and are only ever text.

    ``version`` counts from 1; a later one replaces the one before: ``changes`` name what is different (a
    setting, "input" or "engine"), ``reason`` is what a person said. ``columns`` is the JSON of the column
    profile by which a table was read, "" for none. ``conclusion`` is what a clinician concludes, and
    ``report_id`` is made by :func:`app.report.export.results.identify_report`.
    """

    file_name: str
    subject: str
    side: Literal["left", "right"] | None
    software: Software
    version: int = 1
    reason: str = ""
    changes: tuple[str, ...] = ()
    columns: str = ""
    conclusion: Conclusion | None = None
    report_id: str = ""


def cut_text(text: str, most: int) -> str:
    """Cut what is too long for its place, and show that it was cut."""
    return text if len(text) <= most else text[: most - 1].rstrip() + "…"


def clean_text(text: str) -> str:
    """Take out what cannot be seen (controls, direction marks, surrogates) and cut at 200 characters."""
    return _leave_seen(text)[:MAX_TEXT]


def check_conclusion(text: str) -> str:
    """Take a conclusion of one paragraph or more, each on a line of its own.

    Raises ValueError if nothing of it can be seen.
    """
    paragraphs = clean_paragraphs(text)
    if not paragraphs:
        raise ValueError(f"1 … {LONGEST_CONCLUSION}")
    return "\n".join(paragraphs)


def clean_paragraphs(text: str) -> tuple[str, ...]:
    """Return the paragraphs of a longer text, without what cannot be seen, at most 1,000 characters."""
    lines = (_leave_seen(line).strip() for line in text[:LONGEST_CONCLUSION].splitlines())
    return tuple(line for line in lines if line)


def _leave_seen(text: str) -> str:
    return "".join(c for c in text if unicodedata.category(c) not in _UNSEEN)
