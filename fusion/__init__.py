"""What the arm did: from the bytes of a recording to elevation and exposure.

The public names are loaded when first asked for, so that a program which only needs the errors or the
value types does not pay for the compiler.
"""

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from fusion.errors import FusionError as FusionError
    from fusion.frames import tabulate_elevation as tabulate_elevation
    from fusion.frames import tabulate_exposure as tabulate_exposure
    from fusion.live import LiveElevation as LiveElevation
    from fusion.orientation import estimate_vertical as estimate_vertical
    from fusion.pipeline import Analysis as Analysis
    from fusion.pipeline import AnalysisSettings as AnalysisSettings
    from fusion.pipeline import analyse as analyse
    from fusion.readers import read_recording as read_recording
    from fusion.readers import read_recordings as read_recordings
    from fusion.recording import Recording as Recording

_HOMES = {
    "LiveElevation": "fusion.live",
    "Analysis": "fusion.pipeline",
    "AnalysisSettings": "fusion.pipeline",
    "FusionError": "fusion.errors",
    "Recording": "fusion.recording",
    "analyse": "fusion.pipeline",
    "estimate_vertical": "fusion.orientation",
    "read_recording": "fusion.readers",
    "read_recordings": "fusion.readers",
    "tabulate_elevation": "fusion.frames",
    "tabulate_exposure": "fusion.frames",
}

__all__ = [
    "Analysis",
    "AnalysisSettings",
    "FusionError",
    "LiveElevation",
    "Recording",
    "analyse",
    "estimate_vertical",
    "read_recording",
    "read_recordings",
    "tabulate_elevation",
    "tabulate_exposure",
]


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module 'fusion' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name]), name)
