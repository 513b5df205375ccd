"""How far two measurements of one arm agree: the source paper's validation, for everybody's own people."""

from fusion.agreement.alignment import ClockSettings, align
from fusion.agreement.compare import (
    Comparison,
    ComparisonSettings,
    FigureDifference,
    Side,
    Stratum,
    TaskAgreement,
    compare_sides,
    take_angle_file,
    take_recording,
)
from fusion.agreement.pairs import Alignment, PairedRun, Pairs, WindowLag
from fusion.agreement.statistics import (
    Agreement,
    AgreementCell,
    AgreementEntry,
    Limits,
    find_repeated_limits,
    measure_agreement,
    summarise_agreement_study,
)
from fusion.diary import TaskWindow, read_tasks

__all__ = [
    "Agreement",
    "AgreementCell",
    "AgreementEntry",
    "Alignment",
    "ClockSettings",
    "Comparison",
    "ComparisonSettings",
    "FigureDifference",
    "Limits",
    "PairedRun",
    "Pairs",
    "Side",
    "Stratum",
    "TaskAgreement",
    "TaskWindow",
    "WindowLag",
    "align",
    "compare_sides",
    "find_repeated_limits",
    "measure_agreement",
    "read_tasks",
    "summarise_agreement_study",
    "take_angle_file",
    "take_recording",
]
