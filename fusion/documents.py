"""Documents, images and archives by their first bytes, so that a refusal can name them."""

import re

from acromion.fusion.errors import UnknownFormat

HEAD_BYTES = 65_536
DOCUMENTS = tuple(
    (re.compile(pattern, re.DOTALL), name)
    for pattern, name in (
        (rb"%PDF-", "PDF"),
        (rb"\xff\xd8\xff", "JPEG"),
        (rb"\x89PNG", "PNG"),
        (rb"GIF8", "GIF"),
        (rb"II\*\0|MM\0\*", "TIFF"),
        (rb"BM.{4}\0{4}.{4}[\x0c\x28\x34\x38\x40\x6c\x7c]\0{3}", "BMP"),
        (rb"RIFF.{4}WEBP", "WebP"),
        (rb".{4}ftyp", "HEIC/MP4"),
        (rb"\{\\rtf", "RTF"),
        (rb"\xd0\xcf\x11\xe0(?:.{508}\xec\xa5|.*W\0o\0r\0d\0D\0o\0c\0u\0m\0e\0n\0t\0)", "Word (.doc)"),
        (rb"PK\x03\x04.{26}mimetypeapplication/vnd\.oasis\.opendocument\.text", "OpenDocument (.odt)"),
        (rb"PK\x03\x04(?:.*PK\x03\x04)?.{26}word/", "Word (.docx)"),
    )
)
"""Files that no reader can read as a recording."""
MAGIC = (
    (b"\xd0\xcf\x11\xe0", "Excel/Word (.xls, .doc)"),
    (b"MATLAB", "MATLAB (.mat)"),
    (b"\x1f\x8b", "gzip"),
    (b"Rar!", "RAR"),
    (b"7z\xbc\xaf", "7-Zip"),
    (b"SQLite format 3", "SQLite"),
    (b"\x89HDF", "HDF5 (.h5)"),
    (b"PAR1", "Parquet"),
    (b"\x7fELF", "ELF"),
    (b"MZ", "Windows (.exe)"),
)


def find_document(head: bytes) -> str:
    """Return what a photo, a video, a PDF or a text document is called; "" for any other file."""
    return next((name for pattern, name in DOCUMENTS if pattern.match(head)), "")


def refuse_document(head: bytes) -> None:
    """Refuse a photo, a video, a PDF or a text document by its first bytes; raises UnknownFormat."""
    kind = find_document(head)
    if kind:
        raise UnknownFormat(kind=kind)
