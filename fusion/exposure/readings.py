"""Ranges over several readings of one day: no person has said which of them is right."""

from collections.abc import Sequence
from dataclasses import fields, is_dataclass, replace
from typing import Any

from fusion.exposure.types import Exposure, Interval


def widen_over(exposure: Exposure, others: Sequence[Exposure]) -> Exposure:
    """Return the exposure with each range widened to hold the ranges of the same figure in others."""
    widened = _widen(exposure, others)
    assert isinstance(widened, Exposure)
    return widened


def _widen(value: Any, others: Sequence[Any]) -> Any:
    """Return a value whose intervals hold those at the same place in others; places that lack are skipped."""
    alike = [other for other in others if type(other) is type(value)]
    if isinstance(value, Interval):
        return join_intervals([value, *alike])
    if isinstance(value, dict):
        return {
            key: _widen(each, [other[key] for other in alike if key in other]) for key, each in value.items()
        }
    if isinstance(value, tuple):
        same = [other for other in alike if len(other) == len(value)]
        return tuple(_widen(each, [other[k] for other in same]) for k, each in enumerate(value))
    if is_dataclass(value) and not isinstance(value, type):
        found = {
            field.name: _widen(getattr(value, field.name), [getattr(other, field.name) for other in alike])
            for field in fields(value)
        }
        changed = {name: each for name, each in found.items() if each is not getattr(value, name)}
        return replace(value, **changed) if changed else value
    return value


def join_intervals(intervals: Sequence[Interval]) -> Interval:
    """Return the interval that holds all of them, also with the error of the N-pose."""
    low, high = min(one.low for one in intervals), max(one.high for one in intervals)
    lows = [one.low_pose for one in intervals if one.low_pose is not None]
    highs = [one.high_pose for one in intervals if one.high_pose is not None]
    return Interval(low, high, min(lows, default=None), max(highs, default=None))
