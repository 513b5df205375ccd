"""The software behind a report: its version and revision, a fingerprint of its code, and its plug-ins."""

import hashlib
import json
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import acromion
from acromion.fusion.plugins import find_entry_points, find_version

_ROOT = Path(__file__).resolve().parents[1]


def find_import_folder() -> str:
    """Return the folder on Python's path with the package ``acromion`` that runs."""
    return str(Path(acromion.__path__[0]).absolute().parent)


@cache
def software_version() -> str:
    """Return the installed version, or "0" when run from a bare checkout."""
    try:
        return version("acromion")
    except PackageNotFoundError:
        return "0"


@cache
def source_fingerprint() -> str:
    """Return a fingerprint of the Python files of ``fusion/`` and ``app/report/``: 12 hexadecimal digits.

    It is the same in a checkout, a wheel and a container, and always matches the code that ran: caches use
    it. A reader needs :func:`source_revision`.
    """
    digest = hashlib.sha256()
    for path in _source_files():
        digest.update(path.relative_to(_ROOT).as_posix().encode())
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()[:12]


@cache
def source_revision() -> str:
    """Return the commit as "git 1a2b3c4d5e6f", the release as "release 0.1.0", or "0.1.0, not released".

    In a checkout the files of git are read, and no program runs. A package has the revision that
    ``hatch_build.py`` wrote. Changes that are not committed do not show here, but in
    :func:`source_fingerprint`.
    """
    commit, stated = _read_commit(_ROOT / ".git"), _ROOT / "app" / "revision.txt"
    if commit:
        return f"git {commit[:12]}"
    return stated.read_text("utf-8").strip() if stated.exists() else f"{software_version()}, not released"


def _read_commit(git: Path) -> str:
    """Return the commit that is checked out; "" if ``git`` is not the folder or file of a checkout."""
    try:
        if git.is_file():  # a further working tree
            git = git.parent / git.read_text("utf-8").removeprefix("gitdir:").strip()
        shared = git / "commondir"
        common = git / shared.read_text("utf-8").strip() if shared.exists() else git
        head = (git / "HEAD").read_text("utf-8").strip()
        if not head.startswith("ref:"):
            return head
        name = head.removeprefix("ref:").strip()
        if (common / name).exists():
            return (common / name).read_text("utf-8").strip()
        lines = (common / "packed-refs").read_text("utf-8").splitlines()
        return next((line.split()[0] for line in lines if line.endswith(f" {name}")), "")
    except OSError:
        return ""


@cache
def installed_readers() -> tuple[tuple[str, str], ...]:
    """Return the name and version of every reader plug-in."""
    return tuple((entry.name, find_version(entry)) for entry in find_entry_points())


@cache
def identify_engine() -> str:
    """Return an id of everything that may change a figure: version, revision and reader plug-ins."""
    return json.dumps([software_version(), source_fingerprint(), *installed_readers()])


def _source_files() -> list[Path]:
    folders = ("fusion", "app/report")
    return sorted(path for folder in folders for path in (_ROOT / folder).rglob("*.py"))
