"""Results as pandas tables."""

import pytest

from fusion import analyse, tabulate_elevation, tabulate_exposure
from fusion.pipeline import Analysis
from tests.factories import hold


@pytest.fixture(scope="module")
def analysis() -> Analysis:
    return analyse(hold((0, 60), (75, 60)).recording)


def test_the_angle_table_has_a_row_for_each_sample(analysis: Analysis) -> None:
    table = tabulate_elevation(analysis)

    assert list(table.columns) == ["time_s", "elevation_deg", "valid"]
    assert table["time_s"].iloc[[0, -1]].tolist() == [0.0, pytest.approx(119.99)]


def test_the_angle_table_of_a_series_is_that_of_its_analysis(analysis: Analysis) -> None:
    assert tabulate_elevation(analysis.elevation).equals(tabulate_elevation(analysis))


def test_the_shares_of_the_bins_add_up_to_the_day(analysis: Analysis) -> None:
    bins = tabulate_exposure(analysis.exposure)["bins"]

    assert bins["percent"].sum() == pytest.approx(100)
    assert bins.loc[bins["lower_deg"] == 60, "percent"].item() == pytest.approx(50, abs=0.5)


def test_ranges_stand_in_columns_of_their_own() -> None:
    half_an_hour = analyse(hold((0, 900), (75, 900)).recording)

    above = tabulate_exposure(half_an_hour.exposure)["time_above"]

    assert (above["low"] <= above["percent"]).all()


def test_percentiles_are_numbered(analysis: Analysis) -> None:
    table = tabulate_exposure(analysis.exposure)["percentiles_deg"].set_index("percentile")

    assert table.loc[90, "angle_deg"] == pytest.approx(75, abs=1)


def test_speeds_are_named_by_their_kind(analysis: Analysis) -> None:
    assert "inclination" in set(tabulate_exposure(analysis.exposure)["velocity_dps"]["kind"])
