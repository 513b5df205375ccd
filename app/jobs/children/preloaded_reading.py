"""Imported only by the fork server of a command line: it loads the modules for reading.

So the first child starts sooner; it loads the rest while it reads (:func:`app.roads.reading.read_ahead`).
Before a second child the rest is loaded here, once for all that follow.
"""

import os
from itertools import count

from app.jobs.children.fork_server import ALL, READING, load

_forks = count(1)


def _load_before_second() -> None:
    if next(_forks) == 2:
        load(ALL)


load(READING)
os.register_at_fork(before=_load_before_second)
