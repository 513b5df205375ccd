"""Compute arm elevation and exposure from the bytes of a recording.

The public names are loaded on first use. A program that only needs the errors or the value types does not
wait for the compiler. The installed package offers the same names as :mod:`acromion`.
"""

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from fusion.angle_files.elevation_parquet import read_elevation as read_elevation
    from fusion.diary import DiaryEntry as DiaryEntry
    from fusion.elevation import Elevation as Elevation
    from fusion.elevation import ElevationSegment as ElevationSegment
    from fusion.elevation import Method as Method
    from fusion.errors import FusionError as FusionError
    from fusion.errors import UnreadableFile as UnreadableFile
    from fusion.errors import UnusableArrays as UnusableArrays
    from fusion.errors import UnusableDiary as UnusableDiary
    from fusion.errors import UnusableRecording as UnusableRecording
    from fusion.exposure.types import Cycles as Cycles
    from fusion.exposure.types import ElevationBin as ElevationBin
    from fusion.exposure.types import Entries as Entries
    from fusion.exposure.types import Episodes as Episodes
    from fusion.exposure.types import Eva as Eva
    from fusion.exposure.types import EvaSummary as EvaSummary
    from fusion.exposure.types import Exposure as Exposure
    from fusion.exposure.types import Frequency as Frequency
    from fusion.exposure.types import HourVariation as HourVariation
    from fusion.exposure.types import Interval as Interval
    from fusion.exposure.types import MinuteProfile as MinuteProfile
    from fusion.exposure.types import PartExposure as PartExposure
    from fusion.exposure.types import PeakWindow as PeakWindow
    from fusion.exposure.types import Recovery as Recovery
    from fusion.exposure.types import TimeAbove as TimeAbove
    from fusion.exposure.types import Velocity as Velocity
    from fusion.frames import tabulate_elevation as tabulate_elevation
    from fusion.frames import tabulate_exposure as tabulate_exposure
    from fusion.live import LiveElevation as LiveElevation
    from fusion.orientation import estimate_vertical as estimate_vertical
    from fusion.pipeline import Analysis as Analysis
    from fusion.pipeline import analyse as analyse
    from fusion.pose.calibrate import Calibration as Calibration
    from fusion.pose.calibrate import StillPeriod as StillPeriod
    from fusion.quality import Quality as Quality
    from fusion.quality import TimeAccount as TimeAccount
    from fusion.quality import TimePart as TimePart
    from fusion.readers import read_recording as read_recording
    from fusion.readers import read_recordings as read_recordings
    from fusion.readers.tables.profile import ColumnProfile as ColumnProfile
    from fusion.recording import QualityFlag as QualityFlag
    from fusion.recording import Recording as Recording
    from fusion.recording import Segment as Segment
    from fusion.recording import Span as Span
    from fusion.settings import AnalysisSettings as AnalysisSettings

_NAMES = {
    "fusion.angle_files.elevation_parquet": "read_elevation",
    "fusion.diary": "DiaryEntry",
    "fusion.elevation": "Elevation ElevationSegment Method",
    "fusion.errors": "FusionError UnreadableFile UnusableArrays UnusableDiary UnusableRecording",
    "fusion.exposure.types": (
        "Cycles ElevationBin Entries Episodes Eva EvaSummary Exposure Frequency HourVariation Interval "
        "MinuteProfile PartExposure PeakWindow Recovery TimeAbove Velocity"
    ),
    "fusion.frames": "tabulate_elevation tabulate_exposure",
    "fusion.live": "LiveElevation",
    "fusion.orientation": "estimate_vertical",
    "fusion.pipeline": "Analysis analyse",
    "fusion.pose.calibrate": "Calibration StillPeriod",
    "fusion.quality": "Quality TimeAccount TimePart",
    "fusion.readers": "read_recording read_recordings",
    "fusion.readers.tables.profile": "ColumnProfile",
    "fusion.recording": "QualityFlag Recording Segment Span",
    "fusion.settings": "AnalysisSettings",
}
_MODULES = dict(sorted((name, module) for module, names in _NAMES.items() for name in names.split()))

__all__ = list(_MODULES)


def __getattr__(name: str) -> object:
    if name not in _MODULES:
        raise AttributeError(f"module 'fusion' has no attribute {name!r}")
    return getattr(importlib.import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    return __all__
