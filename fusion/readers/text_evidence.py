"""What a table's bytes say about how it was written: encoding, locale, rounding."""

import re
from collections.abc import Sequence

from fusion.readers.columns import choose_vector
from fusion.readers.date_dialects import find_last_date, find_open_date
from fusion.readers.date_order import DateOrder, settle_by_span
from fusion.readers.source import Source, read_chunks
from fusion.readers.text_layout import TextLayout, find_layout, vote_decimal
from fusion.readers.text_stream import TextForm, decode_head
from fusion.readers.unpacking import UnpackedFile
from fusion.recording import QualityFlag
from fusion.units import acc_scale_g

SAMPLE_BYTES = 1 << 15
SAMPLED_PLACES = (0.5, 1.0)
"""Where to look besides the head: the middle and the tail."""
COARSEST_STEP_G = 0.009
"""Half a degree of tilt: an accelerometer's own step is a tenth of it."""


def read_layout(source: Source, form: TextForm, order: DateOrder | None = None) -> TextLayout | None:
    """Understand a table by its head, its middle and its tail.

    Raises
    ------
    fusion.errors.FusionError
        As :func:`fusion.readers.text_layout.find_layout`.
    """
    layout = sniff_layout(source, form, order)
    if layout is None or form.encoding or isinstance(source.file, UnpackedFile):
        return layout
    return vote_decimal(layout, sample_lines(source))


def sniff_layout(source: Source, form: TextForm, order: DateOrder | None = None) -> TextLayout | None:
    """Understand a table by its head; where that leaves day and month open, by its last row too.

    Raises
    ------
    fusion.errors.FusionError
        As :func:`fusion.readers.text_layout.find_layout`.
    """
    head = decode_head(source, form)
    first = find_open_date(head)
    if first and order is None:
        last = find_last_date(_read_tail(source, form))
        order = settle_by_span(first, last) if last else None
    return find_layout(head, order)


def _read_tail(source: Source, form: TextForm) -> str:
    """The last bytes as text; of a packed file by unpacking it, for nothing else leads there."""
    tail = b""
    if isinstance(source.file, UnpackedFile):
        for chunk in read_chunks(source):
            tail = (tail + chunk)[-SAMPLE_BYTES:]
    else:
        source.file.seek(max(0, source.size_bytes - SAMPLE_BYTES) // 2 * 2)
        tail = source.file.read()
    text = tail.decode(form.encoding or "latin-1", errors="replace")
    return text.replace("\r", "\n") if form.is_return_only else text


def sample_lines(source: Source) -> list[str]:
    """Whole lines from the middle and the tail of a file longer than its head."""
    lines: list[str] = []
    if source.size_bytes <= len(source.head):
        return lines
    for place in SAMPLED_PLACES:
        source.file.seek(max(0, round(place * source.size_bytes) - SAMPLE_BYTES))
        lines += source.file.read(SAMPLE_BYTES).decode("latin-1").splitlines()[1:-1]
    return lines


def is_utf8(source: Source) -> bool:
    """Whether the head is UTF-8, a character cut at its end aside."""
    try:
        source.head.decode("utf-8")
    except UnicodeDecodeError as error:
        return error.start >= len(source.head) - 3
    return True


def flag_text(source: Source, form: TextForm, layout: TextLayout) -> tuple[QualityFlag, ...]:
    """Caveats that the writing itself gives."""
    found = {
        "W-ENCODING": form.encoding is not None or not is_utf8(source),
        "W-LOCALE": layout.decimal == ",",
        "W-PRECISION": is_rounded(layout),
    }
    return tuple(QualityFlag(code) for code, is_found in found.items() if is_found)


def is_rounded(layout: TextLayout) -> bool:
    """Whether the acceleration has lost decimals: its steps are coarser than any sensor's."""
    places = choose_vector(layout.columns, "acc")
    scale_g = acc_scale_g(layout.columns[places[0]].unit) if places else None
    if places is None or scale_g is None:
        return False
    fields = [row[place] for row in layout.sample_rows for place in places if place < len(row)]
    decimals = count_decimals(fields)
    return decimals > 0 and scale_g * 10.0**-decimals > COARSEST_STEP_G


def count_decimals(fields: Sequence[str]) -> int:
    """The most decimals that any of the fields shows; 0 for whole numbers and exponents."""
    found = (re.fullmatch(r"[-+]?\d*[.,](\d+)", field) for field in fields)
    return max((len(match.group(1)) for match in found if match), default=0)
