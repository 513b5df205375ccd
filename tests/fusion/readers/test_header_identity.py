"""The identity of a table's header: the same names in the same order, whatever the rows hold."""

import gzip
import io

import pytest

from fusion.readers import identify_header

HEADER = "t;a;b;c;d;e;f"


def write_table(header: str, first: int = 0, delimiter: str = ";") -> bytes:
    rows = [f"{10 * k};0.0{k % 9};0.0;1.0;0.1;0.2;0.3" for k in range(first, first + 300)]
    return "\n".join([*([header] if header else []), *rows]).replace(";", delimiter).encode()


def identify(content: bytes) -> str:
    return identify_header(io.BytesIO(content))


@pytest.mark.parametrize(
    "content",
    [
        write_table(HEADER, 500),
        b"# serial: A1\n" + write_table(HEADER),
        gzip.compress(write_table(HEADER)),
    ],
    ids=["other rows", "lines before the header", "packed"],
)
def test_only_the_header_counts(content: bytes) -> None:
    assert identify(content) == identify(write_table(HEADER))


@pytest.mark.parametrize(
    ("header", "delimiter"), [("t;b;a;c;d;e;f", ";"), ("t;a;b;c;d;e;g", ";"), (HEADER, ",")]
)
def test_another_name_order_or_delimiter_is_another_header(header: str, delimiter: str) -> None:
    assert identify(write_table(header, delimiter=delimiter)) != identify(write_table(HEADER))


def test_a_table_without_names_is_known_by_a_dash() -> None:
    assert identify(write_table("")).startswith("-")
    assert not identify(write_table(HEADER)).startswith("-")


@pytest.mark.parametrize("content", [b"", b"not a table", b"\x89PNG\r\n"])
def test_what_is_no_table_has_none(content: bytes) -> None:
    assert identify(content) == ""
