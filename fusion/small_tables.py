"""Small tables that people type: diaries, lists of participants. Any delimiter, any of two encodings."""

import csv
import io
import re
import unicodedata
from collections.abc import Iterator


def decode_text(content: bytes) -> str:
    """Read UTF-8, or else what older spreadsheets write."""
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("cp1252", errors="replace")


def list_rows(text: str) -> Iterator[tuple[int, list[str]]]:
    """Give the rows that say something, with their line from 1; lines that begin with # are remarks.

    A line may end as on any system, also as on old Macs, and a cell may be as long as the table.
    """
    first = next((line for line in text.splitlines() if line.strip() and not line.startswith("#")), "")
    delimiter = max((";", "\t", ","), key=first.count)
    csv.field_size_limit(max(csv.field_size_limit(), len(text)))
    reader = csv.reader(io.StringIO(text, newline=None), delimiter=delimiter)
    for cells in reader:
        told = [cell.strip() for cell in cells]
        if any(told) and not told[0].startswith("#"):
            yield reader.line_num, told


def plain_word(word: str) -> str:
    """Give a word without case, accents, underscores and hyphens."""
    letters = unicodedata.normalize("NFKD", word.casefold())
    return re.sub(r"[\s_-]+", " ", "".join(c for c in letters if not unicodedata.combining(c))).strip()
