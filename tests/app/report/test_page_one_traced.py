"""Each number printed on page 1 is a field of results.json, a published value, or a mark of a scale."""

import io
import json
import re
from dataclasses import replace
from datetime import datetime, timedelta
from functools import cache
from math import hypot, sqrt
from typing import Any

import pytest
from pypdf import PdfReader

from acromion.app.report.export.results import encode_results
from acromion.app.report.render.pdf import render_pdf
from acromion.app.report.single.report import build_report
from acromion.app.report.words.wording import Language
from acromion.fusion.exposure.types import Exposure, Interval
from tests.app.analysis_factory import make_analysis, make_exposure, make_subject, with_diary
from tests.app.report.report_reading import plain

SCALES = {"0°", "30°", "60°", "90°", "120°", "180°", "0 100 %", "0 40 %", "0 20 %", "0 120°/s", "0 40 %10 %"}
PUBLISHED = {
    *("50 %", "10 %", "60°/s", "1.0–2.8 %"),
    "95 % ranges; days: hairdressers, Wahlström 2010.",
    "50 %, 10 %, 60°/s: proposed upper values of a workday (Arvidsson 2021), not limits.",
}
"""Arvidsson et al. 2021: 50 % above 30°, 10 % above 60°, 60°/s; Lewis et al. 2026: 1.0 to 2.8 % above 90°."""
NAMES = {
    "Arm Elevation Profile Upper arm: 0° hanging, 90° level, 180° overhead",
    *("Above 30°", "Above 60°", "Above 90°", "Time above 60°: how certain?"),
    *("middle 80 % median not analysed no data", "Time Above 60° Task (write in)"),
    *("Task Above 60° Share", "Tasks most above 60°", "Quarter hours most above 60°"),
    "ActiGraph GT9X Link",
    "pose error up to 15° low",
}
WRAPPED = {
    "No proposal; means of 4 trades, workers over 50 (Lewis 2026)",
    "2. Next time, calibrate leaning sideways, arm hanging free (error 2°).",
}
"""Fixed words over several lines."""
STANDINGS = {
    "below": "Below {}",
    "above": "Above {}",
    "cannot tell": "Below {}? Cannot tell",
}
IN_WORDS = {
    "below": "below the proposed 10 %.",
    "above": "above the proposed 10 %.",
    "cannot tell": "cannot tell whether this is below the proposed 10 %.",
}
BETWEEN_DAYS = 1.96 * 2.0
"""Wahlström et al. 2010: 2.0 points between the days of one hairdresser."""


def make_day(*, diary: bool = False, is_pose_off: bool = False) -> Exposure:
    """Make a day; with ``is_pose_off`` the known error of the pose reaches beyond the sampling range."""
    exposure = make_exposure()
    pose = {30: (20.0, 48.6), 60: (5.2, 14.7), 90: (1.4, 6.4)} if is_pose_off else {}
    sampled = {30: (20.0, 41.3), 60: (5.2, 9.9), 90: (1.4, 3.0)}
    shares = {deg: Interval(*ends, *pose.get(deg, ())) for deg, ends in sampled.items()}
    above = tuple(replace(item, interval=shares[int(item.threshold_deg)]) for item in exposure.time_above)
    ranges = {
        "generalised_accelerometer_velocity_p50_dps": Interval(38.2, 44.7),
        "recovery_neutral_slow_percent": Interval(28.4, 34.0),
        "entries_above_60_busy_minutes_percent": Interval(10.1, 16.6),
    }
    told = replace(exposure, time_above=above, intervals=ranges)
    return with_diary(told) if diary else told


@cache
def read_page_1(diary: bool, is_pose_off: bool, language: Language = "en") -> list[str]:
    exposure = make_day(diary=diary, is_pose_off=is_pose_off)
    report = build_report(make_analysis(exposure=exposure), make_subject(), language)
    page = PdfReader(io.BytesIO(render_pdf(report, {}))).pages[0]
    return [line.strip() for line in plain(page.extract_text()).splitlines()]


def format_time(seconds: float) -> str:
    """Hours and minutes; minutes and seconds below ten minutes; seconds below one."""
    if seconds < 60:
        return f"{seconds:.0f} s"
    if seconds < 600:
        minutes, rest = divmod(round(seconds), 60)
        return f"{minutes} min {rest} s" if rest else f"{minutes} min"
    minutes = round(seconds / 60)
    return f"{minutes // 60} h {minutes % 60} min" if minutes >= 60 else f"{minutes} min"


class Tracer:
    """Writes what page 1 should say from the fields of results.json alone."""

    def __init__(self, results: Any) -> None:
        self.results, self.exposure = results, results["exposure"]

    def clock(self, elapsed_s: float) -> str:
        start = datetime.fromisoformat(self.results["recording"]["start"])
        return f"{start + timedelta(seconds=elapsed_s):%H:%M}"

    def find(self, group: str, **where: float) -> Any:
        return next(row for row in self.exposure[group] if where.items() <= row.items())

    def head(self) -> set[str]:
        time, recording = self.results["time"], self.results["recording"]
        start = datetime.fromisoformat(recording["start"])
        hole = next(w for w in self.results["quality"]["warnings"] if w["code"] == "W-GAP")
        pose = self.results["calibration"]
        held = start + timedelta(seconds=pose["start_s"])
        return {
            recording["subject"],
            f"{start.day} {start:%B %Y}, {self.clock(0)} to {self.clock(time['recorded_s'])}",
            f"{format_time(time['analysed_s'])} of {format_time(time['recorded_s'])} recorded",
            f"▲  Data quality: use with care. Holes in the recording ({format_time(hole['seconds'])}).",
            (
                f"Calibration pose: held at the start, as stated ({held:%H:%M:%S}, "
                f"{pose['duration_s']:.1f} s); may read up to 15° low."
            ),
        }

    def answer(self) -> str:
        """The sentence on top: the figure, its range with the pose, and where it lies."""
        row, level = self.find("time_above", threshold_deg=60), self.level("above_60")
        analysed = format_time(self.results["time"]["analysed_s"])
        top = "" if row["high_pose"] is None else f", up to {row['high_pose']:.1f} % if the pose read low"
        return (
            f"The {self.results['recording']['side']} arm was above 60° for {row['percent']:.1f} % "
            f"of the {analysed} analysed ({row['low']:.1f}–{row['high']:.1f} %{top}): "
            f"{IN_WORDS[level['standing']]}"
        )

    def level(self, key: str) -> Any:
        return next(level for level in self.results["comparison"]["levels"] if level["key"] == key)

    def tiles(self) -> set[str]:
        told = set()
        for row in self.exposure["time_above"]:
            share = f"95 %: {row['low']:.1f}–{row['high']:.1f} %"
            told |= {f"{row['percent']:.1f} %", format_time(row["duration_s"]), share}
        speed = self.level("velocity")
        return told | {f"{speed['measured']:.0f}°/s", f"95 %: {speed['low']:.0f}–{speed['high']:.0f}°/s"}

    def standings(self) -> set[str]:
        told = set()
        for level in self.results["comparison"]["levels"]:
            unit = "°/s" if level["key"] == "velocity" else " %"
            told.add(STANDINGS[level["standing"]].format(f"{level['at_most']:.0f}{unit}"))
        return told

    def rest(self) -> set[str]:
        rest, ranges = self.exposure["recovery"], self.exposure["intervals"]
        low, high = ranges["recovery_neutral_slow_percent"]
        fewest, most = ranges["entries_above_60_busy_minutes_percent"]
        busy = self.find("entries", threshold_deg=60)["busy_minutes_percent"]
        return {
            f"Rest (arm down, still) {rest['neutral_slow_percent']:.1f} % ({low:.1f}–{high:.1f} %)",
            f"Longest without rest {format_time(rest['longest_without_s'])}",
            f"Minutes with 2+ rises > 60° {busy:.1f} % ({fewest:.1f}–{most:.1f} %)",
        }

    def pose(self) -> set[str]:
        """How far the known error of the pose reaches, where results.json holds it."""
        tops = {row["threshold_deg"]: row["high_pose"] for row in self.exposure["time_above"]}
        if None in tops.values():
            return set()
        return {
            *(f"pose: up to {top:.1f} %" for top in tops.values()),
            f"pose error up to {tops[60]:.1f} %",
        }

    def strip(self) -> set[str]:
        worst, longest = self.find("peak_windows", length_s=900), self.find("episodes", threshold_deg=60)
        hours = " ".join(f"{hour:02d}:00" for hour in range(8, 16))
        peak = f"peak 15 min: {worst['percent_above_60']:.1f} % above 60°"
        return {
            hours,
            f"middle 80 % median not analysed no data {peak}",
            f"longest unbroken above 60°: {format_time(longest['longest_s'])}",
            "12 3",
        }

    def quarter_hours(self) -> set[str]:
        hours = self.exposure["peak"]["quarter_hours"]
        rows = {
            f"{k}  {self.clock(q['start_s'])}–{self.clock(q['start_s'] + 900)} {q['percent_above_60']:.1f} %"
            for k, q in enumerate(hours, start=1)
        }
        return {*rows, f"1. Find out which task was done at {self.clock(hours[0]['start_s'])}."}

    def tasks(self) -> set[str]:
        above = {
            task["label"]: task["time_above_60_percent"] / 100 * task["analysed_s"]
            for task in self.exposure["by_task"]
        }
        order = sorted(self.exposure["by_task"], key=lambda task: -above[task["label"]])
        ranks = {task["label"]: self.rank(k, order) for k, task in enumerate(order)}
        periods = sorted(self.exposure["by_period"], key=lambda period: period["start_s"])
        worst = self.find("peak_windows", length_s=900)
        there = next(p for p in periods if p["start_s"] <= worst["start_s"] < p["end_s"])
        return {
            " ".join(f"{ranks[period['label']]} {period['label']}".strip() for period in periods),
            f"1. Look at {there['label']} at {self.clock(worst['start_s'])}.",
            *(self.row(ranks[task["label"]], task, above[task["label"]]) for task in order),
        }

    def rank(self, k: int, order: list[Any]) -> str:
        """Return the place of a task, if its range of minutes overlaps with that of no other."""
        ends = [
            [end * task["analysed_s"] for end in task["intervals"]["time_above_60_percent"]] for task in order
        ]
        others = ends[:k] + ends[k + 1 :]
        return str(k + 1) if all(high < ends[k][0] or low > ends[k][1] for low, high in others) else ""

    def row(self, rank: str, task: Any, above_s: float) -> str:
        told = f"{task['label']} {format_time(above_s)} {task['time_above_60_percent']:.1f} %"
        return f"{rank}  {told}" if rank else told

    def sureness(self) -> set[str]:
        row, days = self.find("time_above", threshold_deg=60), self.results["comparison"]["other_days"]
        value, half = row["percent"], BETWEEN_DAYS
        below, above = value - row["low"], (row["high_pose"] or row["high"]) - value
        assert days["between"] == pytest.approx([value - half, value + half])
        assert days["combined"] == pytest.approx([value - hypot(below, half), value + hypot(above, half)])
        (low, high), (least, most) = days["between"], days["combined"]
        return {
            f"all together, another day {least:.1f}–{most:.1f} %",
            f"this day: angle, variation {row['low']:.1f}–{row['high']:.1f} %",
            f"between days {low:.1f}–{high:.1f} %",
        }

    def days(self) -> set[str]:
        """The fewest days before and after that tell a change of half the time above 60°, with 80 % power."""
        half = self.find("time_above", threshold_deg=60)["percent"] / 2
        points = {k: (1.96 + 0.84) * sqrt(2 / k) * 2.0 for k in (1, 2, 3, 5)}
        days = next((k for k, told in points.items() if told <= half), 5)
        return {
            (
                f"3. For a planned change: {days} days before, {days} after "
                f"(detects {points[days]:.1f} percentage points, power 80 %)."
            )
        }

    def foot(self, line: str) -> bool:
        return bool(re.fullmatch(r"Acromion [\d.]+ · report [0-9a-f]{16} Page 1 of \d", line))


def list_numbers(lines: list[str]) -> list[float]:
    """List the numbers in order of size; without zeros, which the full hours of one language alone have."""
    text = re.sub(r"(\d),(\d)", r"\1.\2", "\n".join(lines))
    return sorted(filter(None, map(float, re.findall(r"\d+(?:\.\d+)?", text))))


@pytest.mark.parametrize("diary", [False, True], ids=["clean", "diary"])
@pytest.mark.parametrize("is_pose_off", [False, True], ids=["in range", "pose"])
def test_each_line_with_a_number_is_told_by_the_results(diary: bool, is_pose_off: bool) -> None:
    exposure = make_day(diary=diary, is_pose_off=is_pose_off)
    results = json.loads(encode_results(make_analysis(exposure=exposure), make_subject()))
    results["exposure"]["peak_windows"] = results["exposure"]["peak"]["windows"]
    trace, page = Tracer(results), read_page_1(diary, is_pose_off)

    told = {*trace.head(), *trace.tiles(), *trace.strip(), *trace.sureness(), *trace.pose()}
    told |= {*trace.rest(), *(trace.tasks() if diary else trace.quarter_hours())}
    wrapped = {trace.answer(), *trace.standings(), *trace.days(), *WRAPPED}  # over two lines or more
    printed = [line for line in page if re.search(r"\d", line) and not trace.foot(line)]

    known = told | SCALES | PUBLISHED | NAMES
    assert [line for line in printed if line not in known and not any(line in text for text in wrapped)] == []
    assert told - {"12 3"} - set(printed) == set()
    assert [text for text in wrapped if text not in " ".join(page)] == []


@pytest.mark.parametrize("language", ["fr", "fr-CA"])
@pytest.mark.parametrize("diary", [False, True], ids=["clean", "diary"])
def test_the_french_page_bears_the_same_numbers(language: Language, diary: bool) -> None:
    english, french = (
        [line for line in read_page_1(diary, True, each) if "Acromion" not in line]
        for each in ("en", language)
    )

    assert list_numbers(french) == list_numbers(english)
