"""How far the numbers can be trusted: what was left out, where the time went, the verdict."""

from fusion.quality.exclusions import find_exclusions, leave_out
from fusion.quality.time_account import account_time
from fusion.quality.types import Quality, TimeAccount, Verdict
from fusion.quality.verdict import assess_quality

__all__ = [
    "Quality",
    "TimeAccount",
    "Verdict",
    "account_time",
    "assess_quality",
    "find_exclusions",
    "leave_out",
]
