"""Write the revision of the sources into the packages; link the folders of an editable installation."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

REVISION = "revision.txt"
PACKAGE, FOLDERS = Path(".ci", "package", "acromion"), ("app", "fusion")


class CustomBuildHook(BuildHookInterface):  # type: ignore[type-arg]
    """Adds the revision to an archive of the sources and to a wheel.

    A wheel from an archive has the revision of the archive. Only :mod:`benchmarks.release` makes a release:
    it sets ``ACROMION_RELEASE`` to the version after its checks.
    """

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Add the file to a package; an editable installation reads git itself and needs the links."""
        root, self._folder = Path(self.root), tempfile.TemporaryDirectory()
        if version == "editable":
            link_folders(root)
            return
        path = root / REVISION
        if not path.exists():
            path = Path(self._folder.name) / REVISION
            path.write_text(f"{find_revision(root, self.metadata.version)}\n", "utf-8")
        place = REVISION if self.target_name == "sdist" else f"acromion/app/{REVISION}"
        build_data["force_include"][str(path)] = place


def link_folders(root: Path) -> None:
    """Link ``app`` and ``fusion`` into the package of a checkout; on Windows as junctions.

    git does not hold the links: not every copy of a repository keeps them.
    """
    for name in FOLDERS:
        link = root / PACKAGE / name
        if link.is_dir():
            continue
        if sys.platform == "win32":
            import _winapi  # noqa: PLC0415

            _winapi.CreateJunction(str(root / name), str(link))
        else:
            link.symlink_to(Path("..", "..", "..", name))


def find_revision(root: Path, version: str) -> str:
    """Return "release 0.1.0", the commit as "git 1a2b3c4d5e6f", or "0.1.0, not released" outside of git."""
    if os.environ.get("ACROMION_RELEASE") == version:
        return f"release {version}"
    if (root / ".git").exists():
        asked = ["git", "-C", str(root), "rev-parse", "--short=12", "HEAD"]
        try:
            said = subprocess.run(asked, capture_output=True, text=True, check=True)  # noqa: S603
            return f"git {said.stdout.strip()}"
        except (OSError, subprocess.CalledProcessError):
            pass
    return f"{version}, not released"
