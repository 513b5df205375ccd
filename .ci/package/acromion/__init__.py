"""The package ``acromion``: its public Python names (``from acromion import analyse``).

Its names are those of :mod:`acromion.fusion`, which is loaded at first use. In a checkout, this folder has
links to the folders ``app`` and ``fusion``; a wheel contains the folders.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from acromion.fusion import *  # noqa: F403


def __getattr__(name: str) -> object:
    if name.startswith("__") and name != "__all__":  # the import system asks for such names
        raise AttributeError(f"module 'acromion' has no attribute {name!r}")
    public = import_module("acromion.fusion")
    if name != "__all__" and name not in public.__all__:
        raise AttributeError(f"module 'acromion' has no attribute {name!r}")
    return getattr(public, name)


def __dir__() -> list[str]:
    names: list[str] = import_module("acromion.fusion").__all__
    return names
