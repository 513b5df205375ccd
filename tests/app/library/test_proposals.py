"""What may not have been worn is proposed, as a row that a diary takes, and never left out by itself."""

from dataclasses import replace
from typing import Any

from app.report.export.results import build_results
from fusion.diary import read_diary
from fusion.exposure.periods import place_diary
from fusion.quality import Quality
from fusion.recording import QualityFlag
from tests.app.analysis_factory import make_analysis, make_subject

FLAG = QualityFlag("W-NONWEAR", 1, 900.0, 600.0, 1500.0, spans_s=((600.0, 1500.0),))


def propose() -> list[dict[str, Any]]:
    quality = Quality("caution", ("W-NONWEAR",), (FLAG,))
    results: dict[str, Any] = build_results(make_analysis(quality=quality), make_subject())
    proposals: list[dict[str, Any]] = results["quality"]["proposals"]
    return proposals


def test_a_stretch_that_may_not_have_been_worn_is_proposed() -> None:
    assert propose() == [{"kind": "not_worn", "start_s": 600.0, "end_s": 1500.0}]


def test_without_such_a_stretch_nothing_is() -> None:
    assert build_results(replace(make_analysis()), make_subject())["quality"]["proposals"] == []  # type: ignore[index]


def test_a_proposal_is_a_row_of_a_diary() -> None:
    (row,) = propose()
    diary = read_diary(f"start_s,end_s,kind\n{row['start_s']},{row['end_s']},{row['kind']}\n".encode())

    (period,) = place_diary(diary, None, 3_600_000_000).periods
    assert (period.start_us, period.end_us, period.reason) == (600_000_000, 1_500_000_000, "not-worn")
