"""Packs the small objects of a PDF together, so that the tags of its tables do not make it heavy.

The engine writes each tag as an object of its own, uncompressed, with a line of 20 bytes in the table of
offsets: two thirds of a report with many table cells. Here they lie compressed in one object stream, found by
a cross-reference stream (ISO 32000-1, 7.5.7 and 7.5.8), which PDF/A-3 and PDF/UA-1 allow. The objects
themselves stay as they are, byte for byte.
"""

import re
import struct
import zlib
from collections.abc import Iterable, Iterator
from itertools import pairwise

_LINE_BYTES = 20
_END = re.compile(rb"xref\n0 (\d+)\n(.*)trailer\n<</Size \d+(.*)>>\nstartxref\n\d+\n%%EOF\s*", re.DOTALL)
_OBJECT = re.compile(rb"(\d+) 0 obj\n(.*)\nendobj\s*", re.DOTALL)
_FREE, _PLAIN, _PACKED = range(3)


def pack_objects(document: bytes) -> bytes:
    """Give the same document with every object that is no stream packed into one that is.

    Raises
    ------
    ValueError
        When it is not laid out as our engine lays it out: one table of offsets, no object freed.
    """
    table_at = int(document[document.rindex(b"startxref") :].split()[1])
    end = _END.fullmatch(document, table_at)
    if end is None:
        raise ValueError("no plain table of offsets")
    offsets = _read_offsets(end[2])
    packed: list[tuple[int, bytes]] = []
    places: dict[int, tuple[int, int, int]] = {0: (_FREE, 0, 65535)}
    written = bytearray(document[: min(offsets)])
    size = int(end[1])
    for number, body, whole in _split_objects(document, [*sorted(offsets), table_at]):
        if body.endswith(b"endstream"):
            places[number] = (_PLAIN, len(written), 0)
            written += whole
        else:
            places[number] = (_PACKED, size, len(packed))
            packed.append((number, body))
    places[size] = (_PLAIN, len(written), 0)
    written += _write_object_stream(size, packed)
    places[size + 1] = (_PLAIN, len(written), 0)
    table = _write_table(size + 1, (places[number] for number in range(size + 2)), end[3])
    return bytes(written) + table + b"startxref\n%d\n%%%%EOF\n" % places[size + 1][1]


def _read_offsets(table: bytes) -> list[int]:
    lines = [table[k : k + _LINE_BYTES] for k in range(_LINE_BYTES, len(table), _LINE_BYTES)]
    if any(line[10:18] != b" 00000 n" for line in lines):
        raise ValueError("an object that is free, or was written twice")
    return [int(line[:10]) for line in lines]


def _split_objects(document: bytes, bounds: list[int]) -> Iterator[tuple[int, bytes, bytes]]:
    """Give each object's number, its body and all of it as it stands there."""
    for start, stop in pairwise(bounds):
        found = _OBJECT.fullmatch(document, start, stop)
        if found is None:
            raise ValueError("something between two objects")
        yield int(found[1]), found[2], found[0]


def _write_object_stream(number: int, packed: Iterable[tuple[int, bytes]]) -> bytes:
    heads: list[bytes] = []
    bodies = bytearray()
    for own, body in packed:
        heads.append(b"%d %d" % (own, len(bodies)))
        bodies += body + b"\n"
    head = b" ".join(heads) + b"\n"
    return _write_stream(number, b"/Type/ObjStm/N %d/First %d" % (len(heads), len(head)), head + bodies)


def _write_table(number: int, places: Iterable[tuple[int, int, int]], trailer: bytes) -> bytes:
    rows = b"".join(struct.pack(">BII", *place) for place in places)
    return _write_stream(number, b"/Type/XRef/Size %d/W[1 4 4]%b" % (number + 1, trailer), rows)


def _write_stream(number: int, entries: bytes, content: bytes) -> bytes:
    body = zlib.compress(content, 9)
    head = b"%d 0 obj\n<<%b/Length %d/Filter/FlateDecode>>" % (number, entries, len(body))
    return head + b"\nstream\n" + body + b"\nendstream\nendobj\n\n"
