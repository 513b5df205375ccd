"""Stretches of time or ranges of rows, (start, end)."""

from collections.abc import Iterable
from typing import TypeVar

Number = TypeVar("Number", int, float)


def join_overlapping(spans: Iterable[tuple[Number, Number]]) -> list[tuple[Number, Number]]:
    """Return spans in order; those that meet are one."""
    joined: list[tuple[Number, Number]] = []
    for start, end in sorted(spans):
        if joined and start <= joined[-1][1]:
            joined[-1] = (joined[-1][0], max(joined[-1][1], end))
        else:
            joined.append((start, end))
    return joined


def find_uncovered(
    spans: Iterable[tuple[Number, Number]], start: Number, end: Number, tolerance: Number
) -> list[tuple[Number, Number]]:
    """Return what no span covers between ``start`` and ``end``, where it is longer than ``tolerance``."""
    uncovered: list[tuple[Number, Number]] = []
    covered = sorted(spans)
    covered.append((end, end))
    for first, stop in covered:
        if first - start > tolerance:
            uncovered.append((start, first))
        start = max(start, stop)
    return uncovered
