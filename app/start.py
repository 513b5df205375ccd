"""The entry of the command ``acromion``: the fork server starts first, because it takes longest.

The fork server loads the science while this process loads the command line. This module is all that a child
loads of the command line. The garbage collector is off meanwhile: modules are never freed.
"""

import gc
import importlib
import sys

from app.analysis.fork_server import warm_up

_ANALYSING = frozenset({"run", "exposure"})


def main() -> None:
    """Run the command line."""
    asked = sys.argv[1:]
    if asked and asked[0] in _ANALYSING and "--help" not in asked:
        warm_up()
    gc.disable()
    command_line = importlib.import_module("app.cli")
    gc.freeze()
    gc.enable()
    command_line.main()
