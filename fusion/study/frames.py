"""Results as pandas tables, for further computation."""

from collections.abc import Iterable, Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
import pandas as pd

from acromion.fusion.elevation import Elevation
from acromion.fusion.exposure.types import Exposure, PartExposure
from acromion.fusion.pipeline import Analysis
from acromion.fusion.recording import MICROSECONDS


def tabulate_elevation(source: Analysis | Elevation) -> pd.DataFrame:
    """Return the angle series as a table.

    Parameters
    ----------
    source
        An analysis of a recording or of precomputed angles, or the result of :func:`acromion.read_elevation`.

    Returns
    -------
    pandas.DataFrame
        ``time_s`` (from the first sample), ``elevation_deg``, ``valid``: at most about 100
        rows a second, before the metric filter; a gap has no rows. The index counts rows.
    """
    elevation = source if isinstance(source, Elevation) else source.elevation
    parts = [
        pd.DataFrame(
            {
                "time_s": segment.start_us / MICROSECONDS + np.arange(len(segment)) / segment.rate_hz,
                "elevation_deg": segment.elevation_deg,
                "valid": segment.valid,
            }
        )
        for segment in elevation.segments
    ]
    return pd.concat(parts, ignore_index=True)


def tabulate_exposure(exposure: Exposure) -> dict[str, pd.DataFrame]:
    """Return each set of figures as a table.

    Parameters
    ----------
    exposure
        The exposure of an analysis.

    Returns
    -------
    dict
        Tables by their names in ``results.json``, with the limits of each interval in the columns ``low``
        and ``high``. ``intervals`` contains the intervals of figures without such columns, by the name of
        the figure. Parts of the day have the columns of the tables of a run: ``time_above_60_percent``,
        ``time_above_60_percent_low`` and so on.
    """
    tables = {
        "bins": _tabulate(exposure.bins),
        "time_above": _tabulate(exposure.time_above),
        "percentiles_deg": pd.DataFrame(
            {"percentile": exposure.percentiles_deg.keys(), "angle_deg": exposure.percentiles_deg.values()}
        ),
        "entries": _tabulate(exposure.entries),
        "cycles": _tabulate(exposure.cycles),
        "episodes": _tabulate(exposure.episodes),
        "velocity_dps": _tabulate_named(exposure.velocity_dps, "kind"),
        "windows": _tabulate(exposure.peak_windows),
        "by_hour": _tabulate_parts(exposure.by_hour),
        "by_period": _tabulate_parts(exposure.by_period),
        "by_task": _tabulate_parts(exposure.by_task),
        "by_mark": _tabulate_parts(exposure.by_mark),
        "by_posture": _tabulate_parts(exposure.by_posture),
        "intervals": _tabulate_named(exposure.intervals, "figure"),
    }
    return {name: table for name, table in tables.items() if len(table)}


def _tabulate(rows: Iterable[Any]) -> pd.DataFrame:
    return pd.DataFrame([_flatten(asdict(row)) for row in rows])


def _tabulate_named(rows: Mapping[str, Any], name: str) -> pd.DataFrame:
    return pd.DataFrame([{name: key} | _flatten(asdict(row)) for key, row in rows.items() if row is not None])


def _tabulate_parts(parts: Iterable[PartExposure]) -> pd.DataFrame:
    rows = []
    for part in parts:
        row = asdict(part)
        angles, shares, intervals = (
            row.pop(key) for key in ("percentiles_deg", "time_above_percent", "intervals")
        )
        figures = {f"elevation_p{percent}_deg": angle for percent, angle in angles.items()}
        figures |= {f"time_above_{threshold:g}_percent": share for threshold, share in shares.items()}
        ends = {f"{name}_{end}": value for name, one in intervals.items() for end, value in one.items()}
        row["excluded_as"] = row.pop("reason")
        rows.append(row | figures | ends)
    return pd.DataFrame(rows)


def _flatten(row: dict[str, Any]) -> dict[str, Any]:
    """Flatten an interval or a set of percentiles into separate columns."""
    flat: dict[str, Any] = {}
    for name, value in row.items():
        if name == "interval":
            flat |= value or {"low": None, "high": None}
        elif isinstance(value, dict):
            flat |= {f"{name}_{key}": inner for key, inner in value.items()}
        else:
            flat[name] = value
    return flat
