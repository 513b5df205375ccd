"""The software behind a report: its version, a fingerprint of its code, and its plug-ins."""

import hashlib
import json
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from fusion.plugins import find_entry_points, find_version

_ROOT = Path(__file__).resolve().parents[1]


@cache
def software_version() -> str:
    """Return the installed version, or "0" when run from a bare checkout."""
    try:
        return version("acromion")
    except PackageNotFoundError:
        return "0"


@cache
def software_revision() -> str:
    """Return a fingerprint of the Python files of ``fusion/`` and ``app/report/``: 12 hexadecimal digits.

    It is a hash of the source files instead of a version-control revision, so that it is the same in a
    checkout, a wheel and a container, and always matches the code that ran.
    """
    digest = hashlib.sha256()
    for path in _source_files():
        digest.update(path.relative_to(_ROOT).as_posix().encode())
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()[:12]


@cache
def installed_readers() -> tuple[tuple[str, str], ...]:
    """Return the name and version of every reader plug-in."""
    return tuple((entry.name, find_version(entry)) for entry in find_entry_points())


@cache
def identify_engine() -> str:
    """Return an id of everything that may change a figure: version, revision and reader plug-ins."""
    return json.dumps([software_version(), software_revision(), *installed_readers()])


def _source_files() -> list[Path]:
    folders = ("fusion", "app/report")
    return sorted(path for folder in folders for path in (_ROOT / folder).rglob("*.py"))
