"""The command line as if typed, and the tables it writes."""

import csv
from pathlib import Path

from typer.testing import CliRunner, Result

from app.cli import app


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def read_table(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))
