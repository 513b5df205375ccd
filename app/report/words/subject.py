"""The subject of a report and the software that made it: what a report needs beside the analysis."""

import unicodedata
from dataclasses import dataclass
from typing import Literal

MAX_TEXT = 200
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
    profile by which a table was read, "" for none.
    """

    file_name: str
    subject: str
    side: Literal["left", "right"] | None
    software: Software
    version: int = 1
    reason: str = ""
    changes: tuple[str, ...] = ()
    columns: str = ""


def cut_text(text: str, most: int) -> str:
    """Cut what is too long for its place, and show that it was cut."""
    return text if len(text) <= most else text[: most - 1].rstrip() + "…"


def clean_text(text: str) -> str:
    """Take out what cannot be seen (controls, direction marks, surrogates) and cut at 200 characters."""
    seen = "".join(c for c in text if unicodedata.category(c) not in _UNSEEN)
    return seen[:MAX_TEXT]
