"""The entry of the command ``acromion`` and of ``python -m app``.

The fork server starts first, because it takes longest: it loads the science while this process loads
the command line. This module is all that a child loads of the command line. The garbage collector
is off meanwhile: modules are never freed.
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


if __name__ == "__main__":
    main()
