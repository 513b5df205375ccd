"""The pictures of "How to read this": the drawings of page 1, of an invented day."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import datetime
from math import sin

from app.report.charts.day import Day, DayLabels, Mark, MinuteBand, build_day_labels, draw_day
from app.report.charts.profile import Doubt, Sureness, TileScale, draw_sureness, draw_tile
from app.report.charts.svg import NARROW, WIDE
from app.report.words.numbers import Clock, format_duration, format_number, format_percent, percent_sign
from app.report.words.wording import Language, Words, fill, load_wording

SHARE, SHARE_RANGE, SHARE_POSE, PUBLISHED = 12.0, (9.0, 16.0), (16.0, 22.0), 10.0
END = 40.0
SHARE_DAYS = (8.0, 16.0)
"""The value ± 1.96 × 2.0 points (docs/profile.md), to the percent."""
MINUTES, BREAK, HOLE, WORST = 240, (110, 130), (185, 195), (150, 165)
LONGEST_S = 24.0


def draw_example(language: Language) -> Mapping[str, str]:
    """Draw a tile's scale, the day (wide and narrow) and the doubts; the values are invented."""
    words, told = load_wording(language), load_wording(language, "help")["reading"]["picture"]
    return {
        "tile": draw_tile(_build_scale(told, language)),
        "day": draw_day(*_build_day(words, told, language), WIDE),
        "day_narrow": draw_day(*_build_day(words, told, language), NARROW),
        "sure": draw_sureness(_build_sureness(words, told, language)),
    }


def _build_scale(told: Words, language: Language) -> TileScale:
    return TileScale(
        key="example",
        words=(told["tile_title"], told["tile"]),
        end=END,
        end_label=_tell((END,), language),
        measured=SHARE,
        interval=SHARE_RANGE,
        pose=SHARE_POSE,
        published=(PUBLISHED,),
        published_label=_tell((PUBLISHED,), language),
    )


def _build_day(words: Words, told: Words, language: Language) -> tuple[Day, DayLabels]:
    def band(minute: int) -> MinuteBand:
        middle = 24 + 9 * sin(minute / 9) + 5 * sin(minute / 2.3)
        above = 62.0 if WORST[0] <= minute < WORST[1] else 18 + 14 * sin(minute / 5) ** 2
        return MinuteBand(60.0 * minute, 60.0 * (minute + 1), middle / 3, middle, middle + above)

    edges = (0, *BREAK, *HOLE, MINUTES)
    runs = tuple(tuple(map(band, range(a, b))) for a, b in zip(edges[::2], edges[1::2], strict=True))
    day = Day(
        duration_s=60.0 * MINUTES,
        clock=Clock(datetime.fromisoformat("2026-03-02T08:00:00"), language),
        runs=runs,
        marks=(
            Mark(60.0 * BREAK[0], 60.0 * BREAK[1], "left out", told["break"]),
            Mark(60.0 * HOLE[0], 60.0 * HOLE[1], "missing", words["day"]["missing"]),
        ),
        worst=(60.0 * WORST[0], 60.0 * WORST[1]),
        longest_start_s=60.0 * 157,
    )
    labels = build_day_labels(told["day_title"], told["day"], words)
    worst = fill(words["day"]["worst"], {"percent": format_percent(2 * SHARE, language)})
    longest = fill(words["day"]["longest"], {"duration": format_duration(LONGEST_S, language)})
    return day, replace(labels, worst=worst, longest=longest)


def _build_sureness(words: Words, told: Words, language: Language) -> Sureness:
    entry = words["profile"]["sure"]
    high = _tell(SHARE_POSE[1:], language)
    return Sureness(
        words=(told["sure_title"], told["sure"]),
        measured=SHARE,
        end=END,
        end_label=_tell((END,), language),
        doubts=(
            Doubt(entry["sensor"], _tell(SHARE_RANGE, language), SHARE_RANGE),
            Doubt(entry["pose"], fill(entry["up_to"], {"high": high}), (SHARE, SHARE_POSE[1]), is_pose=True),
            Doubt(entry["days"], _tell(SHARE_DAYS, language), SHARE_DAYS),
        ),
    )


def _tell(shares: Sequence[float], language: Language) -> str:
    """Write whole percents, one or a range of two."""
    return "–".join(format_number(share, 0, language) for share in shares) + percent_sign(language)
