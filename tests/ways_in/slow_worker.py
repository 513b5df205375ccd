"""A worker process whose analyses take half a minute: something to kill in the middle."""

import sys
from pathlib import Path

from acromion.app.queue.worker import run_worker
from acromion.app.settings import Settings
from tests.app.stand_ins import write_slowly

if __name__ == "__main__":
    run_worker(Settings(data_dir=Path(sys.argv[1])), write_slowly)
