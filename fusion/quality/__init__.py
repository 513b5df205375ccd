"""How far the numbers can be trusted: what was left out, where the time went, the verdict."""

from fusion.quality.exclusions import find_exclusions, leave_out, make_disjoint, refuse_short
from fusion.quality.nonwear import propose_nonwear
from fusion.quality.plausibility import flag_gyro_drift, flag_upside_down
from fusion.quality.spans import flag_spans
from fusion.quality.time_account import account_time, name_parts
from fusion.quality.types import Quality, TimeAccount, TimePart, Verdict
from fusion.quality.untrusted import flag_untrusted
from fusion.quality.verdict import assess_quality

__all__ = [
    "Quality",
    "TimeAccount",
    "TimePart",
    "Verdict",
    "account_time",
    "assess_quality",
    "find_exclusions",
    "flag_gyro_drift",
    "flag_spans",
    "flag_untrusted",
    "flag_upside_down",
    "leave_out",
    "make_disjoint",
    "name_parts",
    "propose_nonwear",
    "refuse_short",
]
