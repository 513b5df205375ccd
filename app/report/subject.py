"""Whose arm it is and which software answers: what a report needs beside the analysis."""

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
    """``subject`` is a code, never a name; both texts come from outside and are only ever text."""

    file_name: str
    subject: str
    side: Literal["left", "right"] | None
    software: Software


def clean_text(text: str) -> str:
    """Take out what cannot be seen (controls, direction marks, surrogates) and cut at 200 characters."""
    seen = "".join(c for c in text if unicodedata.category(c) not in _UNSEEN)
    return seen[:MAX_TEXT]
