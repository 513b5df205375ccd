"""Create the example that the pages show before the first analysis: a simulated shift with its diary.

    python -m benchmarks.example

Writes ``templates/example/results.json`` and the pictures of its page 1 in ``docs``.
``tests/app/report/test_example.py`` compares the results with the engine.
"""

import tempfile
from dataclasses import replace
from pathlib import Path

from acromion.app.http.pages.help import find_example
from acromion.app.report.export.results import encode_results, identify_report
from acromion.app.report.findings import Findings, ReportSubject, Software, build_findings
from acromion.app.report.render.pdf import render_first_page
from acromion.app.report.single.report import build_report
from acromion.app.report.words.wording import Language
from acromion.app.version import software_version, source_revision
from acromion.fusion.diary import read_diary
from acromion.fusion.pipeline import analyse
from acromion.fusion.settings import AnalysisSettings
from acromion.fusion.simulation import simulate_shift, write_shift

DOCS = Path(__file__).resolve().parents[1] / "docs"
PICTURES: dict[Language, str] = {"en": "page1.png", "fr": "page1_fr.png"}
"""Page 1 of the example, for README and the guide."""
DOTS_PER_INCH = 96
HOURS, SEED = 8.0, 2
DIARY = b"""start;end;kind;label
07:10;09:00;task;Transport
09:00;09:15;break;
09:15;11:30;task;Installation
11:30;12:00;break;
12:00;14:50;task;Inspection
"""
# The labels are the same in English and French.
SETTINGS = AnalysisSettings(pose="side-lean", calibration_windows_s=((2.0, 18.0),), diary=read_diary(DIARY))


def analyse_example() -> Findings:
    """Simulate the shift and analyse it; the pose is the side-lean, as the help recommends."""
    with tempfile.TemporaryDirectory() as folder:
        shift = simulate_shift("gt9x", HOURS, seed=SEED)
        log = write_shift(Path(folder), shift, actilife_csv=False)[0]
        return build_findings(analyse(log, SETTINGS))


def main() -> None:
    subject = ReportSubject(
        "example.gt3x", "EXAMPLE", "right", Software(software_version(), source_revision())
    )
    path, findings = find_example(), analyse_example()
    path.parent.mkdir(exist_ok=True)
    subject = replace(subject, report_id=identify_report(SETTINGS, findings, subject))
    path.write_bytes(encode_results(findings, subject))
    print(path.name, path.stat().st_size)
    for language, name in PICTURES.items():
        report = build_report(findings, subject, language)
        (DOCS / name).write_bytes(render_first_page(report, "a4", DOTS_PER_INCH))


if __name__ == "__main__":
    main()
