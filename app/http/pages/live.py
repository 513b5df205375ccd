"""The page of live sessions; docs/it/live.md describes it."""

from importlib.util import find_spec

from fastapi import APIRouter, Response

from acromion.app.http.pages.rendering import UsedPage
from acromion.app.live.ports import find_serial_ports

router = APIRouter(include_in_schema=False)


@router.get("/live")
def show_live(page: UsedPage) -> Response:
    """Show the page, with a notice if the server has no WebSocket library."""
    words = page.words("live")
    texts = words["script"] | {"refused": words["refused"], "cue": words["cue"]}
    can_connect = find_spec("websockets") is not None
    return page.render("live.html", texts=texts, ports=find_serial_ports(), can_connect=can_connect)
