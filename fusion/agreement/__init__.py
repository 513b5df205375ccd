"""How far two measurements of one arm agree: the source paper's validation, for everybody's own people."""

from fusion.agreement.alignment import ClockWishes, align
from fusion.agreement.clocks import Alignment, WindowLag
from fusion.agreement.comparing import Comparison, ComparisonSettings, TaskAgreement, compare_sides
from fusion.agreement.exposure_differences import FigureDifference
from fusion.agreement.pairing import PairedRun, Pairs
from fusion.agreement.sides import Side, take_angle_file, take_recording
from fusion.agreement.statistics import Agreement, Limits, find_repeated_limits, measure_agreement
from fusion.agreement.strata import Stratum
from fusion.agreement.study import StudyCell, StudyEntry, summarise_study
from fusion.task_windows import TaskWindow, read_tasks

__all__ = [
    "Agreement",
    "Alignment",
    "ClockWishes",
    "Comparison",
    "ComparisonSettings",
    "FigureDifference",
    "Limits",
    "PairedRun",
    "Pairs",
    "Side",
    "Stratum",
    "StudyCell",
    "StudyEntry",
    "TaskAgreement",
    "TaskWindow",
    "WindowLag",
    "align",
    "compare_sides",
    "find_repeated_limits",
    "measure_agreement",
    "read_tasks",
    "summarise_study",
    "take_angle_file",
    "take_recording",
]
