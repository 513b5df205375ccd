"""A packed PDF holds the objects it held before, in less room."""

import io
import zlib
from typing import Any

import pytest
from pypdf import PdfReader

from app.report.pdf_packing import pack_objects

HEAD = b"%PDF-1.7\n%\x80\x80\x80\x80\n\n"
CONTENT = b"BT ET"
OBJECTS = (
    b"<</Type/Catalog/Pages 2 0 R>>",
    b"<</Type/Pages/Count 1/Kids[3 0 R]>>",
    b"<</Type/Page/Parent 2 0 R/MediaBox[0 0 612 792]/Contents 4 0 R>>",
    b"<</Length 5>>\nstream\n" + CONTENT + b"\nendstream",
    b"<</Title(endobj \xff \\) stream)>>",
)


def write_plainly(objects: tuple[bytes, ...], mark: bytes = b"n") -> bytes:
    """Lay a document out as the engine does; ``mark`` is that of every object in the table."""
    document, offsets = HEAD, []
    for number, body in enumerate(objects, 1):
        offsets.append(len(document))
        document += b"%d 0 obj\n%b\nendobj\n\n" % (number, body)
    lines = b"".join(b"%010d 00000 %b \n" % (offset, mark) for offset in offsets)
    size = len(objects) + 1
    table = b"xref\n0 %d\n0000000000 65535 f \n%b" % (size, lines)
    trailer = b"trailer\n<</Size %d/Root 1 0 R/Info 5 0 R/ID[(a)(a)]>>\n" % size
    return document + table + trailer + b"startxref\n%d\n%%%%EOF" % len(document)


def trailer_of(document: bytes) -> Any:
    return read(document).trailer


def read(document: bytes) -> PdfReader:
    return PdfReader(io.BytesIO(document), strict=True)


def write(document: PdfReader, number: int) -> bytes:
    """Write an object out, as the reader understood it."""
    written = io.BytesIO()
    found = document.get_object(number)
    assert found is not None
    found.write_to_stream(written)
    return written.getvalue()


def test_every_object_is_as_it_was() -> None:
    plain = write_plainly(OBJECTS)

    packed = pack_objects(plain)

    before, after = read(plain), read(packed)
    assert [write(after, k) for k in range(1, 6)] == [write(before, k) for k in range(1, 6)]
    assert after.pages[0].get_contents().get_data() == CONTENT  # type: ignore[union-attr]


def test_the_trailer_names_root_facts_and_identity() -> None:
    trailer = trailer_of(pack_objects(write_plainly(OBJECTS)))

    assert (trailer.raw_get("/Root").idnum, trailer.raw_get("/Info").idnum) == (1, 5)
    assert [str(name) for name in trailer["/ID"]] == ["a", "a"]


def test_objects_that_are_no_streams_are_compressed_together() -> None:
    packed = pack_objects(write_plainly(OBJECTS))

    body = packed.partition(b"/Type/ObjStm/N 4/First")[2].partition(b"stream\n")[2]
    assert b"/Type/Catalog" not in packed
    assert zlib.decompressobj().decompress(body).startswith(b"1 0 2 30 3 66 5 131\n")


def test_the_same_document_is_packed_into_the_same_bytes() -> None:
    plain = write_plainly(OBJECTS)

    assert pack_objects(plain) == pack_objects(plain)


@pytest.mark.parametrize(
    "document",
    [
        write_plainly(OBJECTS, b"f"),
        write_plainly(OBJECTS).replace(b"endobj\n\n2", b"endobj\n%\n2"),
        write_plainly(OBJECTS).replace(b"xref\n0 6\n", b"xref\n1 6\n"),
    ],
    ids=["an object that is freed", "a remark between objects", "a table that begins at 1"],
)
def test_a_document_laid_out_otherwise_is_refused(document: bytes) -> None:
    with pytest.raises(ValueError, match=r"."):
        pack_objects(document)
