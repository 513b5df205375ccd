"""The Python module ``acromion`` (``from acromion import analyse``) and the entry of the command.

An installation puts this file beside the packages as the module ``acromion`` (``force-include`` in
``pyproject.toml``). It has the names of :mod:`fusion` and loads each one at first use. Other packages may
also be called ``app`` or ``fusion``, so this module checks for a clash before it loads them.
"""

import sys
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from fusion import *  # noqa: F403

_MARKS = {"app": "The Acromion application", "fusion": "Compute arm elevation and exposure"}
"""Text near the start of each package's ``__init__.py``."""

# This text is not in the wording files: they are in `app`, which is another package when this is needed.
_CLASH = """\
acromion cannot start: the package "{name}" that Python finds is not Acromion's.
Found: {found}
Cause: {cause}
Cure: install Acromion into a separate environment (python3 -m venv), and leave PYTHONPATH empty.

acromion ne peut pas démarrer : le paquet « {name} » que Python trouve n'est pas celui d'Acromion.
Remède : installez Acromion dans un environnement distinct (python3 -m venv), et laissez PYTHONPATH vide."""


class PackageClash(ImportError):
    """Another package called ``app`` or ``fusion`` was found before ours or installed over it."""


def check_packages() -> None:
    """Raise :class:`PackageClash` if ``app`` or ``fusion`` is another package; load neither."""
    for name, mark in _MARKS.items():
        spec = find_spec(name)
        found = Path(spec.origin) if spec and spec.origin else None
        if found is None or not found.is_file() or mark not in found.read_text("utf-8", "replace")[:200]:
            raise PackageClash(_CLASH.format(name=name, found=found, cause=_find_cause(name, found)))


def run_command() -> None:
    """Run the command line; on a clash print its cause and cure and exit with code 3."""
    try:
        check_packages()
    except PackageClash as clash:
        sys.stderr.write(f"{clash}\n")
        raise SystemExit(3) from None
    import_module("app.start").main()


def _find_cause(name: str, found: Path | None) -> str:
    if found is None or found.parent.parent != Path(__file__).parent:
        return "another package of this name comes first on Python's path."
    owners = import_module("importlib.metadata").packages_distributions().get(name, [])
    others = sorted({owner for owner in owners if owner != "acromion"})
    return f"another package was installed over it: {', '.join(others) or 'unknown'}."


@cache
def _load_fusion() -> ModuleType:
    check_packages()
    return import_module("fusion")


def __getattr__(name: str) -> object:
    if name == "__all__":
        return _load_fusion().__all__
    if name.startswith("__") or name not in _load_fusion().__all__:
        raise AttributeError(f"module 'acromion' has no attribute {name!r}")
    return getattr(_load_fusion(), name)


def __dir__() -> list[str]:
    names: list[str] = _load_fusion().__all__
    return names
