"""The page of live sessions; docs/live.md says what it shows and what it does not."""

from importlib.util import find_spec

from fastapi import APIRouter, Request, Response

from app.live.ports import find_serial_ports
from app.report.words.wording import load_wording
from app.services import UsedLanguage
from app.web.rendering import render_page

router = APIRouter(include_in_schema=False)


@router.get("/live")
def show_live(request: Request, language: UsedLanguage) -> Response:
    """Show the page; it says so where the server lacks the library for WebSockets."""
    words = load_wording(language, "live")
    values = {
        "l": words["page"],
        "texts": words["script"] | {"refused": words["refused"], "cue": words["cue"]},
        "ports": find_serial_ports(),
        "can_connect": find_spec("websockets") is not None,
    }
    return render_page(request, "live.html", language, values)
