"""The fast path reads every number exactly as Python does, or leaves it to the careful one."""

import hashlib
import io
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from acromion.fusion.readers.samples import SampleColumns, open_rows
from acromion.fusion.readers.source import HashedFile, open_source
from acromion.fusion.readers.tables.csv_lines import (
    NOT_PLAIN,
    fold_words,
    gather_words,
    spread_mark,
    take_plain,
)
from acromion.fusion.readers.tables.layout import decode_head, find_layout, read_line_pieces
from acromion.fusion.readers.tables.rows import plan_table, read_table
from acromion.fusion.readers.time.grid import fit_line
from tests.fusion.readers.tables.table_builder import HEADER

NO_HOLES = np.empty(0, np.int64)
POINT = spread_mark(ord("."))


def pad(text: str) -> NDArray[np.uint8]:
    return np.frombuffer(b"7" * 20 + text.encode() + b"," + b"8" * 70, np.uint8)


def take(text: str) -> tuple[int, int]:
    padded = pad(text)
    return take_plain(padded, 20, 20 + len(text), POINT)


@pytest.mark.parametrize(
    "text", ["", "-", ".", "-.", "+1", "1e5", "1.2.3", "12a", "--1", "1-", "1/2", "1:2", "12345678901234567"]
)
def test_what_is_not_plain_is_left_to_the_careful_path(text: str) -> None:
    assert take(text)[1] == NOT_PLAIN


@given(
    whole=st.integers(0, 10**8 - 1),
    fraction=st.text("0123456789", min_size=1, max_size=7),
    minus=st.booleans(),
)
def test_a_plain_number_is_the_double_that_python_reads(whole: int, fraction: str, minus: bool) -> None:
    text = f"{'-' if minus else ''}{whole}.{fraction}"

    mantissa, decimals = take(text)

    assert mantissa / 10**decimals == float(text)


@given(text=st.text("0123456789.,-+e /:;", min_size=1, max_size=14), decimals=st.integers(1, 7))
@settings(deadline=None)
def test_a_foreseen_number_of_decimals_changes_no_value(text: str, decimals: int) -> None:
    padded, fields = pad(text), np.array([19, 20 + len(text)], np.int32)
    form: Any = (np.uint64(POINT), 10.0**decimals, 1.0)
    words, folded = np.empty((4, 1), np.uint64), np.empty(1)

    gather_words(padded, fields, (1, 0), decimals, words)
    is_foreseen = fold_words(words, decimals, form, folded)

    mantissa, found = take(text)
    assert not is_foreseen or (folded[0], decimals) == (mantissa / 10.0**found, found)


NUMBERS = st.one_of(
    st.integers(-(10**10), 10**10).map(lambda micro: f"{micro / 1e6:.6f}"),
    st.floats(-2000, 2000, allow_subnormal=False).map(repr),
    st.sampled_from(
        [
            "1",
            "-0.5",
            " 1.25",
            "+3",
            "1e-3",
            "2.5E+1",
            '"7.5"',
            "-.5",
            "5.",
            "00012.50",
            "5.35E-05",
            "0.99999999999999999999999",
        ]
    ),
)
RESTING = "".join(f"{10_000 * k},0,1,0.0{k % 7},0.{k % 5},0.{k % 3},0.{k % 4}\n" for k in range(60))


@given(fields=st.lists(NUMBERS, min_size=18, max_size=18))
@settings(max_examples=50, suppress_health_check=[HealthCheck.too_slow])
def test_a_table_holds_the_floats_that_python_reads(fields: list[str]) -> None:
    rows = [fields[k : k + 6] for k in range(0, 18, 6)]
    lines = "".join(f"{600_000 + 10_000 * k},{','.join(row)}\n" for k, row in enumerate(rows))

    columns = parse(HEADER + "\n" + RESTING + lines)

    expected = np.array([[float(field.strip(' "')) for field in row] for row in rows]).astype(np.float32)
    assert np.array_equal(np.hstack([columns.acc, columns.gyr])[60:63], expected)


@given(
    seed=st.integers(0, 2**32 - 1),
    decimals=st.integers(0, 8),
    odd=st.lists(st.tuples(st.integers(0, 699), st.integers(0, 5), NUMBERS), max_size=3),
    end=st.sampled_from(["\n", "\r\n"]),
)
@settings(max_examples=25, suppress_health_check=[HealthCheck.too_slow])
def test_blocks_of_alike_numbers_hold_the_floats_that_python_reads(
    seed: int, decimals: int, odd: list[tuple[int, int, str]], end: str
) -> None:
    values = np.random.default_rng(seed).uniform(-1.0, 1.0, (700, 6)) * 10.0 ** np.arange(-2, 4)
    fields = [[f"{value:.{decimals}f}" for value in row] for row in values]
    for row, column, number in odd:
        fields[row][column] = number
    lines = [f"{10_000 * k},{','.join(row)}" for k, row in enumerate(fields)]

    columns = parse(end.join([HEADER, *lines, ""]))

    expected = np.array([[float(field.strip(' "')) for field in row] for row in fields])
    assert np.array_equal(np.hstack([columns.acc, columns.gyr]), expected.astype(np.float32))


PIECES = 40_000
"""Rows that fill several of the pieces in which a table is read."""


def write_pieces(stamped: bool) -> tuple[str, NDArray[np.float32]]:
    """Write rows of which some are not plain, in the middle of pieces; give the text and its readings."""
    milli = np.random.default_rng(4).integers(-9999, 9999, (PIECES, 6))
    header = HEADER if stamped else HEADER.removeprefix("time_us,")
    lines = [header]
    for k, row in enumerate(milli.tolist()):
        fields = [f"{value / 1e3:.3f}" for value in row]
        if k % 9001 == 8000:
            fields[2] = f'"{fields[2]}"'
        lines.append(",".join([str(10_000 * k), *fields] if stamped else fields))
    return "\n".join([*lines, ""]), (milli / 1e3).astype(np.float32)


@pytest.mark.parametrize(("stamped", "step"), [(True, 10_000), (False, 1)], ids=["stamped", "numbered"])
def test_rows_of_many_pieces_stand_in_the_order_of_their_lines(stamped: bool, step: int) -> None:
    text, readings = write_pieces(stamped)

    columns = parse(text)

    assert np.array_equal(columns.stamps, step * np.arange(PIECES))
    assert np.array_equal(np.hstack([columns.acc, columns.gyr]), readings)


def test_a_return_inside_a_line_is_no_end_of_a_field() -> None:
    text = RESTING.replace("\n", "\r\n").replace("100000,0,1,", "100000,0\r1,")

    columns = parse(HEADER + "\r\n" + text)

    assert columns.stamps.tolist() == [10_000 * k for k in range(60) if k != 10]


def parse(text: str) -> SampleColumns:
    source = open_source(io.BytesIO(text.encode()), "shift.csv")
    layout = find_layout(decode_head(source))
    assert layout is not None
    return read_table(source, plan_table(layout)).columns


@given(
    lines=st.lists(st.text("0123456789,.", max_size=40), min_size=1, max_size=30),
    sizes=st.lists(st.integers(1, 200), min_size=1, max_size=20),
)
def test_pieces_of_lines_are_the_lines_wherever_the_bytes_are_cut(lines: list[str], sizes: list[int]) -> None:
    content = "\n".join([*lines, "end"]).encode()
    edges = [0, *np.cumsum(sizes * (len(content) // sum(sizes) + 1)).tolist()]
    pieces = [content[a:b] for a, b in pairwise(edges) if a < len(content)]

    read = b"".join(
        bytes(piece.buffer[piece.first_byte : piece.stop_byte].tobytes())
        for piece in read_line_pieces(pieces)
    )

    assert read == content + b"\n"


def test_the_fit_of_a_month_of_stamps_keeps_its_digits() -> None:
    period_us = 2010.0312345
    stamps = np.round(np.arange(2_000_000) * period_us).astype(np.int64) + 1_772_438_400_000_000

    offset_us, fitted_us, rms_us = fit_line(stamps, NO_HOLES, NO_HOLES)

    assert fitted_us == pytest.approx(period_us, abs=1e-9)
    assert offset_us == pytest.approx(0.0, abs=0.01)
    assert rms_us == pytest.approx(12**-0.5, rel=0.01)  # whole microseconds, evenly rounded


def test_rows_that_are_bridged_do_not_bend_the_fit() -> None:
    places = np.delete(np.arange(1000, dtype=np.int64), [300, 301, 700])

    offset_us, period_us, rms_us = fit_line(10_000 * places, np.array([300, 698]), np.array([2, 1]))

    assert (offset_us, period_us, rms_us) == pytest.approx((0.0, 10_000.0, 0.0), abs=1e-6)


def test_rows_are_put_in_by_linear_interpolation_in_place() -> None:
    values = np.zeros((8, 3), np.float32)
    values[:5, 1] = [0.0, 1.0, 4.0, 5.0, 7.0]

    open_rows(values, 5, np.array([2, 4]), np.array([2, 1]))

    assert values[:, 1].tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]


def test_a_hole_copies_no_segment() -> None:
    columns = SampleColumns()
    columns.rows = 1000
    columns.acc[:1000] = np.arange(3000).reshape(-1, 3)
    block = columns.acc

    columns.open_holes(np.array([500]), np.array([3]))

    assert columns.acc is block
    assert columns.rows == 1003
    assert columns.acc[1002].tolist() == [2997.0, 2998.0, 2999.0]


@pytest.mark.parametrize(
    "steps", [[(0, -1)], [(0, 10), (0, 300_000), (5, 400_000)], [(900_000, 10), (0, 600_000)]]
)
def test_a_file_read_in_any_order_has_the_digest_of_its_bytes(steps: list[tuple[int, int]]) -> None:
    content = bytes(range(256)) * 4000
    file = HashedFile(io.BytesIO(content))
    for at, size in steps:
        file.seek(at)
        file.read(size)

    assert file.finish() == hashlib.sha256(content).hexdigest()
