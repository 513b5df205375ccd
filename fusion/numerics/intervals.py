"""Stretches of time, (start, end)."""

from collections.abc import Sequence


def join_overlapping(spans_s: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return spans in order of time; those that meet are one."""
    joined: list[tuple[float, float]] = []
    for start_s, end_s in sorted(spans_s):
        if joined and start_s <= joined[-1][1]:
            joined[-1] = (joined[-1][0], max(joined[-1][1], end_s))
        else:
            joined.append((start_s, end_s))
    return joined
