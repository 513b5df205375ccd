"""The lags of a comparison's clocks in its report: all of a few, an even choice of many."""

import pytest

from app.report.agreement.tables import tabulate_lags
from app.report.model import Table
from app.report.words.wording import load_wording
from fusion.agreement.pairs import WindowLag


def tabulate(count: int) -> Table:
    windows = [WindowLag(10.0 * k, 0.001 * k, 0.99) for k in range(count)]
    return tabulate_lags(windows, load_wording("en", "agreement"), "en")


@pytest.mark.parametrize("count", [0, 1, 12])
def test_a_few_stretches_are_all_shown(count: int) -> None:
    table = tabulate(count)

    assert len(table.rows) == count
    assert "Shown are" not in table.note


def test_of_many_twelve_are_shown_from_the_first_to_the_last() -> None:
    table = tabulate(60)

    # 59 / 11 = 5.36 stretches from one to the next
    places = [0, 5, 11, 16, 21, 27, 32, 38, 43, 48, 54, 59]
    assert [row[0] for row in table.rows] == [str(10 * place) for place in places]
    assert table.note.endswith("Shown are 12 of 60 stretches, evenly spread; validation.json holds them all.")
