"""What a report is called outside our folders: the same name wherever it is taken from."""

import re
from collections.abc import Mapping
from typing import Any

_LONGEST = 60


def name_report(results: Mapping[str, Any], version: int, ending: str) -> str:
    """Name a report ``subject_date_side_report_v1.pdf``; what is not known is left out.

    Only signs that every file system takes are kept; without a subject code the file's stem stands first.
    """
    recording = results["recording"]
    whose = recording["subject"] or recording["file_name"].partition(".")[0]
    day = (recording["start"] or "")[:10]
    parts = (_make_safe(whose) or "recording", day, recording["side"] or "", "report", f"v{version}")
    return "_".join(part for part in parts if part) + f".{ending}"


def _make_safe(text: str) -> str:
    return re.sub(r"[^\w .-]+", "-", text)[:_LONGEST].strip(" .-_")
