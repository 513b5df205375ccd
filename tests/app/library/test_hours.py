"""The hours of a day as the page lists them."""

from app.web.recording.analysis import pair_tasks
from app.web.recording.day import build_hours


def test_an_hour_of_which_nothing_was_analysed_has_no_figures() -> None:
    begun = {"label": "2026-03-02T15:00", "analysed_s": 0.0, "entries_above_60_per_h": None}

    (row,) = build_hours({"exposure": {"by_hour": [begun]}}, "en")

    assert row == ("2026-03-02 15:00", "0\u202fs", "–", "–", "–")


def test_an_hour_has_its_median_its_p90_and_its_time_above_60_deg() -> None:
    hour = {
        "label": "2026-03-02T07:00",
        "analysed_s": 3600.0,
        "elevation_p50_deg": 21.0,
        "elevation_p90_deg": 48.0,
        "time_above_60_percent": 5.0,
    }

    (row,) = build_hours({"exposure": {"by_hour": [hour]}}, "en")

    assert [cell.replace("\u202f", " ").replace("\u00a0", " ") for cell in row[1:]] == [
        "1 h",
        "21°",
        "48°",
        "5.0 %",
    ]


def test_a_task_of_which_nothing_was_analysed_has_no_figure() -> None:
    idle = {"exposure": {"by_task": [{"kind": "task", "label": "A", "analysed_s": 0.0}]}}
    busy = {"exposure": {"by_task": [{"kind": "task", "label": "A", "time_above_60_percent": 5.0}]}}

    ((_, before, after),) = pair_tasks(idle, busy, "en")

    assert (before, after.replace("\u202f", " ")) == ("–", "5.0 %")
