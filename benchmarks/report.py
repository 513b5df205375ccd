"""Measure the time of a report (HTML and PDF, one language), warm and in a new process.

    python -m benchmarks.report [--hours 8] [--runs 20]

The analysis is that of a simulated shift. Warm: the median of many reports in one process. Cold: the wall
time of a new process that reads the stored analysis from its folder and writes both files.
"""

import argparse
import io
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

from acromion.app.report.export.all import export_results
from acromion.app.report.export.results import build_results, encode_results
from acromion.app.report.figures import round_all
from acromion.app.report.findings import Findings, ReportSubject, build_findings
from acromion.app.report.products import describe_subject
from acromion.app.report.render.html import render_html
from acromion.app.report.render.pdf import render_pdf
from acromion.app.report.render.write import RESULTS
from acromion.app.report.single.report import build_report
from acromion.app.request import ReportRequest
from acromion.fusion.pipeline import analyse
from acromion.fusion.readers import read_recording
from acromion.fusion.simulation import simulate_shift, write_shift

_COLD = """
import sys
from pathlib import Path
from acromion.app.report.products import set_report_again
from acromion.app.request import ReportRequest
folder = Path(sys.argv[1])
set_report_again(folder / "results.json", ReportRequest("", languages=("en",)), folder / "again")
"""


def store_shift(folder: Path, hours: float) -> tuple[Findings, ReportSubject]:
    """Simulate a shift, analyse it and store its results."""
    log = write_shift(folder, simulate_shift("gt9x", hours, seed=1), actilife_csv=False)[0]
    findings = build_findings(analyse(read_recording(io.BytesIO(log.read_bytes()), file_name=log.name)))
    subject = describe_subject(ReportRequest(log.name, "S012", "right"), findings)
    (folder / RESULTS).write_bytes(encode_results(findings, subject))
    (folder / "again").mkdir()
    return findings, subject


def time_warm(findings: Findings, subject: ReportSubject, runs: int) -> dict[str, float]:
    """Return the median milliseconds of each part of a report."""
    took: dict[str, list[float]] = {"values": [], "HTML": [], "PDF": [], "tables": []}
    for _ in range(runs + 1):
        moments = [time.perf_counter()]
        report = build_report(findings, subject, "en")
        moments.append(time.perf_counter())
        render_html(report)
        moments.append(time.perf_counter())
        render_pdf(report, {"results.json": encode_results(findings, subject)})
        moments.append(time.perf_counter())
        export_results(round_all(build_results(findings, subject)))
        moments.append(time.perf_counter())
        for part, begin, end in zip(took.values(), moments, moments[1:], strict=False):
            part.append(1000 * (end - begin))
    return {name: median(part[1:]) for name, part in took.items()}


def time_cold(folder: Path, runs: int) -> float:
    """Return the median seconds of a new process that creates HTML and PDF of a finished analysis."""
    took = []
    for _ in range(runs + 1):
        began = time.perf_counter()
        subprocess.run([sys.executable, "-c", _COLD, str(folder)], check=True)
        took.append(time.perf_counter() - began)
    return median(took[1:])


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--hours", type=float, default=8.0)
    parser.add_argument("--runs", type=int, default=20)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        findings, subject = store_shift(Path(temporary), arguments.hours)
        warm = time_warm(findings, subject, arguments.runs)
        cold_s = time_cold(Path(temporary), 5)
    total = warm["values"] + warm["HTML"] + warm["PDF"]
    parts = ", ".join(f"{name} {ms:.0f} ms" for name, ms in warm.items())
    print(f"warm, one language: HTML + PDF {total:.0f} ms ({parts})")
    print(f"new process, from the folder of a finished analysis: {cold_s:.2f} s")


if __name__ == "__main__":
    main()
