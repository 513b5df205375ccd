"""Pages of two: both arms of one shift, one visit beside another."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Depends, Query, Request, Response
from fastapi.responses import FileResponse, RedirectResponse
from pydantic import BaseModel, Field

from app.api.guard import REPORT_POLICY
from app.api.services import Services, UsedLanguage, UsedServices
from app.jobs.job import Job
from app.report.beside import load_beside_words
from app.report.wording import Language, load_wording
from app.web.beside import BesideRequest, Kind, read_figures, read_sentences, set_beside
from app.web.others import list_trunks
from app.web.rendering import find_base, show_page

router = APIRouter(include_in_schema=False)
SETTINGS = frozenset({"method", "pose", "metric filter"})


class TrunkWish(BaseModel):
    """Offsets as people type them, and the analysis of the trunk."""

    offset_s: Annotated[str, Field(max_length=20)] = ""
    trunk: Annotated[str, Field(max_length=40)] = ""
    trunk_offset_s: Annotated[str, Field(max_length=20)] = ""


def read_asked(
    kind: Kind, first: str, second: str, services: UsedServices, wish: Annotated[TrunkWish, Query()]
) -> BesideRequest:
    """Read which are asked for; a comparison has neither trunk nor offset."""
    pair = services.store.get(first), services.store.get(second)
    if kind != "pair":
        return BesideRequest(kind, *pair)
    trunk = services.store.get(wish.trunk) if wish.trunk else None
    trunk_offset_s = read_offset(wish.trunk_offset_s) if trunk else None
    return BesideRequest(kind, *pair, read_offset(wish.offset_s), trunk, trunk_offset_s)


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
        "trunk": asked.trunk,
        "trunks": _list_trunks(services, asked, figures),
        "figures": figures,
        "sentences": read_sentences(folder, language),
        "differences": [b["difference"][name] for name in figures.get("differences", ()) if name in SETTINGS],
        "offset": _write_offset(asked.offset_s),
        "trunk_offset": _write_offset(asked.trunk_offset_s),
        "trunk_limit": load_beside_words(language)["pair"]["trunk"]["limit"],
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


def _list_trunks(services: Services, asked: BesideRequest, figures: Mapping[str, Any]) -> tuple[Job, ...]:
    """Offer what may be of the trunk; what was chosen is always among it."""
    if asked.kind != "pair":
        return ()
    found = list_trunks(services, asked.first, asked.second, figures["left"].get("start") or "")
    chosen = (asked.trunk,) if asked.trunk and asked.trunk.id not in {job.id for job in found} else ()
    return (*chosen, *found)


def _write_offset(seconds: float | None) -> str:
    return "" if seconds is None else f"{seconds:g}"


def _name(asked: BesideRequest, language: Language) -> str:
    subject = "".join(c for c in asked.first.request.subject if c.isalnum() or c in "-_") or "report"
    return f"{subject}_{asked.kind}.{language}.pdf"
