"""A worker that does one job and ends: started under another clock."""

import sys
from pathlib import Path

from acromion.app.queue.worker import open_worker_context, run_next
from acromion.app.settings import Settings
from tests.crash.program import write_digest

if __name__ == "__main__":
    worker = open_worker_context(Settings(data_dir=Path(sys.argv[1])), write_digest)
    done = run_next(worker)
    worker.store.close()
    sys.exit(not done)
