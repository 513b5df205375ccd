"""``/metrics`` for Prometheus: counted when asked for, from the rows themselves."""

import shutil
from collections.abc import Iterable

from fastapi import APIRouter, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import JSONResponse
from prometheus_client import CONTENT_TYPE_LATEST, CollectorRegistry, ProcessCollector, generate_latest
from prometheus_client.core import GaugeMetricFamily
from prometheus_client.registry import Collector

from app.services import GOOD, Services, UsedServices

router = APIRouter(include_in_schema=False)


@router.get("/healthz")
def healthz() -> dict[str, str]:
    """Say that the process answers."""
    return {"status": "ok"}


@router.get("/readyz")
async def readyz(services: UsedServices) -> JSONResponse:
    """Say whether uploads are taken: 200, or 503 with the code of each check that fails."""
    checks = await services.readiness.check()
    if set(checks.values()) != {GOOD}:
        body = {"status": "unready", "checks": checks}
        return JSONResponse(body, 503, headers={"Retry-After": "5"})
    counts = await run_in_threadpool(services.store.count_states)
    analyses = {state.value: number for state, number in counts.items()}
    body = {"status": GOOD, "checks": checks, "analyses": analyses}
    return JSONResponse(body | {"quarantine": len(services.quarantine.names)})


@router.get("/metrics")
def metrics(services: UsedServices) -> Response:
    """Return queue, failures by code, uploads under way, disk and process."""
    registry = CollectorRegistry()
    registry.register(_Rows(services))
    ProcessCollector(registry=registry)
    return Response(generate_latest(registry), media_type=CONTENT_TYPE_LATEST)


class _Rows(Collector):
    """Counts rows at the moment of asking."""

    def __init__(self, services: Services) -> None:
        self._services = services

    def collect(self) -> Iterable[GaugeMetricFamily]:
        """Give every gauge."""
        services = self._services
        states = GaugeMetricFamily("acromion_analyses", "Analyses by state.", labels=["state"])
        for state, number in services.store.count_states().items():
            states.add_metric([state.value], number)
        yield states
        problems = GaugeMetricFamily("acromion_failed_analyses", "Failed analyses by code.", labels=["code"])
        for code, number in services.store.count_problems().items():
            problems.add_metric([code], number)
        yield problems
        growing = len(services.uploads.find_growing())
        yield GaugeMetricFamily("acromion_uploads_under_way", "Uploads under way.", growing)
        free_bytes = shutil.disk_usage(services.settings.data_dir).free
        yield GaugeMetricFamily("acromion_free_disk_bytes", "Free space for recordings.", free_bytes)
