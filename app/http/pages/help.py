"""Help: poses, exports, problem and warning codes, an example, a sample shift, the API documentation.

The example is the report of a simulated full shift. ``python -m benchmarks.example`` writes its results,
which are part of the package; a test compares them with the engine.
"""

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from functools import cache
from math import sin
from pathlib import Path
from typing import Any, cast

from fastapi import APIRouter, FastAPI, Request, Response
from fastapi.responses import JSONResponse
from markupsafe import Markup, escape

from acromion.app.errors import NotHere, find_outcome_of_code, list_refusals
from acromion.app.http.api.library.files import respond_with_file
from acromion.app.http.pages.recording.figures import FigureTable, build_figures
from acromion.app.http.pages.recording.page_one import PageOne
from acromion.app.http.pages.rendering import UsedPage, add_navigation_of_query
from acromion.app.http.pages.views import build_answer
from acromion.app.intake import Intake
from acromion.app.report.charts.day import Day, DayLabels, Mark, MinuteBand, build_day_labels, draw_day
from acromion.app.report.charts.profile import (
    TileScale,
    UncertaintyBar,
    UncertaintyChart,
    draw_tile,
    draw_uncertainty,
)
from acromion.app.report.charts.svg import NARROW, WIDE
from acromion.app.report.export.results import decode_results
from acromion.app.report.figures import load_results
from acromion.app.report.model import Report, format_brief
from acromion.app.report.render.html import find_template_folder, render_html
from acromion.app.report.single.report import build_report
from acromion.app.report.words.messages import describe_flag, describe_problem, find_flag_codes
from acromion.app.report.words.numbers import (
    Clock,
    format_duration,
    format_number,
    format_percent,
    percent_sign,
)
from acromion.app.report.words.wording import Language, Words, fill, find_other_language, load_wording
from acromion.app.request import ReportRequest
from acromion.app.version import find_import_folder
from acromion.fusion.devices import KNOWN_DEVICES
from acromion.fusion.recording import QualityFlag

SAMPLE_HOURS = "1"
SAMPLE_SUBJECT = "DEMO"
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
"""Events that a person may notice, with their codes without "E-"; all other codes are for operators."""

router = APIRouter(include_in_schema=False)


@router.get("/help")
def show_help(page: UsedPage) -> Response:
    """List the help topics."""
    titles = {code: describe_problem(code, {}, page.language).title for code in _find_codes()}
    happened = [
        (key, [(code, titles.pop(code)) for code in map("E-{}".format, names.split())])
        for key, names in HAPPENED.items()
    ]
    warnings = [(code, describe_flag(QualityFlag(code), page.language).title) for code in find_flag_codes()]
    happened += [("caveat", warnings), ("operation", list(titles.items()))]
    return page.render("help/help.html", happened=happened)


@router.get("/help/poses")
def show_poses(page: UsedPage) -> Response:
    """Show the calibration poses on one page for printing."""
    return page.render("help/poses.html", poses=POSES)


@router.get("/help/reading")
def show_reading(page: UsedPage) -> Response:
    """Explain page 1 of a report with its own drawings, method, limits and glossary."""
    return page.render("help/reading.html", pictures=draw_example(page.language))


@router.get("/help/export")
def show_export(page: UsedPage) -> Response:
    """Show which file to export from the software of each device."""
    return page.render(
        "help/export.html", known=[one.name for one in KNOWN_DEVICES if one.form in ("table", "zip")]
    )


@router.get("/problems/{code}")
def show_problem_page(code: str, page: UsedPage) -> Response:
    """Show the explanation of a problem code or warning code."""
    if code in find_flag_codes():
        caveat = describe_flag(QualityFlag(code), page.language)
        return page.render("help/problem.html", code=code, problem=caveat, fix="")
    if code not in _find_codes():
        raise NotHere
    problem, retryable = describe_problem(code, {}, page.language), find_outcome_of_code(code).retryable
    return page.render("help/problem.html", code=code, problem=problem, fix=problem.fix, retryable=retryable)


def _find_codes() -> list[str]:
    """Return every code once; a class without its own code shares its parent's."""
    return sorted({refusal.code for refusal in list_refusals()})


@router.post("/sample")
def analyse_sample(page: UsedPage) -> Response:
    """Simulate an hour recorded by a GT9X Link, and analyse it like any other recording."""
    services = page.services
    with tempfile.TemporaryDirectory() as folder:
        arguments = ["simulate", folder, "--device", "gt9x", "--hours", SAMPLE_HOURS, "--seed", "1"]
        command = [sys.executable, "-P", "-m", "acromion", *arguments]
        path = os.pathsep.join(filter(None, [find_import_folder(), os.environ.get("PYTHONPATH")]))
        environment = os.environ | {"PYTHONPATH": path}
        subprocess.run(command, check=True, capture_output=True, env=environment)  # noqa: S603 - our own command
        (log,) = Path(folder).glob("*.gt3x")
        asked = ReportRequest(
            log.name,
            SAMPLE_SUBJECT,
            "right",
            languages=(page.language, find_other_language(page.language)),
            paper=services.settings.paper,
            appendix=services.settings.appendix,
            pose_held="start",
        )
        job = Intake(services.store, services.storage, services.settings).add(log, asked, "web")
    return page.go(f"/analyses/{job.id}")


def find_example() -> Path:
    """Return the path of the example's results."""
    return find_template_folder().parent / "example" / "results.json"


@cache
def _build_example(language: Language) -> Report:
    kept = decode_results(find_example().read_bytes())
    return build_report(kept.findings, kept.subject, language)


@router.get("/example")
def show_example(page: UsedPage) -> Response:
    """Show answer, day and figures of the example like the page of a recording."""
    report, results = _build_example(page.language), load_results(find_example().read_bytes())
    answer = build_answer(results, format_brief(report).decode())
    figures = FigureTable(build_figures(results, None, page.language))
    return page.render("help/example.html", page_one=PageOne(report), answer=answer, figures=figures)


@router.get("/example/report.html")
def show_example_report(page: UsedPage) -> Response:
    """Show the report of the example."""
    return add_navigation_of_query(page, render_html(_build_example(page.language)).decode(), "/example")


@router.get("/example/report.pdf")
def get_example_pdf(page: UsedPage) -> Response:
    """Return the PDF report of the example, on the paper of this installation."""
    from acromion.app.report.render.pdf import render_pdf  # noqa: PLC0415  slow import

    attached = {"results.json": find_example().read_bytes()}
    report, settings = _build_example(page.language), page.services.settings
    body = render_pdf(report, attached, settings.paper, has_appendix=settings.appendix)
    return respond_with_file(body, "application/pdf", "acromion-example.pdf")


# The drawings of "How to read this": those of page 1, for an invented day.

SHARE, SHARE_RANGE, SHARE_POSE, PUBLISHED = 12.0, (9.0, 16.0), (16.0, 22.0), 10.0
END = 40.0
SHARE_DAYS, SHARE_TOGETHER = (8.0, 16.0), (7.0, 23.0)
"""The value ± 1.96 × 2.0 points, and with the range and the pose (docs/profile.md), rounded to 1 percent."""
MINUTES, BREAK, HOLE, WORST = 240, (110, 130), (185, 195), (150, 165)
LONGEST_S = 24.0


def draw_example(language: Language) -> Mapping[str, str]:
    """Draw a tile's scale, the day (wide and narrow) and the uncertainty; the values are invented."""
    words, picture = load_wording(language), load_wording(language, "help")["reading"]["picture"]
    scale = TileScale(
        key="example",
        words=(picture["tile_title"], picture["tile"]),
        end=END,
        end_label=_format_percents((END,), language),
        measured=SHARE,
        interval=SHARE_RANGE,
        pose=SHARE_POSE,
        published=(PUBLISHED,),
        published_label=_format_percents((PUBLISHED,), language),
    )
    entry = words["profile"]["sure"]
    most = fill(entry["up_to"], {"high": _format_percents(SHARE_POSE[1:], language)})
    sureness = UncertaintyChart(
        words=(picture["sure_title"], picture["sure"]),
        measured=SHARE,
        end=END,
        end_label=_format_percents((END,), language),
        doubts=(
            UncertaintyBar(
                entry["combined"],
                _format_percents(SHARE_TOGETHER, language),
                SHARE_TOGETHER,
                is_combined=True,
            ),
            UncertaintyBar(
                entry["angle"],
                _format_percents(SHARE_RANGE, language),
                SHARE_RANGE,
            ),
            UncertaintyBar(entry["pose"], most, (SHARE, SHARE_POSE[1]), is_pose=True),
            UncertaintyBar(entry["days"], _format_percents(SHARE_DAYS, language), SHARE_DAYS),
        ),
        level=PUBLISHED,
        level_label=_format_percents((PUBLISHED,), language),
    )
    day = _build_day(words, picture, language)
    drawn = {"day": draw_day(*day, WIDE), "day_narrow": draw_day(*day, NARROW)}
    return {"tile": draw_tile(scale), **drawn, "sure": draw_uncertainty(sureness)}


def _build_day(words: Words, picture: Words, language: Language) -> tuple[Day, DayLabels]:
    def band(minute: int) -> MinuteBand:
        middle = 24 + 9 * sin(minute / 9) + 5 * sin(minute / 2.3)
        above = 62.0 if WORST[0] <= minute < WORST[1] else 18 + 14 * sin(minute / 5) ** 2
        return MinuteBand(60.0 * minute, 60.0 * (minute + 1), middle / 3, middle, middle + above)

    edges = (0, *BREAK, *HOLE, MINUTES)
    runs = tuple(tuple(map(band, range(a, b))) for a, b in zip(edges[::2], edges[1::2], strict=True))
    day = Day(
        duration_s=60.0 * MINUTES,
        clock=Clock(datetime.fromisoformat("2026-03-02T08:00:00"), language),
        runs=runs,
        marks=(
            Mark(60.0 * BREAK[0], 60.0 * BREAK[1], "left out", picture["break"]),
            Mark(60.0 * HOLE[0], 60.0 * HOLE[1], "missing", words["day"]["missing"]),
        ),
        worst=(60.0 * WORST[0], 60.0 * WORST[1]),
        longest_start_s=60.0 * 157,
    )
    labels = build_day_labels(picture["day_title"], picture["day"], words)
    worst = fill(words["day"]["worst"], {"percent": format_percent(2 * SHARE, language)})
    longest = fill(words["day"]["longest"], {"duration": format_duration(LONGEST_S, language)})
    return day, replace(labels, worst=worst, longest=longest)


def _format_percents(shares: Sequence[float], language: Language) -> str:
    """Format one percentage, or a range of two, as whole numbers."""
    return "–".join(format_number(share, 0, language) for share in shares) + percent_sign(language)


# The OpenAPI document as a page that loads nothing from other hosts.

_QUOTED = re.compile(r"``(.+?)``")


@dataclass(frozen=True, slots=True)
class Operation:
    """One operation: its name, description in paragraphs, parameters, request and responses."""

    id: str
    title: str
    paragraphs: tuple[Markup, ...]
    parameters: tuple[tuple[str, str, Markup], ...]
    bodies: str
    answers: str


@router.get("/api/v1/openapi.json")
def get_openapi_document(request: Request) -> JSONResponse:
    """Return the OpenAPI document."""
    return JSONResponse(cast("FastAPI", request.app).openapi())


@router.get("/api/v1/docs")
def show_docs(page: UsedPage) -> Response:
    """Show every operation of the API."""
    document: dict[str, Any] = cast("FastAPI", page.request.app).openapi()
    operations = [
        Operation(
            operation["operationId"],
            f"{method.upper()} {path}",
            tuple(_mark_code(part) for part in operation.get("description", "").split("\n\n")),
            tuple(
                (p["name"], p["in"], _mark_code(p.get("description", "")))
                for p in operation.get("parameters", ())
                if p["in"] != "path"
            ),
            ", ".join(operation.get("requestBody", {}).get("content", {})),
            ", ".join(operation["responses"]),
        )
        for path, methods in document["paths"].items()
        for method, operation in methods.items()
    ]
    return page.render("help/api_docs.html", operations=operations)


def _mark_code(text: str) -> Markup:
    """Convert text between double backticks to code elements."""
    return Markup(_QUOTED.sub(r"<code>\1</code>", str(escape(text))))  # noqa: S704 - escaped before
