"""Write every setting of the server with its default and meaning as docs/reference/settings.md."""

import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from acromion.app.settings import Settings

PAGE = """Made from the code: `python -m benchmarks.reference`

# Settings

Each setting is an environment variable. A clinic server reads them from `/etc/acromion/acromion.env`: one
`NAME=value` per line, then `systemctl restart acromion`. Options of the command line take precedence.

| variable | default | meaning |
|---|---|---|
{rows}
"""
DEFAULTS = {"database_url": "SQLite in the data folder"}
"""Defaults that are computed."""


def write_document() -> str:
    """Return the page."""
    rows = [
        f"| {'<br>'.join(f'`ACROMION_{name.upper()}`' for name in names)} "
        f"| {'<br>'.join(_format_default(name) for name in names)} | {meaning} |"
        for names, meaning in read_meanings()
    ]
    return PAGE.format(rows="\n".join(rows))


def read_meanings() -> Iterator[tuple[list[str], str]]:
    """Return the names and the meaning of each setting, from the docstring of the class."""
    attributes = inspect.cleandoc(Settings.__doc__ or "").partition("Attributes\n----------\n")[2]
    for entry in re.split(r"\n(?=\w)", attributes):
        names, _, meaning = entry.partition("\n")
        text = " ".join(meaning.split()).replace("``", "`").replace("|", "\\|")
        yield [name.strip() for name in names.split(",")], text


def _format_default(name: str) -> str:
    if name in DEFAULTS:
        return DEFAULTS[name]
    default: Any = Settings.model_fields[name].default
    if isinstance(default, bool):
        return f"`{str(default).lower()}`"
    if isinstance(default, Path | float | int) or default:
        return f"`{int(default)}`" if isinstance(default, float) else f"`{default}`"
    return ""
