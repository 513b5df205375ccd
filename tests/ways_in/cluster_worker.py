"""A worker process that Procrastinate wakes, with a stand-in for the science: ``DATA STAND-IN``."""

import sys
from pathlib import Path

from app.jobs.cluster import run_cluster_worker
from app.settings import Settings
from tests.app import stand_ins

if __name__ == "__main__":
    run_cluster_worker(Settings(data_dir=Path(sys.argv[1])), getattr(stand_ins, sys.argv[2]))
