"""The software that made a report: its version, a fingerprint of the code that ran, and its plug-ins."""

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
    """Fingerprint the Python files of ``fusion/`` and ``app/report/``: 12 hexadecimal digits.

    A hash of the source files instead of a version-control revision: it is the same in a checkout, a wheel
    and a container, and it cannot disagree with the code that ran.
    """
    digest = hashlib.sha256()
    for path in _source_files():
        digest.update(path.relative_to(_ROOT).as_posix().encode())
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()[:12]


@cache
def installed_readers() -> tuple[tuple[str, str], ...]:
    """Return the name and the version of every reader that another package adds."""
    return tuple((entry.name, find_version(entry)) for entry in find_entry_points())


@cache
def identify_engine() -> str:
    """Identify all that may change a figure: version, revision, and the readers of other packages."""
    return json.dumps([software_version(), software_revision(), *installed_readers()])


def _source_files() -> list[Path]:
    folders = ("fusion", "app/report")
    return sorted(path for folder in folders for path in (_ROOT / folder).rglob("*.py"))
