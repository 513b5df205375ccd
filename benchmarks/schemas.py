"""Test every operation of the API with valid and invalid values: ``python -m benchmarks.schemas [examples]``.

Starts a separate server on a new data folder and runs schemathesis against it; exits with its exit code.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from tests import ROOT
from tests.ways_in.servers import RunningServer

TOOL = Path(sys.executable).with_name("schemathesis")


def try_operations(folder: Path, examples: int) -> int:
    """Run schemathesis; return its exit code."""
    server = RunningServer(folder / "data", folder / "server.log")
    document = f"{server.address}api/v1/openapi.json"
    config = str(ROOT / "benchmarks/schemathesis.toml")
    command = [str(TOOL), "--config-file", config, "run", document]
    options = ["--phases", "coverage,fuzzing", "--max-examples", str(examples), "--request-timeout", "90"]
    environment = os.environ | {"SCHEMATHESIS_HOOKS": "benchmarks.schema_hooks", "PYTHONPATH": str(ROOT)}
    try:
        return subprocess.run([*command, *options], cwd=ROOT, env=environment, check=False).returncode
    finally:
        server.stop()


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        sys.exit(try_operations(Path(name), int(sys.argv[1]) if len(sys.argv) > 1 else 50))
