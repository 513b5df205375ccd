"""The drawings: what stands where, and that grey paper loses nothing."""

import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from datetime import datetime
from html import escape
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from acromion.app.report.charts.bars import Slice, draw_bar
from acromion.app.report.charts.day import (
    Day,
    DayLabels,
    Mark,
    MinuteBand,
    build_day_labels,
    build_timeline,
    build_two_days,
    draw_day,
    merge_spans,
)
from acromion.app.report.charts.distribution import build_two_curves
from acromion.app.report.charts.svg import RAMP
from acromion.app.report.several.charts import Visit, VisitPanel, draw_visits
from acromion.app.report.words.numbers import Clock
from acromion.app.report.words.wording import load_wording
from acromion.fusion.caveats import Caveat
from acromion.fusion.recording import QualityFlag, Span
from tests.app.analysis_factory import START, make_analysis, make_exposure
from tests.app.report.report_reading import plain

LABELS = DayLabels("Day", "What", "band", "median", "left out", "no data", "worst")
SVG = "{http://www.w3.org/2000/svg}"


def day_of() -> Day:
    return build_timeline(make_analysis(), Clock(START, "en"), load_wording("en"))


def words_in(svg: str) -> list[str]:
    return [element.text or "" for element in ET.fromstring(svg).iter(f"{SVG}text")]


def slices_of(*percents: float) -> list[Slice]:
    return [Slice(p, f"{k}–{k + 1}°", "1 h", f"{p:.1f} %") for k, p in enumerate(percents)]


def widths_in(svg: str) -> list[float]:
    return [
        float(r.attrib["width"]) for r in ET.fromstring(svg).iter(f"{SVG}rect") if r.get("class") == "bar"
    ]


def test_the_parts_of_the_bar_are_as_long_as_their_shares() -> None:
    assert widths_in(draw_bar(slices_of(50, 25, 25, 0, 0), ("t", "d"), 401)) == [200, 100, 100]


@given(st.lists(st.floats(0.01, 100), min_size=5, max_size=5))
def test_the_bar_is_always_as_long_as_the_sheet(parts: list[float]) -> None:
    percents = [100 * part / sum(parts) for part in parts]

    assert abs(sum(widths_in(draw_bar(slices_of(*percents), ("t", "d"), 681))) - 680) < 0.5


def test_each_step_of_the_ramp_is_clearly_darker_in_grey() -> None:
    grey = [sum(w * int(c[k : k + 2], 16) for w, k in ((0.3, 1), (0.59, 3), (0.11, 5))) for c in RAMP]

    assert all(lighter - darker >= 25 for lighter, darker in pairwise(grey))


def test_breaks_and_hole_are_marked_and_named() -> None:
    marks = [(mark.start_s, mark.end_s, mark.kind, mark.label) for mark in day_of().marks]

    assert marks == [
        (7200.0, 8100.0, "left out", "break"),
        (14400.0, 16200.0, "left out", "break"),
        (20400.0, 20940.0, "missing", "no data"),
    ]


def test_the_legend_names_the_known_reasons_that_have_no_space_in_the_plot() -> None:
    day, labels = day_of(), build_day_labels("Day", "What", load_wording("en"))
    narrow = [Mark(60.0, 120.0, "left out", label) for label in ("sensor stuck", "a word of the diary")]

    words = words_in(draw_day(replace(day, marks=(*day.marks, *narrow)), labels, 680))

    assert "not analysed: sensor stuck" in words
    assert "not analysed" in words_in(draw_day(day, labels, 680))  # the breaks have their labels


def test_time_with_samples_that_is_not_trusted_is_not_named_missing() -> None:
    flag = QualityFlag(Caveat.UNTRUSTED, 1, 540.0, spans_s=((20400.0, 20940.0),))
    analysis = make_analysis()
    quality = replace(analysis.quality, flags=(flag,))

    day = build_timeline(replace(analysis, quality=quality), Clock(START, "en"), load_wording("en"))

    assert (day.marks[-1].kind, day.marks[-1].label) == ("left out", "direction not trusted")


def test_the_day_falls_into_unbroken_runs() -> None:
    assert [(run[0].start_s, run[-1].end_s) for run in day_of().runs] == [
        (0.0, 7200.0),
        (8100.0, 14400.0),
        (16200.0, 20400.0),
        (20940.0, 28740.0),
    ]


def test_stretches_of_one_reason_that_touch_are_one() -> None:
    spans = [
        Span(0, 2_000_000, "clipped"),
        Span(1_000_000, 2_000_000, "clipped"),
        Span(1_000_000, 1, "docked"),
    ]

    assert merge_spans(spans) == [(0.0, 3.0, "clipped"), (1.0, 1.000001, "docked")]


def test_the_axis_has_whole_hours_and_the_guides_are_named() -> None:
    words = words_in(draw_day(day_of(), LABELS, 680))

    assert [word for word in words if ":" in word] == [f"{hour:02d}:00" for hour in range(8, 16)]
    assert {"30°", "60°", "90°"} <= set(words)


def test_the_most_loaded_window_is_bracketed_where_it_is() -> None:
    path = re.search(
        r'd="M([\d.]+) [\d.]+V[\d.]+H([\d.]+)V[\d.]+" class="accent-line"', draw_day(day_of(), LABELS, 680)
    )
    assert path is not None

    left, right = (36 + 640 * seconds / 28740 for seconds in (18420, 19320))

    assert np.allclose([float(path[1]), float(path[2])], [left, right], atol=0.06)


@pytest.mark.parametrize(("deg", "shown", "absent"), [(40, "90°", "120°"), (95, "120°", "150°")])
def test_two_curves_end_where_both_have_reached_all_of_the_time(deg: int, shown: str, absent: str) -> None:
    low, high = (make_exposure(), make_exposure())
    for exposure, angle in ((low, 10), (high, deg)):
        exposure.histogram_s[:] = 0.0
        exposure.histogram_s[angle * 10] = 60.0

    chart = build_two_curves([("a", low), ("b", high)], load_wording("en", "pairs")["curves"], "en")

    words = words_in(chart.wide)
    assert (shown in words, absent in words) == (True, False)


@pytest.mark.parametrize(("high_deg", "has_180"), [(119.0, False), (121.0, True)])
def test_two_days_share_a_scale_that_ends_at_120_unless_a_band_is_higher(
    high_deg: float, *, has_180: bool
) -> None:
    run = (MinuteBand(0.0, 60.0, 5.0, 20.0, high_deg),)
    days = [
        (name, Day(60.0, Clock(START, "en"), runs, (), None)) for name, runs in (("a", (run,)), ("b", ()))
    ]
    words = load_wording("en")

    chart = build_two_days(days, load_wording("en", "pairs")["days"], words)

    assert ("180°" in words_in(chart.wide)) == has_180


def test_the_narrow_drawing_is_another_one_with_its_own_ids() -> None:
    ids = [set(re.findall(r'id="([^"]+)"', draw_day(day_of(), LABELS, width))) for width in (680, 330)]

    assert ids[0] & ids[1] == set()


@given(st.text())
def test_labels_are_only_text(label: str) -> None:
    printable = "".join(c for c in label if c.isprintable())

    plain, svg = (
        draw_bar([Slice(100, words, "1 h", "x")], (words, words), 680) for words in ("a", printable)
    )

    assert [e.tag for e in ET.fromstring(svg).iter()] == [e.tag for e in ET.fromstring(plain).iter()]
    assert escape(printable) in svg


def test_below_the_time_axis_the_first_time_of_each_date_has_its_date() -> None:
    start = datetime.fromisoformat("2026-03-02T22:30:00")
    day = Day(4 * 3600.0, Clock(start, "en", 4 * 3600.0), (), (), None)

    words = [plain(word) for word in words_in(draw_day(day, LABELS, 680))]

    assert words.index("2 March") == words.index("22:30") + 1
    assert words.index("3 March") == words.index("00:00") + 1
    assert words.count("3 March") == 1


@pytest.mark.parametrize(
    ("days", "dates"),
    [
        ((2,), ["2026-03-02"]),
        ((2, 30), ["2026-03-02", "2026-03-30"]),
        ((2, 3, 4), ["2026-03-02 – 2026-03-04"]),  # of the other arm, until the 30th
    ],
)
def test_the_dates_of_an_arm_name_its_first_and_last_day(days: tuple[int, ...], dates: list[str]) -> None:
    left, right = (
        [Visit(datetime(2026, 3, day, 7), 5.0, None, False) for day in chosen]  # noqa: DTZ001  a device's clock
        for chosen in (days, (2, 30))
    )
    panels = [VisitPanel("Left arm", left, None), VisitPanel("Right arm", right, None)]

    words = words_in(draw_visits(panels, load_wording("en", "days"), "en").narrow)

    upper = words[: words.index("Right arm")]
    assert [word for word in upper if word.startswith("2026")] == dates
