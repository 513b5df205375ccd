"""Help: the poses, which file to export, each code of a refusal or a warning, and a sample shift to try."""

import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

from fastapi import APIRouter, Request, Response
from fastapi.responses import RedirectResponse

from app.errors import NotHere, find_outcome_of_code, list_refusals
from app.intake import Intake
from app.report.words.messages import describe_flag, describe_problem, find_flag_codes
from app.report.words.wording import Language, find_other_language, load_wording
from app.request import ReportRequest
from app.services import UsedLanguage, UsedServices
from app.web.reading import draw_example
from app.web.rendering import find_base, render_page
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
    """Give the codes behind what a person sees."""
    return [f"E-{name}" for name in HAPPENED[key].split()]


@router.get("/help")
def show_help(request: Request, language: UsedLanguage) -> Response:
    """List what help there is."""
    titles = {code: describe_problem(code, {}, language).title for code in _find_codes()}
    happened = [(key, [(code, titles.pop(code)) for code in find_happened(key)]) for key in HAPPENED]
    warnings = [(code, describe_flag(QualityFlag(code), language).title) for code in find_flag_codes()]
    happened += [("caveat", warnings), ("operation", list(titles.items()))]
    return _render(request, "help.html", language, {"happened": happened})


@router.get("/help/poses")
def show_poses(request: Request, language: UsedLanguage) -> Response:
    """Explain the calibration poses, on one page to print."""
    return _render(request, "poses.html", language, {"poses": POSES})


@router.get("/help/reading")
def show_reading(request: Request, language: UsedLanguage) -> Response:
    """Explain page 1 of a report by its own drawings, with method, limits and glossary."""
    words = load_wording(language, "help")["reading"]
    values = {"r": words, "report": load_wording(language), "pictures": draw_example(language)}
    return _render(request, "reading.html", language, values)


@router.get("/help/export")
def show_export(request: Request, language: UsedLanguage) -> Response:
    """Say which file to take from the device's own software."""
    known = [one.name for one in KNOWN_DEVICES if one.form in ("table", "zip")]
    return _render(request, "export.html", language, {"known": known})


@router.get("/problems/{code}")
def show_problem_page(code: str, request: Request, language: UsedLanguage) -> Response:
    """Explain the code of a refusal or of a warning."""
    if code in find_flag_codes():
        caveat = describe_flag(QualityFlag(code), language)
        return _render(request, "problem.html", language, {"code": code, "problem": caveat, "fix": ""})
    if code not in _find_codes():
        raise NotHere
    problem = describe_problem(code, {}, language)
    values = {
        "code": code,
        "problem": problem,
        "fix": problem.fix,
        "retryable": find_outcome_of_code(code).retryable,
    }
    return _render(request, "problem.html", language, values)


@router.post("/sample")
def take_sample(request: Request, services: UsedServices, language: UsedLanguage) -> Response:
    """Simulate an hour of work as a GT9X Link records it, and analyse it like any other recording."""
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
            languages=(language, find_other_language(language)),
            paper=services.settings.paper,
            pose_held="start",
        )
        job = Intake(services.store, services.storage, services.settings).add(log, asked, "web")
    return RedirectResponse(f"{find_base(request)}/analyses/{job.id}", status_code=303)


def _render(request: Request, template: str, language: Language, values: dict[str, object]) -> Response:
    return render_page(request, template, language, {"h": load_wording(language, "help"), **values})


def _find_codes() -> list[str]:
    """Give every code once; a class without one of its own shares its parent's."""
    return sorted({refusal.code for refusal in list_refusals()})
