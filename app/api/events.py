"""Progress as it happens, for pages that listen (server-sent events). Asking again stays the contract."""

import time
from collections.abc import AsyncIterator

import anyio
from fastapi import APIRouter, Request
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import StreamingResponse

from app.api.problems import PROBLEM_RESPONSES
from app.api.schemas import AnalysisView, view_analysis
from app.api.services import Services, UsedLanguage, UsedServices
from app.report.wording import Language

LOOK_S = 0.25
QUIET_S = 15.0

router = APIRouter(prefix="/api/v1", responses=PROBLEM_RESPONSES, tags=["analyses"])


@router.get(
    "/analyses/{analysis_id}/events",
    response_class=StreamingResponse,
    responses={200: {"content": {"text/event-stream": {}}}},
)
async def follow_analysis(
    analysis_id: str, request: Request, services: UsedServices, language: UsedLanguage
) -> StreamingResponse:
    """Tell every change of an analysis as an event ``analysis`` until it ends."""
    await run_in_threadpool(services.store.get, analysis_id)
    told = _tell_changes(request, services, analysis_id, language)
    return StreamingResponse(told, media_type="text/event-stream")


async def _tell_changes(
    request: Request, services: Services, analysis_id: str, language: Language
) -> AsyncIterator[str]:
    last, spoke_s = "", time.monotonic()
    while not await request.is_disconnected():
        job = await run_in_threadpool(services.store.get, analysis_id)
        event = _write(view_analysis(job, language))
        if event != last:
            last, spoke_s = event, time.monotonic()
            yield event
        elif time.monotonic() - spoke_s > QUIET_S:
            spoke_s = time.monotonic()
            yield ": still here\n\n"
        if job.is_over:
            return
        await anyio.sleep(LOOK_S)


def _write(view: AnalysisView) -> str:
    return f"event: analysis\ndata: {view.model_dump_json(exclude_unset=True)}\n\n"
