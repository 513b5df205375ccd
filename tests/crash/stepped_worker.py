"""A worker that does one job and ends: started under another clock."""

import sys
from pathlib import Path

from app.queue.worker import open_bench, run_next
from app.settings import Settings
from tests.crash.program import write_digest

if __name__ == "__main__":
    bench = open_bench(Settings(data_dir=Path(sys.argv[1])), write_digest)
    done = run_next(bench)
    bench.store.close()
    sys.exit(not done)
