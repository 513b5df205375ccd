"""Answering as soon as an analysis ends; waiting for a thread even when cancelled."""

import asyncio
import re
import time
from collections.abc import Callable
from contextlib import suppress
from typing import ParamSpec, TypeVar

import anyio
from fastapi import Request
from fastapi.concurrency import run_in_threadpool

from app.api.services import Services
from app.jobs.job import Job

P = ParamSpec("P")
T = TypeVar("T")

POLL_S = 0.2
LONGEST_WAIT_S = 60.0


async def wait_for_end(request: Request, services: Services, analysis_id: str, wait_s: float) -> Job:
    """Look until the job is over, the time is up or nobody listens any more; blocks nobody else."""
    end_s = time.monotonic() + wait_s
    job = await run_in_threadpool(services.store.get, analysis_id)
    while not job.is_over and time.monotonic() < end_s and not await request.is_disconnected():
        await anyio.sleep(min(POLL_S, max(0.0, end_s - time.monotonic())))
        job = await run_in_threadpool(services.store.get, analysis_id)
    return job


def read_preference(header: str) -> float:
    """Read ``Prefer: wait=N`` (RFC 7240); anything else is left aside, as the RFC asks."""
    match = re.search(r"(?:^|[,;\s])wait=(\d{1,4})(?:$|[,;\s])", header)
    return min(float(match[1]), LONGEST_WAIT_S) if match else 0.0


async def run_to_end(function: Callable[P, T], *arguments: P.args, **named: P.kwargs) -> T:
    """Run in a thread, and wait for its end also when cancelled: its connection is then given back."""
    work = asyncio.ensure_future(run_in_threadpool(function, *arguments, **named))
    try:
        return await asyncio.shield(work)
    except asyncio.CancelledError:
        with suppress(Exception):
            await work
        raise
