"""Scripts, styles and drawings of the pages, under an address that changes with them, so that browsers keep
them for good. plotly's script comes from the installed package: nothing is asked of another host.
"""

import gzip
import hashlib
from functools import cache
from importlib.metadata import version
from importlib.util import find_spec
from os import PathLike, stat_result
from pathlib import Path

from fastapi import APIRouter, Request, Response
from fastapi.staticfiles import StaticFiles
from starlette.types import Scope

from app.errors import NotHere

FOLDER = Path(__file__).resolve().parent / "static"
FOR_EVER = "public, max-age=31536000, immutable"

router = APIRouter(include_in_schema=False)


class Assets(StaticFiles):
    """The static files, which never change under their address."""

    def file_response(
        self, full_path: str | PathLike[str], stat_result: stat_result, scope: Scope, status_code: int = 200
    ) -> Response:
        """Let the browser keep the file."""
        response = super().file_response(full_path, stat_result, scope, status_code)
        response.headers["Cache-Control"] = FOR_EVER
        return response


@cache
def find_assets() -> str:
    """Give the address of the static files, without the proxy's part: ``/static/<fingerprint>``."""
    digest = hashlib.sha256()
    for path in sorted(FOLDER.rglob("*")):
        if path.is_file():
            digest.update(path.relative_to(FOLDER).as_posix().encode() + path.read_bytes())
    return f"/static/{digest.hexdigest()[:12]}"


@cache
def find_plotly() -> str:
    """Give the address of plotly's script, without the proxy's part."""
    return f"/vendor/plotly-{version('plotly')}.min.js"


@router.get("/vendor/{name}")
def plotly(name: str, request: Request) -> Response:
    """Give plotly's script from the installed package."""
    if f"/vendor/{name}" != find_plotly():
        raise NotHere
    headers = {"Cache-Control": FOR_EVER, "Vary": "Accept-Encoding"}
    if "gzip" in request.headers.get("accept-encoding", ""):
        headers["Content-Encoding"] = "gzip"
        return Response(_read_packed(), media_type="text/javascript", headers=headers)
    return Response(gzip.decompress(_read_packed()), media_type="text/javascript", headers=headers)


@cache
def _read_packed() -> bytes:
    """Compress it once: a third of the bytes, and the server holds no more of it."""
    package = find_spec("plotly")
    if package is None or package.origin is None:
        raise NotHere
    script = Path(package.origin).parent / "package_data" / "plotly.min.js"
    return gzip.compress(script.read_bytes(), 6, mtime=0)
