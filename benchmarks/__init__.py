"""Benchmarks: one for each numerical goal, with a peer for comparison if one exists."""

import os

os.environ.setdefault("ACROMION_NO_SECRET", "1")  # only the benchmark itself calls its servers
