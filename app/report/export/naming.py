"""What a file of ours is called outside our folders: the same name wherever it is taken from."""

import io
import re
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

# Everything of one analysis as one ZIP. Small: a process that only hands out files need not know more.


_ZIP_EPOCH = (1980, 1, 1, 0, 0, 0)


def pack_files(files: Mapping[str, bytes]) -> bytes:
    """Put files into one ZIP: in order of name, without times, stored as they are; same in, same out."""
    body = io.BytesIO()
    with zipfile.ZipFile(body, "w", zipfile.ZIP_STORED) as archive:
        for name in sorted(files):
            entry = zipfile.ZipInfo(name, _ZIP_EPOCH)
            entry.create_system, entry.external_attr = 3, 0o644 << 16
            archive.writestr(entry, files[name])
    return body.getvalue()


_LONGEST = 60


@dataclass(frozen=True, slots=True)
class Origin:
    """What a file is of. ``start`` is the first sample in ISO 8601; what is not known is empty."""

    subject: str
    file_name: str
    start: str
    side: str
    version: int


def format_file_name(origin: Origin, kind: str) -> str:
    """Name a file ``subject_date_side_report_v1.fr.pdf``; ``kind`` is our own name for it, ``report.fr.pdf``.

    What is not known is left out; without a subject code the file's stem stands first. Only signs that every
    file system takes are kept.
    """
    whose = origin.subject or origin.file_name.partition(".")[0]
    stem, _, ending = kind.partition(".")
    parts = (_make_safe(whose) or "recording", origin.start[:10], origin.side, stem, f"v{origin.version}")
    return "_".join(part for part in parts if part) + f".{ending}"


def format_report_name(results: Mapping[str, Any], version: int, ending: str) -> str:
    """Name the report of what ``results.json`` holds."""
    told = results["recording"]
    origin = Origin(told["subject"], told["file_name"], told["start"] or "", told["side"] or "", version)
    return format_file_name(origin, f"report.{ending}")


def _make_safe(text: str) -> str:
    return re.sub(r"[^\w .-]+", "-", text)[:_LONGEST].strip(" .-_")
