"""Acromion in Python: ``from acromion import analyse``.

An installation puts this file beside the packages as the module ``acromion`` (``force-include`` in
``pyproject.toml``). Its names are those of :mod:`fusion`, each loaded when first asked for.
"""

from typing import TYPE_CHECKING

import fusion

if TYPE_CHECKING:
    from fusion import *  # noqa: F403

__all__ = fusion.__all__


def __getattr__(name: str) -> object:
    if name not in __all__:
        raise AttributeError(f"module 'acromion' has no attribute {name!r}")
    return getattr(fusion, name)


def __dir__() -> list[str]:
    return __all__
