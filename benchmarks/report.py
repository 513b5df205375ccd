"""How long a report takes: HTML and PDF in one language from a finished analysis, warm and in a new process.

    python -m benchmarks.report [--hours 8] [--runs 20]

The analysis is that of a simulated shift. Warm: the median of many reports in one process. Cold: the wall
time of a new process that reads the values of the report, imports what is needed and writes both files; and
of one that reads the whole finished analysis, for which Python must import the science too.
"""

import argparse
import io
import pickle
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from statistics import median

from app.report.content import build_report
from app.report.exports import export_results
from app.report.html import render_html
from app.report.pdf import render_pdf
from app.report.results import build_results, encode_results
from app.report.wording import load_wording
from app.request import ReportRequest
from app.workflow import describe_subject
from fusion.pipeline import Analysis, analyse
from fusion.readers import read_recording
from fusion.simulation import simulate_shift, write_shift

_COLD = """
import pickle, sys
kept, results = pickle.load(open(sys.argv[1], "rb"))
from app.report.content import build_report
from app.report.html import render_html
from app.report.pdf import render_pdf
report = build_report(*kept, "en") if isinstance(kept, tuple) else kept
open(sys.argv[1] + ".html", "wb").write(render_html(report))
open(sys.argv[1] + ".pdf", "wb").write(render_pdf(report, {"results.json": results}))
"""


def analyse_shift(folder: Path, hours: float) -> Analysis:
    """Simulate a shift and analyse it."""
    log = write_shift(folder, simulate_shift("gt9x", hours, seed=1), actilife_csv=False)[0]
    return analyse(read_recording(io.BytesIO(log.read_bytes()), file_name=log.name))


def time_warm(analysis: Analysis, runs: int) -> dict[str, float]:
    """Give the median milliseconds of each part of a report."""
    subject = describe_subject(ReportRequest("shift.gt3x", "S012", "right"))
    took: dict[str, list[float]] = {"values": [], "HTML": [], "PDF": [], "tables": []}
    for _ in range(runs + 1):
        moments = [time.perf_counter()]
        report = build_report(analysis, subject, "en")
        moments.append(time.perf_counter())
        render_html(report)
        moments.append(time.perf_counter())
        render_pdf(report, {"results.json": encode_results(analysis, subject)})
        moments.append(time.perf_counter())
        export_results(build_results(analysis, subject))
        moments.append(time.perf_counter())
        for part, begin, end in zip(took.values(), moments, moments[1:], strict=False):
            part.append(1000 * (end - begin))
    return {name: median(part[1:]) for name, part in took.items()}


def shorten_samples(analysis: Analysis) -> Analysis:
    """Keep one second of samples: a report is made of figures, and reading them back is not its work."""
    segment, angles = analysis.recording.segments[0], analysis.elevation.segments[0]
    few = replace(segment, acc_g=segment.acc_g[:100], gyr_dps=segment.gyr_dps[:100])
    short = replace(angles, elevation_deg=angles.elevation_deg[:100], valid=angles.valid[:100], vertical=None)
    return replace(
        analysis,
        recording=replace(analysis.recording, segments=(few,)),
        elevation=replace(analysis.elevation, segments=(short,)),
    )


def time_cold(kept: object, results: bytes, folder: Path, runs: int) -> float:
    """Give the median seconds of a new process that makes HTML and PDF of what was kept."""
    file = folder / "kept.pickle"
    file.write_bytes(pickle.dumps((kept, results)))
    took = []
    for _ in range(runs + 1):
        began = time.perf_counter()
        subprocess.run([sys.executable, "-c", _COLD, str(file)], check=True)
        took.append(time.perf_counter() - began)
    return median(took[1:])


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--hours", type=float, default=8.0)
    parser.add_argument("--runs", type=int, default=20)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        analysis = analyse_shift(Path(temporary), arguments.hours)
        warm = time_warm(analysis, arguments.runs)
        subject = describe_subject(ReportRequest("shift.gt3x", "S012", "right"))
        results = encode_results(analysis, subject)
        values = replace(build_report(analysis, subject, "en"), words=dict(load_wording("en")["label"]))
        cold_s = time_cold(values, results, Path(temporary), 5)
        whole_s = time_cold((shorten_samples(analysis), subject), results, Path(temporary), 5)
    total = warm["values"] + warm["HTML"] + warm["PDF"]
    told = ", ".join(f"{name} {ms:.0f} ms" for name, ms in warm.items())
    print(f"warm, one language: HTML + PDF {total:.0f} ms ({told})")
    print(f"new process: from the values {cold_s:.2f} s, from the analysis {whole_s:.2f} s")


if __name__ == "__main__":
    main()
