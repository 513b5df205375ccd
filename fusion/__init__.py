"""Compute arm elevation and exposure from the bytes of a recording.

The public names are loaded on first use. A program that only needs the errors or the value types does not
wait for the compiler. The installed package offers the same names as :mod:`acromion`.
"""

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from acromion.fusion.angle_files.elevation_parquet import read_elevation as read_elevation
    from acromion.fusion.comparison.days import Design as Design
    from acromion.fusion.comparison.days import GroupChange as GroupChange
    from acromion.fusion.comparison.days import GroupSpread as GroupSpread
    from acromion.fusion.comparison.days import compare_people as compare_people
    from acromion.fusion.comparison.days import describe_group as describe_group
    from acromion.fusion.comparison.days import find_designs as find_designs
    from acromion.fusion.comparison.mixed import FixedEffect as FixedEffect
    from acromion.fusion.comparison.mixed import MixedModel as MixedModel
    from acromion.fusion.comparison.mixed import fit_mixed_model as fit_mixed_model
    from acromion.fusion.diary import DiaryEntry as DiaryEntry
    from acromion.fusion.elevation import Elevation as Elevation
    from acromion.fusion.elevation import ElevationSegment as ElevationSegment
    from acromion.fusion.elevation import Method as Method
    from acromion.fusion.errors import FusionError as FusionError
    from acromion.fusion.errors import UnreadableFile as UnreadableFile
    from acromion.fusion.errors import UnusableArrays as UnusableArrays
    from acromion.fusion.errors import UnusableDiary as UnusableDiary
    from acromion.fusion.errors import UnusableRecording as UnusableRecording
    from acromion.fusion.exposure.types import Cycles as Cycles
    from acromion.fusion.exposure.types import ElevationBin as ElevationBin
    from acromion.fusion.exposure.types import Entries as Entries
    from acromion.fusion.exposure.types import Episodes as Episodes
    from acromion.fusion.exposure.types import Eva as Eva
    from acromion.fusion.exposure.types import EvaSummary as EvaSummary
    from acromion.fusion.exposure.types import Exposure as Exposure
    from acromion.fusion.exposure.types import Frequency as Frequency
    from acromion.fusion.exposure.types import HourVariation as HourVariation
    from acromion.fusion.exposure.types import Interval as Interval
    from acromion.fusion.exposure.types import MinuteProfile as MinuteProfile
    from acromion.fusion.exposure.types import PartExposure as PartExposure
    from acromion.fusion.exposure.types import PeakWindow as PeakWindow
    from acromion.fusion.exposure.types import Recovery as Recovery
    from acromion.fusion.exposure.types import TimeAbove as TimeAbove
    from acromion.fusion.exposure.types import Velocity as Velocity
    from acromion.fusion.live import LiveElevation as LiveElevation
    from acromion.fusion.orientation import estimate_vertical as estimate_vertical
    from acromion.fusion.pipeline import Analysis as Analysis
    from acromion.fusion.pipeline import analyse as analyse
    from acromion.fusion.pose.calibrate import Calibration as Calibration
    from acromion.fusion.pose.calibrate import StillPeriod as StillPeriod
    from acromion.fusion.quality import Quality as Quality
    from acromion.fusion.quality import TimeAccount as TimeAccount
    from acromion.fusion.quality import TimePart as TimePart
    from acromion.fusion.readers import read_recording as read_recording
    from acromion.fusion.readers import read_recordings as read_recordings
    from acromion.fusion.readers.tables.profile import ColumnProfile as ColumnProfile
    from acromion.fusion.recording import QualityFlag as QualityFlag
    from acromion.fusion.recording import Recording as Recording
    from acromion.fusion.recording import Segment as Segment
    from acromion.fusion.recording import Span as Span
    from acromion.fusion.settings import AnalysisSettings as AnalysisSettings
    from acromion.fusion.study.frames import tabulate_elevation as tabulate_elevation
    from acromion.fusion.study.frames import tabulate_exposure as tabulate_exposure
    from acromion.fusion.study.many import AnalysedFile as AnalysedFile
    from acromion.fusion.study.many import analyse_many as analyse_many
    from acromion.fusion.study.study import Study as Study
    from acromion.fusion.study.study import list_days as list_days

_NAMES = {
    "acromion.fusion.angle_files.elevation_parquet": "read_elevation",
    "acromion.fusion.comparison.days": (
        "Design GroupChange GroupSpread compare_people describe_group find_designs"
    ),
    "acromion.fusion.comparison.mixed": "FixedEffect MixedModel fit_mixed_model",
    "acromion.fusion.diary": "DiaryEntry",
    "acromion.fusion.elevation": "Elevation ElevationSegment Method",
    "acromion.fusion.errors": "FusionError UnreadableFile UnusableArrays UnusableDiary UnusableRecording",
    "acromion.fusion.exposure.types": (
        "Cycles ElevationBin Entries Episodes Eva EvaSummary Exposure Frequency HourVariation Interval "
        "MinuteProfile PartExposure PeakWindow Recovery TimeAbove Velocity"
    ),
    "acromion.fusion.study.frames": "tabulate_elevation tabulate_exposure",
    "acromion.fusion.live": "LiveElevation",
    "acromion.fusion.study.many": "AnalysedFile analyse_many",
    "acromion.fusion.orientation": "estimate_vertical",
    "acromion.fusion.pipeline": "Analysis analyse",
    "acromion.fusion.pose.calibrate": "Calibration StillPeriod",
    "acromion.fusion.quality": "Quality TimeAccount TimePart",
    "acromion.fusion.readers": "read_recording read_recordings",
    "acromion.fusion.readers.tables.profile": "ColumnProfile",
    "acromion.fusion.recording": "QualityFlag Recording Segment Span",
    "acromion.fusion.settings": "AnalysisSettings",
    "acromion.fusion.study.study": "Study list_days",
}
_MODULES = dict(sorted((name, module) for module, names in _NAMES.items() for name in names.split()))

__all__ = list(_MODULES)


def __getattr__(name: str) -> object:
    if name not in _MODULES:
        raise AttributeError(f"module 'acromion.fusion' has no attribute {name!r}")
    return getattr(importlib.import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    return __all__
