"""Documents, images and archives by their first bytes, so that a refusal can name them."""

import re

from fusion.errors import UnknownFormat

HEAD_BYTES = 65_536
DOCUMENTS = (
    (b"%PDF-", "PDF"),
    (b"\xff\xd8\xff", "JPEG"),
    (b"\x89PNG", "PNG"),
    (b"GIF8", "GIF"),
    (b"II*\0", "TIFF"),
    (b"MM\0*", "TIFF"),
    (b"{\\rtf", "RTF"),
)
"""Files that no reader can read as a recording."""
MAGIC = (
    *DOCUMENTS,
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
MEDIA_MARK, MEDIA = b"ftyp", "HEIC/MP4"
WORD_MEMBER = re.compile(rb"PK\x03\x04.{26}word/", re.DOTALL)


def find_document(head: bytes) -> str:
    """Return what a photo, a video, a PDF or a Word document is called; "" for any other file."""
    if head[4:8] == MEDIA_MARK:
        return MEDIA
    if head.startswith(b"RIFF") and head[8:12] == b"WEBP":
        return "WebP"
    if WORD_MEMBER.search(head):
        return "Word (.docx)"
    return next((name for magic, name in DOCUMENTS if head.startswith(magic)), "")


def refuse_document(head: bytes) -> None:
    """Refuse a photo, a video, a PDF or a Word document by its first bytes; raises UnknownFormat."""
    kind = find_document(head)
    if kind:
        raise UnknownFormat(kind=kind)
