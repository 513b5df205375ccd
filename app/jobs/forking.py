"""Where children come from: a server of them that has loaded the science once.

It is a small module of its own, so that the command line can start that server before it has loaded itself.
"""

import multiprocessing
from multiprocessing import forkserver
from typing import Any

FOR_MANY, FOR_ONE = "app.jobs.preloaded", "app.jobs.preloaded_reading"
"""What the server loads before it serves: everything, or no more than the first child begins with."""


def choose_context(preloaded: str = FOR_MANY) -> Any:
    """Prefer the fork server: it has imported the science already, and it has no threads of ours.

    ``preloaded`` counts until the server runs.
    """
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([preloaded])
    return context


def warm_up(preloaded: str = FOR_MANY) -> None:
    """Have the fork server import the science now, so that the first job need not wait for it."""
    if choose_context(preloaded).get_start_method() == "forkserver":
        forkserver.ensure_running()
