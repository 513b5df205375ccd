"""The crash tests work on the disk: what a killed process leaves there is what they are about."""

import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest


@pytest.fixture
def tmp_path() -> Iterator[Path]:
    """Return a temporary folder on the disk, also if other tests have theirs in memory."""
    folder = Path(tempfile.mkdtemp(prefix="acromion-crash-", dir="/var/tmp"))
    yield folder
    shutil.rmtree(folder, ignore_errors=True)
