"""Results as pandas tables."""

import pytest

from acromion.fusion import AnalysisSettings, DiaryEntry, analyse, tabulate_elevation, tabulate_exposure
from acromion.fusion.pipeline import Analysis
from tests.factories import hold


@pytest.fixture(scope="module")
def analysis() -> Analysis:
    return analyse(hold((0, 900), (75, 900), rate_hz=25.0).recording)


def test_the_angle_table_has_a_row_for_each_sample(analysis: Analysis) -> None:
    table = tabulate_elevation(analysis)

    assert list(table.columns) == ["time_s", "elevation_deg", "valid"]
    assert table["time_s"].iloc[[0, -1]].tolist() == [0.0, pytest.approx(1799.96)]
    assert tabulate_elevation(analysis.elevation).equals(table)


def test_the_shares_of_the_bins_add_up_to_the_day(analysis: Analysis) -> None:
    bins = tabulate_exposure(analysis.exposure)["bins"]

    assert bins["percent"].sum() == pytest.approx(100)
    assert bins.loc[bins["lower_deg"] == 60, "percent"].item() == pytest.approx(50, abs=0.5)


def test_percentiles_are_numbered_speeds_named_and_ranges_in_columns(analysis: Analysis) -> None:
    tables = tabulate_exposure(analysis.exposure)

    percentiles = tables["percentiles_deg"].set_index("percentile")
    assert percentiles.loc[90, "angle_deg"] == pytest.approx(75, abs=1)
    assert "inclination" in set(tables["velocity_dps"]["kind"])
    assert (tables["time_above"]["low"] <= tables["time_above"]["percent"]).all()


def test_a_part_of_the_day_has_the_columns_of_the_tables_and_each_end_of_a_range_as_a_number() -> None:
    lifting = DiaryEntry(0.0, 1800.0, "task", "Lifting")
    day = analyse(hold((0, 1800), (75, 1800), rate_hz=25.0).recording, AnalysisSettings(diary=(lifting,)))

    task = tabulate_exposure(day.exposure)["by_task"].set_index("label").loc["Lifting"]

    (part,) = (one for one in day.exposure.by_task if one.label == "Lifting")
    interval = part.intervals["time_above_60_percent"]
    assert task["time_above_60_percent"] == part.time_above_percent[60]
    assert (task["time_above_60_percent_low"], task["time_above_60_percent_high"]) == (
        interval.low,
        interval.high,
    )
    assert not [name for name, value in task.items() if isinstance(value, dict)]
