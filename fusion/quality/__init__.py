"""How far the numbers can be trusted: what was left out, where the time went, the verdict.

The values are loaded with the package; what computes them only when first asked for, so that a report can be
written without the compiler.
"""

import importlib
from typing import TYPE_CHECKING

from fusion.quality.types import Quality, TimeAccount, TimePart, Verdict

if TYPE_CHECKING:
    from fusion.quality.pose_flags import flag_pose as flag_pose
    from fusion.quality.time_account import account_time as account_time
    from fusion.quality.time_account import count_holes_us as count_holes_us
    from fusion.quality.time_account import divide_time as divide_time
    from fusion.quality.time_account import find_exclusions as find_exclusions
    from fusion.quality.time_account import flag_untrusted as flag_untrusted
    from fusion.quality.time_account import flag_untrusted_pose as flag_untrusted_pose
    from fusion.quality.time_account import leave_out as leave_out
    from fusion.quality.time_account import make_disjoint as make_disjoint
    from fusion.quality.time_account import propose_nonwear as propose_nonwear
    from fusion.quality.time_account import refuse_short as refuse_short
    from fusion.quality.verdict import assess_quality as assess_quality
    from fusion.quality.verdict import flag_accelerometer_drift as flag_accelerometer_drift
    from fusion.quality.verdict import flag_gyro_drift as flag_gyro_drift
    from fusion.quality.verdict import flag_published as flag_published
    from fusion.quality.verdict import flag_upside_down as flag_upside_down
    from fusion.recording import flag_spans as flag_spans

_HOMES = {
    "account_time": "fusion.quality.time_account",
    "assess_quality": "fusion.quality.verdict",
    "count_holes_us": "fusion.quality.time_account",
    "find_exclusions": "fusion.quality.time_account",
    "flag_accelerometer_drift": "fusion.quality.verdict",
    "flag_gyro_drift": "fusion.quality.verdict",
    "flag_pose": "fusion.quality.pose_flags",
    "flag_published": "fusion.quality.verdict",
    "flag_spans": "fusion.recording",
    "flag_untrusted": "fusion.quality.time_account",
    "flag_untrusted_pose": "fusion.quality.time_account",
    "flag_upside_down": "fusion.quality.verdict",
    "leave_out": "fusion.quality.time_account",
    "make_disjoint": "fusion.quality.time_account",
    "divide_time": "fusion.quality.time_account",
    "propose_nonwear": "fusion.quality.time_account",
    "refuse_short": "fusion.quality.time_account",
}

__all__ = [
    "Quality",
    "TimeAccount",
    "TimePart",
    "Verdict",
    "account_time",
    "assess_quality",
    "count_holes_us",
    "divide_time",
    "find_exclusions",
    "flag_accelerometer_drift",
    "flag_gyro_drift",
    "flag_pose",
    "flag_published",
    "flag_spans",
    "flag_untrusted",
    "flag_untrusted_pose",
    "flag_upside_down",
    "leave_out",
    "make_disjoint",
    "propose_nonwear",
    "refuse_short",
]


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module 'fusion.quality' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name]), name)
