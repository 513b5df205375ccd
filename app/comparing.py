"""One finished analysis beside another, from their ``results.json``; made in a child process."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from app.report.elevation_csv import encode_elevation_csv
from app.request import OnStage, ReportRequest
from fusion.comparison import SOURCE, ComparedDay, compare_days

if TYPE_CHECKING:
    from fusion.exposure import Exposure

_FILTERED_FROM_HZ = 20.0


@dataclass(frozen=True, slots=True)
class _Above:
    threshold_deg: float
    percent: float


@dataclass(frozen=True, slots=True)
class _Entries:
    threshold_deg: float
    per_hour: float


@dataclass(frozen=True, slots=True)
class _Figures:
    """What :func:`fusion.comparison.compare_days` looks at, as it stands in a results document."""

    time_above: tuple[_Above, ...]
    percentiles_deg: Mapping[float, float]
    entries: tuple[_Entries, ...]
    analysed_s: float
    metric_filter_hz: float | None


def write_comparison(log: Path, _request: ReportRequest, out: Path, on_stage: OnStage) -> None:
    """Compare the two results in the list ``log``: ``comparison.json`` in ``out``."""
    on_stage("counting", 0.0)
    before, after = json.loads(log.read_bytes())
    compared = compare_days(_take_day(before), _take_day(after))
    figures = [
        {
            name: round(value, 6) if isinstance(value, float) else value
            for name, value in asdict(change).items()
        }
        for change in compared.changes
    ]
    told = {"figures": figures, "differences": list(compared.differences), "source": SOURCE}
    (out / "comparison.json").write_text(json.dumps(told), "utf-8")


def write_elevation_csv(log: Path, _request: ReportRequest, out: Path, on_stage: OnStage) -> None:
    """Write the angles of the Parquet file ``log`` as ``elevation.csv.gz`` in ``out``."""
    on_stage("rendering", 0.0)
    (out / "elevation.csv.gz").write_bytes(encode_elevation_csv(log))


def _round(value: object) -> object:
    return round(value, 6) if isinstance(value, float) else value


def _take_day(results: Mapping[str, Any]) -> ComparedDay:
    exposure, recording, method = results["exposure"], results["recording"], results["method"]
    is_filtered = recording["device"] != "angles" or recording["rate_hz"] >= _FILTERED_FROM_HZ
    figures = _Figures(
        time_above=tuple(_Above(row["threshold_deg"], row["percent"]) for row in exposure["time_above"]),
        percentiles_deg={float(p): value for p, value in exposure["percentiles_deg"].items()},
        entries=tuple(_Entries(row["threshold_deg"], row["per_hour"]) for row in exposure["entries"]),
        analysed_s=results["time"]["analysed_s"],
        metric_filter_hz=5.0 if is_filtered else None,
    )
    return ComparedDay(
        exposure=cast("Exposure", figures),
        method=f"{method['name']} {method['version']}" if method else "",
        pose=results["calibration"]["pose"] if results["calibration"] else "",
        side=recording["side"],
        verdict=results["quality"]["verdict"],
    )
