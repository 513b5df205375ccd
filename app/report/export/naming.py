"""File names of downloads, the same on every interface, and the ZIP with all files."""

import io
import re
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

_ZIP_EPOCH = (1980, 1, 1, 0, 0, 0)


def pack_files(files: Mapping[str, bytes]) -> bytes:
    """Pack files into one uncompressed ZIP, by name, without times; the same input gives the same bytes."""
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
    """The recording of a file. ``start`` is the first sample in ISO 8601; unknown values are empty."""

    subject: str
    file_name: str
    start: str
    side: str
    version: int


def format_file_name(origin: Origin, kind: str) -> str:
    """Return the name ``subject_date_side_report_v1.fr.pdf`` of the internal ``report.fr.pdf`` (``kind``).

    Unknown parts are omitted; without a subject code the name starts with the file's stem. Only characters
    that every file system accepts are kept.
    """
    whose = origin.subject or origin.file_name.partition(".")[0]
    stem, _, ending = kind.partition(".")
    parts = (_make_safe(whose) or "recording", origin.start[:10], origin.side, stem, f"v{origin.version}")
    return "_".join(part for part in parts if part) + f".{ending}"


def format_report_name(results: Mapping[str, Any], version: int, ending: str) -> str:
    """Return the file name of the report on these results."""
    recording = results["recording"]
    origin = Origin(
        recording["subject"],
        recording["file_name"],
        recording["start"] or "",
        recording["side"] or "",
        version,
    )
    return format_file_name(origin, f"report.{ending}")


def make_safe_name(file_name: str) -> str:
    """Return a person's file name without characters that some file systems reject."""
    return re.sub(r'[<>:"|?*/\\]', "-", file_name).strip(" .") or "recording"


def _make_safe(text: str) -> str:
    return re.sub(r"[^\w .-]+", "-", text)[:_LONGEST].strip(" .-_")
