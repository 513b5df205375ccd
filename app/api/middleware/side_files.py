"""Writes the side files that a change has made old, before the change is acknowledged."""

import logging

from fastapi.concurrency import run_in_threadpool
from sqlalchemy.exc import SQLAlchemyError
from starlette.requests import HTTPConnection
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.api.middleware.guard import SAFE_METHODS
from app.errors import AppError
from app.services import Services, find_services

AT_ONCE = 20
"""Side files written before an answer goes out; housekeeping writes the rest of a large change."""

logger = logging.getLogger(__name__)


class SideFiles:
    """Stands before the routes that change something."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer once the side files of what was changed are written."""
        if scope["type"] != "http" or scope["method"] in SAFE_METHODS:
            await self._app(scope, receive, send)
            return

        async def send_after(message: Message) -> None:
            if message["type"] == "http.response.start" and message["status"] < 400:
                await run_in_threadpool(write_side_files, find_services(HTTPConnection(scope)), AT_ONCE)
            await send(message)

        await self._app(scope, receive, send_after)


def write_side_files(services: Services, most: int) -> int:
    """Write side files that lag; trouble with them takes back nothing: the rows are committed."""
    try:
        return services.side_files.write_lagging(most)
    except (AppError, OSError, SQLAlchemyError):
        logger.exception("side files are not written; trying again")
        return 0
