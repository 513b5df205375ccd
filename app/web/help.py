"""Help: the poses, which file to export, each code of a refusal or a warning, an example, a sample shift.

The example is the report of a whole simulated shift. ``python -m benchmarks.example``
makes its results, which are shipped; a test holds them against the engine.
"""

import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from functools import cache
from pathlib import Path

from fastapi import APIRouter, Response

from app.errors import NotHere, find_outcome_of_code, list_refusals
from app.intake import Intake
from app.report.analysis.report import build_report
from app.report.export.results import decode_results
from app.report.figures import load_results
from app.report.model import Report
from app.report.render.brief import format_brief
from app.report.render.html import find_template_folder, render_html
from app.report.words.messages import describe_flag, describe_problem, find_flag_codes
from app.report.words.wording import Language, find_other_language
from app.request import ReportRequest
from app.web.reading import draw_example
from app.web.recording.page_one import PageOne
from app.web.rendering import UsedPage
from app.web.reports import lay_way_of_query
from app.web.views import build_answer
from fusion.devices import KNOWN_DEVICES
from fusion.recording import QualityFlag

SAMPLE_HOURS = "1"
SAMPLE_SUBJECT = "DEMO"
_CODE = str(Path(__file__).resolve().parents[2])
POSES = ("n-pose", "side-lean", "two-point")

HAPPENED: Mapping[str, str] = {
    "file": (
        "TYPE EXT EMPTY BLANK NO-SAMPLES NO-GYRO NO-GRAVITY EPOCH GT3X-OLD GT3X-PART COLS "
        "SENSORS SEGMENT PROFILE ROW DECIMAL UNIT ANGLE TIME RATE EXCEL-CUT CORRUPT ZIP-CRC "
        "ZIP-TRUNC ZIP-UNSAFE XML READER UNREADABLE"
    ),
    "recording": "SHORT LONG DEAD MIXED SCALE SWAPPED JOIN UNUSABLE",
    "said": "CALIBRATION AXIS DIARY PARTICIPANTS TASKS LIST SETTINGS PARAMETER",
    "upload": "UPLOAD BIG CUT-UPLOAD DIGEST SLOW TOO-MANY BUSY DISK",
    "stopped": (
        "STOPPED INTERRUPTED TIMEOUT MEMORY CRASHED INTERNAL RESULT-DAMAGED STORE-DAMAGED NOT-FOUND PURGED"
    ),
    "two": "PAIR COMPARE DAYS COMPARISON OVERLAP ALIGN REFERENCE STUDY",
}
"""What a person sees happen, and the codes behind it without their "E-"; the others are for operators."""

router = APIRouter(include_in_schema=False)


def find_happened(key: str) -> list[str]:
    """Return the codes behind what a person sees."""
    return [f"E-{name}" for name in HAPPENED[key].split()]


@router.get("/help")
def show_help(page: UsedPage) -> Response:
    """List what help there is."""
    titles = {code: describe_problem(code, {}, page.language).title for code in _find_codes()}
    happened = [(key, [(code, titles.pop(code)) for code in find_happened(key)]) for key in HAPPENED]
    warnings = [(code, describe_flag(QualityFlag(code), page.language).title) for code in find_flag_codes()]
    happened += [("caveat", warnings), ("operation", list(titles.items()))]
    return page.render("help.html", happened=happened)


@router.get("/help/poses")
def show_poses(page: UsedPage) -> Response:
    """Explain the calibration poses, on one page to print."""
    return page.render("poses.html", poses=POSES)


@router.get("/help/reading")
def show_reading(page: UsedPage) -> Response:
    """Explain page 1 of a report by its own drawings, with method, limits and glossary."""
    return page.render("reading.html", pictures=draw_example(page.language))


@router.get("/help/export")
def show_export(page: UsedPage) -> Response:
    """Say which file to take from the device's own software."""
    return page.render(
        "export.html", known=[one.name for one in KNOWN_DEVICES if one.form in ("table", "zip")]
    )


@router.get("/problems/{code}")
def show_problem_page(code: str, page: UsedPage) -> Response:
    """Explain the code of a refusal or of a warning."""
    if code in find_flag_codes():
        caveat = describe_flag(QualityFlag(code), page.language)
        return page.render("problem.html", code=code, problem=caveat, fix="")
    if code not in _find_codes():
        raise NotHere
    problem, retryable = describe_problem(code, {}, page.language), find_outcome_of_code(code).retryable
    return page.render("problem.html", code=code, problem=problem, fix=problem.fix, retryable=retryable)


def _find_codes() -> list[str]:
    """Return every code once; a class without one of its own shares its parent's."""
    return sorted({refusal.code for refusal in list_refusals()})


@router.post("/sample")
def take_sample(page: UsedPage) -> Response:
    """Simulate an hour of work as a GT9X Link records it, and analyse it like any other recording."""
    services = page.services
    with tempfile.TemporaryDirectory() as folder:
        arguments = ["simulate", folder, "--device", "gt9x", "--hours", SAMPLE_HOURS, "--seed", "1"]
        command = [sys.executable, "-P", "-m", "app", *arguments]
        path = os.pathsep.join(filter(None, [_CODE, os.environ.get("PYTHONPATH")]))
        environment = os.environ | {"PYTHONPATH": path}
        subprocess.run(command, check=True, capture_output=True, env=environment)  # noqa: S603 - our own
        (log,) = Path(folder).glob("*.gt3x")
        asked = ReportRequest(
            log.name,
            SAMPLE_SUBJECT,
            "right",
            languages=(page.language, find_other_language(page.language)),
            paper=services.settings.paper,
            pose_held="start",
        )
        job = Intake(services.store, services.storage, services.settings).add(log, asked, "web")
    return page.go(f"/analyses/{job.id}")


def find_example() -> Path:
    """Find the results of the example."""
    return find_template_folder().parent / "example" / "results.json"


@cache
def _build_example(language: Language) -> Report:
    kept = decode_results(find_example().read_bytes())
    return build_report(kept.findings, kept.subject, language)


@router.get("/example")
def show_example(page: UsedPage) -> Response:
    """Show page 1 of the example as a recording's page shows it."""
    report, results = _build_example(page.language), load_results(find_example().read_bytes())
    answer = build_answer(results, format_brief(report).decode(), page.language)
    return page.render("example.html", page_one=PageOne(report, (), ()), answer=answer)


@router.get("/example/report.html")
def show_example_report(page: UsedPage) -> Response:
    """Return the report of the example."""
    return lay_way_of_query(page, render_html(_build_example(page.language)).decode(), "/example")


@router.get("/example/report.pdf")
def get_example_pdf(page: UsedPage) -> Response:
    """Return the report of the example as a PDF, on the paper of this installation."""
    from app.report.render.pdf import render_pdf  # noqa: PLC0415  heavy, and only this needs it

    attached = {"results.json": find_example().read_bytes()}
    body = render_pdf(_build_example(page.language), attached, page.services.settings.paper)
    headers = {"Content-Disposition": 'attachment; filename="acromion-example.pdf"'}
    return Response(body, media_type="application/pdf", headers=headers)
