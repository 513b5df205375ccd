"""The command line as if typed, and the tables it writes."""

import csv
import os
import shutil
import zipfile
from pathlib import Path

from typer.testing import CliRunner, Result

from acromion.app.cli import app


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def read_table(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def copy_gt3x(source: Path, target: Path) -> Path:
    """Copy a recording with its new path noted in the archive: other bytes, the same samples."""
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copy(source, target)
    with zipfile.ZipFile(target, "a") as archive:
        archive.comment = os.fsencode(target)
    return target
