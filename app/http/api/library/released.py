"""The files of a released report: made again with the stamp on page 1; the stored files do not change.

They are made in a child process at the first request, and then kept in memory.
"""

import threading
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import replace
from datetime import datetime

from fastapi import Request, Response
from starlette.requests import HTTPConnection

from app.http.api.library.files import build_download_name, serve_bytes, serve_file
from app.http.api.trust import get_names
from app.library.rows import Job
from app.report.findings import ReleaseStamp
from app.request import Language
from app.services import Services

MOST_KEPT = 20
"""About 0.3 MB each."""
STAMPED = ("report.", "fhir.")

_kept: OrderedDict[tuple[str, str, str], Mapping[str, bytes]] = OrderedDict()
_turn = threading.Lock()


def read_report(connection: HTTPConnection, services: Services, job: Job, name: str) -> bytes:
    """Return a file of a finished analysis, with the stamp if the report is released.

    Raises NotFinished, NoSuchFile, ResultDamaged.
    """
    return find_released(connection, services, job, name) or services.results.read(job, name)


def serve_report(request: Request, services: Services, job: Job, name: str) -> Response:
    """Return a file of a finished analysis as a download, with the stamp if the report is released.

    Raises NotFinished, NoSuchFile, NoSuchRange or ResultDamaged.
    """
    stamped = find_released(request, services, job, name)
    if stamped is None:
        return serve_file(request, services, job, name)
    return serve_bytes(request, stamped, build_download_name(services, job, name))


def find_released(connection: HTTPConnection, services: Services, job: Job, name: str) -> bytes | None:
    """Return a file with the stamp of its release; None if the report is not released, or has no such file.

    Raises NotFinished, NoSuchFile, ResultDamaged.
    """
    if not name.startswith(STAMPED) or job.request.reference is not None:
        return None
    release = services.releases.find(job.id)
    if release is None:
        return None
    services.results.find(job, name)
    language = _find_language(job, name)
    is_fhir = name.startswith("fhir.")  # it holds the PDF of every language
    key = (str(job.token), release.at, "" if is_fhir else language)
    with _turn:
        if key not in _kept:
            who = get_names(connection, [release.who], language)[release.who]
            day = datetime.fromisoformat(release.at).astimezone().date().isoformat()
            request = job.request if is_fhir else replace(job.request, languages=(language,))
            with services.results.borrow(job, "results.json") as results:
                _kept[key] = services.inspector.set_released(results, request, ReleaseStamp(who, day))
            while len(_kept) > MOST_KEPT:
                _kept.popitem(last=False)
        return _kept[key].get(name)


def forget_released() -> None:
    """Remove every report that is kept; they are made again on request."""
    with _turn:
        _kept.clear()


def _find_language(job: Job, name: str) -> Language:
    return next((one for one in job.request.languages if f".{one}." in name), job.request.languages[0])
