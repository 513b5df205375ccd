"""``validation.csv``: one row for each task, each class of elevation and speed, and for everything."""

from collections.abc import Iterator, Mapping
from typing import Any

from app.report.tables import Row, encode_table

STATISTICS = (
    "r",
    "rmse_deg",
    "mean_absolute_error_deg",
    "bias_deg",
    "loa_low_deg",
    "loa_high_deg",
    "sd_deg",
    "icc",
    "concordance",
    "samples",
    "duration_s",
)
COLUMNS = ("subject", "device", "kind", "name", "lower", "upper", "paper_task", "repetitions", *STATISTICS)


def encode_agreement_table(validation: Mapping[str, Any]) -> bytes:
    """Write the statistics as CSV; empty is "not computable"."""
    return encode_table(COLUMNS, list_rows(validation))


def list_rows(validation: Mapping[str, Any]) -> Iterator[Row]:
    """Give the rows: ``kind`` is overall, task, elevation or speed; edges in deg or deg/s."""
    shared = {"subject": validation["subject"], "device": validation["recording"]["device"]}
    yield {**shared, "kind": "overall", "name": "overall", **_take(validation["overall"])}
    for task in validation["tasks"]:
        own = {key: task[key] for key in ("name", "paper_task", "repetitions")}
        yield {**shared, "kind": "task", **own, **_take(task)}
    for kind, key, unit in (("elevation", "by_elevation", "deg"), ("speed", "by_speed", "dps")):
        for stratum in validation[key]:
            edges = {edge: stratum[f"{edge}_{unit}"] for edge in ("lower", "upper")}
            yield {**shared, "kind": kind, "name": kind, **edges, **_take(stratum)}


def _take(statistics: Mapping[str, Any]) -> Row:
    return {name: statistics[name] for name in STATISTICS}
