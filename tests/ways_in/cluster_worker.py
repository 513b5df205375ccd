"""A worker process that Procrastinate wakes, with a stand-in for the science: ``DATA STAND-IN``.

It looks for lost wake-ups ten times as often as the product does: a test waits for one.
"""

import sys
from pathlib import Path

from acromion.app.queue import cluster
from acromion.app.queue.cluster import run_cluster_worker
from acromion.app.settings import Settings
from tests.app import stand_ins

if __name__ == "__main__":
    cluster.REVIVE_S = 0.5
    run_cluster_worker(Settings(data_dir=Path(sys.argv[1])), getattr(stand_ins, sys.argv[2]))
