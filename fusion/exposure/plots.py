"""Figures drawn with matplotlib, which is an optional part of an installation."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from acromion.fusion.clocks import read_clock
from acromion.fusion.conventions import MAIN_THRESHOLD_DEG
from acromion.fusion.exposure.types import MinuteProfile
from acromion.fusion.recording import MICROSECONDS, Span

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK, SOFT, LIGHT, BLUE, ORANGE = "#1c2833", "#4a5763", "#9ecae1", "#0b4a8a", "#d55e00"
"""Colours of the report."""
_MINUTE_US = 60 * MICROSECONDS


def make_axes(width: float, height: float) -> tuple[Figure, Axes]:
    """Return an empty figure; raises ModuleNotFoundError with the command that installs matplotlib."""
    try:
        plt: Any = import_module("matplotlib.pyplot")
    except ModuleNotFoundError as error:
        told = "matplotlib is not installed: it comes with the extra acromion[plots]"
        raise ModuleNotFoundError(told, name=error.name) from None
    figure, axes = plt.subplots(figsize=(width, height), layout="constrained")
    axes.spines[["top", "right"]].set_visible(False)
    return figure, axes


def draw_day(
    minutes: MinuteProfile, start: datetime | None, excluded: Sequence[Span], title: str = ""
) -> Figure:
    """Draw P10 to P90 and the median of each minute, and hatch the excluded time.

    The axis is the clock, or minutes from the first sample without a clock.
    """
    figure, axes = make_axes(8.0, 3.0)

    def place(elapsed_us: int) -> Any:
        if start is None:
            return elapsed_us / _MINUTE_US
        return read_clock(start, elapsed_us).replace(tzinfo=None)

    starts_us = [round(second * MICROSECONDS) for second in minutes.start_s.tolist()]
    edges = [place(us) for us in starts_us] + [place(us + _MINUTE_US) for us in starts_us[-1:]]
    low, median, high = (
        np.append(row, row[-1:]) for row in (minutes.p10_deg, minutes.p50_deg, minutes.p90_deg)
    )
    axes.fill_between(edges, low, high, step="post", color=LIGHT, linewidth=0, label="P10 to P90")
    axes.step(edges, median, where="post", color=BLUE, linewidth=1, label="median")
    axes.axhline(MAIN_THRESHOLD_DEG, color=ORANGE, linestyle="dotted", label=f"{MAIN_THRESHOLD_DEG:g}°")
    for number, span in enumerate(excluded):
        axes.axvspan(
            place(span.start_us),
            place(span.end_us),
            facecolor="none",
            edgecolor=SOFT,
            hatch="///",
            linewidth=0,
            label="excluded" if number == 0 else None,
        )
    if start is not None:
        axes.xaxis.set_major_formatter(import_module("matplotlib.dates").DateFormatter("%H:%M"))
    axes.set(
        xlabel="clock" if start else "minutes from the first sample", ylabel="arm elevation, °", title=title
    )
    axes.set_ylim(0, None)
    figure.legend(ncols=4, loc="outside lower center", frameon=False)
    return figure
