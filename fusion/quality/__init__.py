"""How far the numbers can be trusted: what was left out, where the time went, the verdict.

Only the values are loaded with the package, so that a report can be written without the compiler.
"""

from fusion.quality.types import Quality, TimeAccount, TimePart, Verdict

__all__ = ["Quality", "TimeAccount", "TimePart", "Verdict"]
