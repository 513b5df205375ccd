"""Columns of a Parquet file, laid out by ourselves.

``pyarrow.array`` and ``pyarrow.table`` load pandas to ask whether a list is one of its columns, which takes
longer than to write the file.
"""

from collections.abc import Sequence

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray


def lay_numbers(values: NDArray[np.float64] | NDArray[np.float32]) -> pa.Array:
    """Give a column of numbers, none of them absent; shape (n,)."""
    close = pa.py_buffer(np.ascontiguousarray(values))
    return pa.Array.from_buffers(pa.from_numpy_dtype(values.dtype), len(values), [None, close])


def lay_flags(flags: NDArray[np.bool_]) -> pa.Array:
    """Give a column of yes and no, none of them absent; shape (n,)."""
    return pa.Array.from_buffers(pa.bool_(), len(flags), [None, _pack(flags)])


def lay_some_numbers(values: Sequence[float | None]) -> pa.Array:
    """Give a column of numbers, None where there is none."""
    filled = np.array([0.0 if value is None else value for value in values], np.float64)
    return pa.Array.from_buffers(pa.float64(), len(filled), [_mark_known(values), pa.py_buffer(filled)])


def lay_some_texts(texts: Sequence[str | None]) -> pa.Array:
    """Give a column of text, None where there is none."""
    encoded = [(text or "").encode("utf-8") for text in texts]
    edges = np.cumsum([0, *map(len, encoded)], dtype=np.int32)
    buffers = [_mark_known(texts), pa.py_buffer(edges), pa.py_buffer(b"".join(encoded))]
    return pa.Array.from_buffers(pa.string(), len(encoded), buffers)


def _mark_known(values: Sequence[object]) -> pa.Buffer:
    return _pack(np.array([value is not None for value in values], np.bool_))


def _pack(flags: NDArray[np.bool_]) -> pa.Buffer:
    return pa.py_buffer(np.packbits(flags, bitorder="little"))
