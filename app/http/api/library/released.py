"""The files of a report that are made on request: those with the stamp of a release, and deferred ones.

A child process makes them at the first request; the server then keeps them in memory.
"""

import threading
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import replace
from datetime import datetime

from fastapi import Request, Response
from starlette.requests import HTTPConnection

from acromion.app.errors import NoSuchFile
from acromion.app.http.api.library.files import build_download_name, serve_bytes, serve_file
from acromion.app.http.api.trust import get_names
from acromion.app.library.audit_log import touch
from acromion.app.library.governance import Release
from acromion.app.library.results import check_succeeded
from acromion.app.library.rows import Job
from acromion.app.report.findings import ReleaseStamp
from acromion.app.request import Language
from acromion.app.services import Services

MOST_KEPT = 20
"""About 0.3 MB each."""
STAMPED = ("report.", "fhir.")

_kept: OrderedDict[tuple[str, str, str], Mapping[str, bytes]] = OrderedDict()
_turn = threading.Lock()


def read_report(connection: HTTPConnection, services: Services, job: Job, name: str) -> bytes:
    """Return a file of a finished analysis, with the stamp if the report is released.

    Raises NotFinished, NoSuchFile, ResultDamaged.
    """
    return _find_made(connection, services, job, name) or services.results.read(job, name)


def serve_report(request: Request, services: Services, job: Job, name: str) -> Response:
    """Return a file of a finished analysis as a download, with the stamp if the report is released.

    Raises NotFinished, NoSuchFile, NoSuchRange or ResultDamaged.
    """
    made = _find_made(request, services, job, name)
    if made is None:
        return serve_file(request, services, job, name)
    return serve_bytes(request, made, build_download_name(services, job, name))


def list_reports(services: Services, job: Job) -> list[str]:
    """Return the names of the files of a finished analysis, those made on request included."""
    stored = {file.name for file in services.store.find_files(job.id)}
    return sorted(stored.union(_list_deferred(job)))


def _find_made(connection: HTTPConnection, services: Services, job: Job, name: str) -> bytes | None:
    """Return a file that is made on request; None if the stored file is the report.

    Raises NotFinished, NoSuchFile, ResultDamaged.
    """
    if not name.startswith(STAMPED) or job.request.reference is not None:
        return None
    release, is_deferred = services.releases.find(job.id), name in _list_deferred(job)
    if release is None and not is_deferred:
        return None
    check_succeeded(job, name)
    is_stored = services.store.find_file(job.id, name) is not None
    if not (is_stored or is_deferred):
        raise NoSuchFile(name=name)
    if release is None and is_stored:
        return None
    touch(job.recording_id, job.id)
    language = _find_language(job, name)
    is_fhir = name.startswith("fhir.")  # it holds the PDF of every language
    key = (str(job.token), release.at if release else "", "" if is_fhir else language)
    with _turn:
        if key not in _kept:
            request = job.request if is_fhir else replace(job.request, languages=(language,))
            stamp = _describe_release(connection, release, language) if release else None
            with services.results.borrow(job, "results.json") as results:
                _kept[key] = services.inspector.set_again(results, request, stamp)
            while len(_kept) > MOST_KEPT:
                _kept.popitem(last=False)
        return _kept[key].get(name)


def _list_deferred(job: Job) -> tuple[str, ...]:
    return job.request.list_deferred() if job.is_label else ()


def _describe_release(connection: HTTPConnection, release: Release, language: Language) -> ReleaseStamp:
    who = get_names(connection, [release.who], language)[release.who]
    return ReleaseStamp(who, datetime.fromisoformat(release.at).astimezone().date().isoformat())


def forget_released() -> None:
    """Remove every report that is kept; they are made again on request."""
    with _turn:
        _kept.clear()


def _find_language(job: Job, name: str) -> Language:
    return next((one for one in job.request.languages if f".{one}." in name), job.request.languages[0])
