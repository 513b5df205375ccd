"""The day of one analysis: its curve in pieces, how still a window is, the diary, and another analysis."""

from dataclasses import asdict
from typing import Annotated, Any

import numpy as np
from fastapi import APIRouter, Query, Request, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import JSONResponse, RedirectResponse
from starlette.status import HTTP_303_SEE_OTHER

from app.api.results import borrow_file
from app.api.services import Services, UsedServices
from app.day_file import NAME, DayFile, open_day
from app.errors import NoSuchFile
from app.jobs.job import Job, JobState
from app.web.clock_times import DayClock, place_rows
from app.web.corrections import BOM, COLUMNS, correct_request, read_rows, write_csv
from app.web.forms import read_body, read_form
from app.web.rendering import find_base
from fusion.calibration_rules import rules_for, score_still_period
from fusion.diary import read_diary

MOST_POINTS = 4000

router = APIRouter(include_in_schema=False, prefix="/analyses/{analysis_id}")
Second = Annotated[float, Query(ge=0, le=1e8)]


@router.get("/curve")
def curve(
    analysis_id: str,
    services: UsedServices,
    from_s: Second,
    to_s: Second,
    points: Annotated[int, Query(ge=1, le=MOST_POINTS)] = 1200,
) -> Response:
    """Give the lowest and highest angle in each of about ``points`` pieces of a stretch."""
    day = find_day(services, services.store.get(analysis_id))
    stretches = [asdict(stretch) for stretch in day.cut(from_s, to_s, points)]
    return JSONResponse({"stretches": stretches})


@router.get("/stillness")
def stillness(analysis_id: str, services: UsedServices, start_s: Second, end_s: Second) -> dict[str, Any]:
    """Say how still the arm was in a window, as the calibration scores it: 0 to 1, or null in a hole."""
    day = find_day(services, services.store.get(analysis_id))
    quiet = day.measure_quiet(start_s, end_s)
    if quiet is None:
        return {"score": None}
    gravity_g, sd_g = quiet
    score = score_still_period(end_s - start_s, sd_g, np.asarray(gravity_g), rules_for(day.facts["device"]))
    return {"score": round(score, 3)}


@router.post("/again")
async def analyse_again(analysis_id: str, request: Request, services: UsedServices) -> Response:
    """Analyse the recording once more, as corrected on the page; the earlier analysis stays as it is."""
    form = await read_form(request)
    job = await run_in_threadpool(services.store.get, analysis_id)
    clock = DayClock.of(find_day(services, job).facts)
    corrected = correct_request(job.request, form, clock)
    recording = (job.recording_id, job.sha256)
    again = await run_in_threadpool(services.store.add_analysis, recording, corrected, "web")
    address = f"{find_base(request)}/analyses/{again.id}?before={job.id}"
    return RedirectResponse(address, HTTP_303_SEE_OTHER)


@router.post("/diary")
async def import_diary(analysis_id: str, request: Request, services: UsedServices) -> list[dict[str, Any]]:
    """Read a diary as CSV and give its rows as the form shows them; nothing is changed."""
    body = await read_body(request)
    job = await run_in_threadpool(services.store.get, analysis_id)
    return place_rows(read_diary(body), DayClock.of(find_day(services, job).facts))


@router.post("/diary.csv")
async def export_diary(analysis_id: str, request: Request, services: UsedServices) -> Response:
    """Give the rows of the form as a diary, for another recording or another program."""
    form = await read_form(request)
    job = await run_in_threadpool(services.store.get, analysis_id)
    rows = place_rows(read_rows(form), DayClock.of(find_day(services, job).facts))
    body = write_csv([tuple(row[name] for name in COLUMNS) for row in rows], bom=BOM)
    headers = {"Content-Disposition": 'attachment; filename="diary.csv"'}
    return Response(body, media_type="text/csv; charset=utf-8", headers=headers)


def find_day(services: Services, job: Job) -> DayFile:
    """Open the day of a finished analysis.

    Raises
    ------
    NoSuchFile, ResultDamaged
    """
    if job.state is not JobState.SUCCEEDED:
        raise NoSuchFile(name=NAME)
    with borrow_file(services, job, NAME) as path:
        return open_day(path)
