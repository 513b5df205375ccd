"""Pages of two: both arms of one shift, one visit beside another."""

from dataclasses import replace
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Depends, Query, Request, Response
from fastapi.responses import FileResponse, RedirectResponse

from app.api.guard import REPORT_POLICY
from app.api.services import UsedLanguage, UsedServices
from app.report.beside import load_beside_words
from app.report.wording import Language, load_wording
from app.web.beside import BesideRequest, Kind, read_figures, read_sentences, set_beside
from app.web.rendering import find_base, show_page

router = APIRouter(include_in_schema=False)
SETTINGS = frozenset({"method", "pose", "metric filter"})


def read_asked(
    kind: Kind,
    first: str,
    second: str,
    services: UsedServices,
    offset_s: Annotated[str, Query(max_length=20)] = "",
) -> BesideRequest:
    """Read which two are asked for."""
    return BesideRequest(kind, services.store.get(first), services.store.get(second), read_offset(offset_s))


Asked = Annotated[BesideRequest, Depends(read_asked)]


@router.get("/beside/{kind}")
def show_beside(asked: Asked, request: Request, services: UsedServices, language: UsedLanguage) -> Response:
    """Show two analyses side by side; for a pair, with the offset of the clocks to correct."""
    folder = set_beside(services, asked)
    figures, b = read_figures(folder, asked.kind), load_wording(language, "beside_page")
    values: dict[str, Any] = {
        "kind": asked.kind,
        "first": asked.first,
        "second": asked.second,
        "figures": figures,
        "sentences": read_sentences(folder, language),
        "differences": [b["difference"][name] for name in figures.get("differences", ()) if name in SETTINGS],
        "offset": "" if asked.offset_s is None else f"{asked.offset_s:g}",
        "names": load_beside_words(language)["compare"]["table"]["figure"],
        "b": b,
    }
    return show_page(request, "beside.html", language, values)


@router.get("/beside/{kind}/report.{form}", response_class=FileResponse)
def get_report(
    form: Literal["html", "pdf"], asked: Asked, services: UsedServices, language: UsedLanguage
) -> Response:
    """Give the report of two, to read or to file."""
    path = set_beside(services, asked) / f"report.{language}.{form}"
    if form == "html":
        return FileResponse(path, media_type="text/html", headers={"Content-Security-Policy": REPORT_POLICY})
    return FileResponse(path, media_type="application/pdf", filename=_name(asked, language))


@router.post("/beside/compare/align")
def analyse_alike(first: str, second: str, request: Request, services: UsedServices) -> Response:
    """Analyse the earlier recording by the settings of the later, so that only the work differs."""
    before, after = services.store.get(first), services.store.get(second)
    wish = replace(before.request, method=after.request.method, pose=after.request.pose)
    if len(wish.calibration_windows_s) != len(after.request.calibration_windows_s):
        wish = replace(wish, calibration_windows_s=())
    again = services.store.add_analysis((before.recording_id, before.sha256), wish, "web")
    return RedirectResponse(f"{find_base(request)}/analyses/{again.id}?before={before.id}", status_code=303)


def read_offset(text: str) -> float | None:
    """Read seconds as people write them; nothing, and what is no number, leaves it to the clocks."""
    try:
        seconds = float(text.strip().replace(",", "."))
    except ValueError:
        return None
    return seconds if abs(seconds) <= 172_800 else None


def _name(asked: BesideRequest, language: Language) -> str:
    subject = "".join(c for c in asked.first.request.subject if c.isalnum() or c in "-_") or "report"
    return f"{subject}_{asked.kind}.{language}.pdf"
