"""Enter from the command ``acromion``: what takes longest to load begins to load at once.

The server that children come from loads the science; it is started before this process loads the command
line, so that both load side by side. This module is all that a child loads of the command line.
Meanwhile the garbage collector rests: modules are never let go.
"""

import gc
import importlib
import sys

from app.jobs.children.fork_server import PRELOAD_READING, warm_up

_ANALYSING = frozenset({"run", "exposure"})


def main() -> None:
    """Do what the command line asks."""
    asked = sys.argv[1:]
    if asked and asked[0] in _ANALYSING and "--help" not in asked:
        warm_up(PRELOAD_READING)
    gc.disable()
    command_line = importlib.import_module("app.cli")
    gc.freeze()
    gc.enable()
    command_line.main()
