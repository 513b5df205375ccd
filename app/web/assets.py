"""Scripts, styles and drawings of the pages, under an address that changes with them, so that browsers keep
them for good. plotly's script comes from the installed package: nothing is asked of another host.
"""

import gzip
import hashlib
import re
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


@cache
def list_style_ids() -> tuple[str, ...]:
    """Give the ids of the styles that plotly's script puts into a page unless an element of that name is
    there: map controls, which we never draw, and which our policy would refuse.
    """
    return tuple(re.findall(r'getElementById\("([0-9a-f]{32,})"\)', _read_script().decode()))


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
    return gzip.compress(_read_script(), 6, mtime=0)


def _read_script() -> bytes:
    package = find_spec("plotly")
    if package is None or package.origin is None:
        raise NotHere
    return (Path(package.origin).parent / "package_data" / "plotly.min.js").read_bytes()
