"""What is made of finished analyses when somebody asks; done in a child process."""

import json
from pathlib import Path

from app.report.before_after import describe_comparison
from app.report.elevation_csv import encode_elevation_csv
from app.report.findings import decode_findings
from app.request import OnStage, ReportRequest


def write_comparison(log: Path, _request: ReportRequest, out: Path, on_stage: OnStage) -> None:
    """Compare the two findings in the list ``log``: ``comparison.json`` in ``out``."""
    on_stage("counting", 0.0)
    before, after = (decode_findings(json.dumps(kept).encode()) for kept in json.loads(log.read_bytes()))
    (out / "comparison.json").write_text(json.dumps(describe_comparison(before, after)), "utf-8")


def write_elevation_csv(log: Path, _request: ReportRequest, out: Path, on_stage: OnStage) -> None:
    """Write the angles of the Parquet file ``log`` as ``elevation.csv.gz`` in ``out``."""
    on_stage("rendering", 0.0)
    (out / "elevation.csv.gz").write_bytes(encode_elevation_csv(log))
