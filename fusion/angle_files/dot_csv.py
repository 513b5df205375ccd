"""Xsens (Movella) DOT's CSV with an orientation: metadata lines, then a table with ``SampleTimeFine`` in us.

The orientation is that of the sensor to a local earth frame with z up. A DOT file that holds acceleration and
angular rate is a recording like any other and is fused by us.

Source: Xsens DOT User Manual, chapter on the CSV export; checked on an export of app 2021.0.
"""

import re
from datetime import datetime, timedelta, timezone

import numpy as np

from fusion.angle_files.tables import (
    COUNTER_SPAN,
    Layout,
    find_layout,
    find_orientation,
    read_up,
    unwrap_counter,
)
from fusion.angle_files.types import AngleFile, AngleFileOptions
from fusion.errors import MissingSegment
from fusion.readers.source import Source, hash_source

NEEDED = (frozenset({"packetcounter"}), frozenset({"sampletimefine"}))
TICK_S = 1e-6
_START = re.compile(
    r"StartTime:\s*,?\s*(\d{4})-(\d\d)-(\d\d)_(\d\d):(\d\d):(\d\d)_(\d{1,3})(?:\s*GMT\s*([+-]\d{1,2}))?"
)


def recognise(source: Source) -> bool:
    """A table with a packet counter and a fine time under lines of DOT's own."""
    if source.head.startswith(b"//"):
        return False
    layout = find_layout(source, NEEDED)
    return layout is not None and find_orientation(layout.names) is not None


def read(source: Source, _options: AngleFileOptions) -> AngleFile:
    """Read the sensor's orientation; how the arm lies in it is not in the file.

    Raises
    ------
    MissingSegment
        An export without orientation.
    """
    layout = find_layout(source, NEEDED)
    orientation = find_orientation(layout.names) if layout else None
    if layout is None or orientation is None:
        raise MissingSegment(segment="Quat, Euler")
    up, values = read_up(source, layout, orientation, ["sampletimefine"])
    time_s = unwrap_counter(values["sampletimefine"], COUNTER_SPAN["sampletimefine"]) * TICK_S
    present = np.isfinite(up).all(axis=1)
    return AngleFile(
        device="dot",
        sha256=hash_source(source),
        time_s=time_s[present],
        first_s=float(time_s[0]),
        last_s=float(time_s[-1]),
        up=up[present],
        start=_find_start(layout),
        understood={"layout": "DOT", "source": orientation[0]},
    )


def _find_start(layout: Layout) -> datetime | None:
    found = _START.search("\n".join(layout.before))
    if not found:
        return None
    *clock, milliseconds, offset_h = found.groups()
    zone = timezone(timedelta(hours=int(offset_h))) if offset_h else None
    try:
        year, month, day, hour, minute, second = map(int, clock)
        return datetime(year, month, day, hour, minute, second, int(milliseconds) * 1000, zone)
    except ValueError:
        return None
