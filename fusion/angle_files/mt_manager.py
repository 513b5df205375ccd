"""MT Manager's text export, 4.x and 2022: one tracker, tab, comma, semicolon or space between the fields.

The orientation is that of the sensor to the world (ENU, z up), as a matrix, a quaternion or Euler angles.
Time: ``SampleTimeFine`` (0.1 ms) where it is filled; else the packet counter over the update rate, which 4.x
writes above the table and 2022 leaves to the person.

Source: MT Manager User Manual, chapter on ASCII export; checked on exports of both versions.
"""

import re

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
from fusion.errors import MissingSegment, UnknownRate
from fusion.readers.source import Source, hash_source
from fusion.recording import Float64Array

NEEDED = (frozenset({"packetcounter"}),)
TICK_S = 1e-4
_RATE = re.compile(r"Update Rate:\s*([\d.]+)\s*Hz")
_VERSION = re.compile(r"MT Manager version:\s*([\w.]+)")


def recognise(source: Source) -> bool:
    """Lines with // above a table with a packet counter."""
    return source.head.startswith(b"//") and find_layout(source, NEEDED) is not None


def read(source: Source, options: AngleFileOptions) -> AngleFile:
    """Read the tracker's orientation; how the arm lies in it is not in the file.

    Raises
    ------
    MissingSegment
        An export without orientation.
    UnknownRate
        Neither time nor rate in the file, and none given.
    """
    layout = find_layout(source, NEEDED)
    orientation = find_orientation(layout.names) if layout else None
    if layout is None or orientation is None:
        raise MissingSegment(segment="Mat, Quat, Roll/Pitch")
    others = [name for name in COUNTER_SPAN if name in layout.names]
    up, values = read_up(source, layout, orientation, others)
    time_s, rate = _find_times(values["packetcounter"], values.get("sampletimefine"), layout, options)
    present = np.isfinite(up).all(axis=1)
    return AngleFile(
        device="other",
        sha256=hash_source(source),
        time_s=time_s[present],
        first_s=float(time_s[0]),
        last_s=float(time_s[-1]),
        up=up[present],
        understood={
            "layout": "MT Manager",
            "version": _find_text(_VERSION, layout) or "4.x",
            "source": orientation[0],
            "rate_hz": rate,
        },
    )


def _find_times(
    counter: Float64Array, fine: Float64Array | None, layout: Layout, options: AngleFileOptions
) -> tuple[Float64Array, str]:
    if fine is not None and np.isfinite(fine).all():
        return unwrap_counter(fine, COUNTER_SPAN["sampletimefine"]) * TICK_S, ""
    rate_text = _find_text(_RATE, layout)
    rate_hz = float(rate_text) if rate_text else options.rate_hz
    if not rate_hz:
        raise UnknownRate
    return unwrap_counter(counter, COUNTER_SPAN["packetcounter"]) / rate_hz, f"{rate_hz:g}"


def _find_text(pattern: re.Pattern[str], layout: Layout) -> str:
    found = pattern.search("\n".join(layout.before))
    return found[1] if found else ""
