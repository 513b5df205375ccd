"""What the arm did: from the bytes of a recording to elevation and exposure.

The public names are loaded when first asked for, so that a program which only needs the errors or the
value types does not pay for the compiler.
"""

import contextlib
import hashlib
import importlib
import os
import shutil
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from fusion.errors import FusionError as FusionError
    from fusion.frames import tabulate_elevation as tabulate_elevation
    from fusion.frames import tabulate_exposure as tabulate_exposure
    from fusion.live import LiveElevation as LiveElevation
    from fusion.orientation import estimate_vertical as estimate_vertical
    from fusion.pipeline import Analysis as Analysis
    from fusion.pipeline import AnalysisSettings as AnalysisSettings
    from fusion.pipeline import analyse as analyse
    from fusion.readers import read_recording as read_recording
    from fusion.readers import read_recordings as read_recordings
    from fusion.recording import Recording as Recording

_HOMES = {
    "LiveElevation": "fusion.live",
    "Analysis": "fusion.pipeline",
    "AnalysisSettings": "fusion.pipeline",
    "FusionError": "fusion.errors",
    "Recording": "fusion.recording",
    "analyse": "fusion.pipeline",
    "estimate_vertical": "fusion.orientation",
    "read_recording": "fusion.readers",
    "read_recordings": "fusion.readers",
    "tabulate_elevation": "fusion.frames",
    "tabulate_exposure": "fusion.frames",
}

__all__ = [
    "Analysis",
    "AnalysisSettings",
    "FusionError",
    "LiveElevation",
    "Recording",
    "analyse",
    "estimate_vertical",
    "read_recording",
    "read_recordings",
    "tabulate_elevation",
    "tabulate_exposure",
]


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module 'fusion' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name]), name)


def _writable_cache() -> Path | None:
    """Find a folder of our own for compiled code; a shared one could be planted by another user."""
    base = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA") or "~/.cache"
    kernels = _fingerprint_kernels()
    for place in (Path(base).expanduser() / "acromion", Path(tempfile.gettempdir()) / _private_name()):
        folder = place / f"kernels-{kernels}"
        try:
            place.mkdir(mode=0o700, parents=True, exist_ok=True)
            folder.mkdir(mode=0o700, exist_ok=True)
        except OSError:
            continue
        if os.access(folder, os.W_OK) and _is_ours(place) and _is_ours(folder):
            return folder
    return None


def _fingerprint_kernels() -> str:
    """Hash the sources that are compiled.

    The compiler notices a change in a function's own file only; a kernel that has another inlined would go
    on with the old one.
    """
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.rglob("*.py")):
        source = path.read_bytes()
        if b"numba" in source:
            digest.update(path.name.encode() + source)
    return digest.hexdigest()[:12]


def _private_name() -> str:
    return f"acromion-{os.getuid()}" if hasattr(os, "getuid") else "acromion"


def _is_ours(folder: Path) -> bool:
    return not hasattr(os, "getuid") or folder.stat().st_uid == os.getuid()


def _place_compiled_code() -> None:
    """Point numba at a writable folder, so that a read-only installation works and stays fast.

    numba takes no folder that it cannot write, not even to read what is compiled; such a one (of a container
    whose disk is read-only) is copied to where it can.
    """
    given = os.environ.get("NUMBA_CACHE_DIR")
    if given and (not Path(given).is_dir() or os.access(given, os.W_OK)):
        return
    if folder := _writable_cache():
        if given:
            _copy_compiled(Path(given), folder)
        os.environ["NUMBA_CACHE_DIR"] = str(folder)


def _copy_compiled(given: Path, folder: Path) -> None:
    """Fill an empty folder; of processes that start together one does it, and nobody sees the half."""
    if any(folder.iterdir()):
        return
    copy = Path(tempfile.mkdtemp(dir=folder.parent))
    shutil.copytree(given, copy, dirs_exist_ok=True)
    copy.chmod(0o700)
    with contextlib.suppress(OSError):
        copy.replace(folder)
    shutil.rmtree(copy, ignore_errors=True)


_place_compiled_code()
