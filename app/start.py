"""The entry of the command ``acromion``; it starts the fork server first because that takes longest.

The fork server loads ``fusion`` while this process loads the command line. A child process loads only this
module of the command line. The garbage collector is off during loading because modules are never freed.
"""

import gc
import importlib
import sys

from acromion.app.analysis.fork_server import warm_up

_ANALYSING = frozenset({"run", "exposure"})


def main() -> None:
    """Run the command line."""
    asked = sys.argv[1:]
    if asked and asked[0] in _ANALYSING and "--help" not in asked:
        warm_up()
    gc.disable()
    command_line = importlib.import_module("acromion.app.cli")
    gc.freeze()
    gc.enable()
    command_line.main()
