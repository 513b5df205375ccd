"""The public benchmark: what cannot be measured is named; the page holds what was."""

from pathlib import Path

from benchmarks.public import Bar, Chart, Page, Part, measure_broad, measure_recorded, render


def make_page(*parts: Part) -> str:
    return render(Page("2026-11-25", "acromion 0", {"cores": "2"}, {"vqf": "absent"}, parts))


def test_data_and_packages_that_are_absent_are_named(tmp_path: Path) -> None:
    broad, recorded = measure_broad(tmp_path), measure_recorded(tmp_path, 1)

    page = make_page(broad)
    assert "BROAD recordings (Laidig et al. 2021)" in broad.missing
    assert "real_motion/" in recorded.missing
    assert broad.missing in page
    assert "<dt>vqf</dt><dd>absent</dd>" in page


def test_the_longest_bar_fills_the_width_and_the_others_their_share() -> None:
    chart = Chart("Error", "deg", (Bar("smoothed", 0.5), Bar("VQF", 2.0)))

    page = make_page(Part("x", "X", "", (chart,)))

    assert page.index("width: 25.0%") < page.index("width: 100.0%")
