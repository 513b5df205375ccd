"""The settings of a request by the names in ``settings.yaml``; this module does not load YAML."""

import json
from typing import Any

from acromion.app.request import ReportRequest
from acromion.fusion.clocks import format_clock_offset


def list_settings(request: ReportRequest) -> dict[str, Any]:
    """Return the settings by the names in the file; without the diary and the column profile."""
    return {
        "method": request.method,
        "pose": request.pose,
        "side": request.side,
        "calibration": [list(window) for window in request.calibration_windows_s],
        "pose_held": request.pose_held,
        "axis": request.arm_axis,
        "slip_at": list(request.slip_times_s),
        "no_slip_at": list(request.no_slip_times_s),
        "shift": request.shift or None,
        "min_hours": request.min_hours,
        "rate_hz": request.rate_hz,
        "time_zone": request.time_zone or None,
        "clock_offset": format_clock_offset(request.clock_offset_s) or None,
        "lang": request.languages[0],
        "report": list(request.kinds),
        "paper": request.paper,
        "appendix": request.appendix,
    }


def list_stated(request: ReportRequest) -> dict[str, Any]:
    """Return the settings that differ from the defaults, by the names in the file; without the diary."""
    usual = list_settings(ReportRequest(""))
    stated = {name: value for name, value in list_settings(request).items() if value != usual[name]}
    return stated | ({"profile": json.loads(request.profile)} if request.profile else {})


def format_stated(request: ReportRequest) -> str:
    """Return the settings that differ from the defaults as JSON, by the names in the file.

    Of the diary only the number of rows is stated, and of a column profile only that there is one.
    """
    stated = {name: value for name, value in list_stated(request).items() if name not in _OF_REPORT}
    if rows := len(request.select_diary()):
        stated["diary_rows"] = rows
    if request.profile:
        stated["profile"] = True
    return json.dumps(stated, ensure_ascii=False)


_OF_REPORT = frozenset({"side", "lang", "report", "paper", "appendix", "min_hours"})
"""Settings that change no figure, or have their own column."""
