"""Columns laid out by ourselves hold what they were given."""

import numpy as np
import pyarrow as pa
import pytest

from app.report.export.parquet import lay_flags, lay_numbers, lay_some_numbers, lay_some_texts


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_numbers_keep_their_type(kind: type) -> None:
    column = lay_numbers(np.array([0.5, -1.25, 180.0], kind))

    assert column.equals(pa.array([0.5, -1.25, 180.0], pa.from_numpy_dtype(kind)))


def test_every_second_number_of_a_longer_array_is_laid_close() -> None:
    column = lay_numbers(np.arange(6.0)[::2])

    assert column.to_pylist() == [0.0, 2.0, 4.0]


def test_more_flags_than_a_byte_holds_stay_in_order() -> None:
    flags = [True, False, False, True, True, False, True, False, True]

    assert lay_flags(np.array(flags)).to_pylist() == flags


def test_a_number_that_is_not_there_is_null() -> None:
    column = lay_some_numbers([1.5, None, 3])

    assert column.equals(pa.array([1.5, None, 3.0], pa.float64()))


def test_a_text_that_is_not_there_is_null_and_an_empty_one_is_empty() -> None:
    column = lay_some_texts(["é", None, "", "S012"])

    assert column.equals(pa.array(["é", None, "", "S012"], pa.string()))
