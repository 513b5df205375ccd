"""Measurements: each goal with a number has one, beside a peer where there is one."""

import os

os.environ.setdefault("ACROMION_NO_SECRET", "1")  # servers of a benchmark are called by the benchmark alone
