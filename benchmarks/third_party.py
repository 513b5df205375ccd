"""Add the licences of packages in the image: ``python -m benchmarks.third_party LIST.cdx.json``.

Adds the licence that each installed package states to a CycloneDX list made from the lock of the image, and
exits 1 with the names of packages that may not be shipped. ``.ci/run`` creates the list.
"""

import json
import re
import sys
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, metadata
from pathlib import Path
from typing import NamedTuple

LOCK = Path(__file__).resolve().parents[1] / "docker" / "requirements.lock"
UNKNOWN = "unknown"

ACCEPTED = frozenset(
    {
        "0BSD",
        "Apache-2.0",
        "Apache-2.0 WITH LLVM-exception",
        "BSD-2-Clause",
        "BSD-3-Clause",
        "CC0-1.0",
        "ISC",
        "LGPL-3.0-only",
        "MIT",
        "MIT-0",
        "MIT-CMU",
        "MPL-2.0",
        "PSF-2.0",
        "Zlib",
    }
)
"""Licences compatible with Apache-2.0: licences that require a notice, and LGPL and MPL for unmodified
libraries.
"""

_SPDX = {
    "Apache Software License": "Apache-2.0",
    "BSD": "BSD-3-Clause",
    "BSD License": "BSD-3-Clause",
    "ISC License": "ISC",
    "ISC License (ISCL)": "ISC",
    "MIT License": "MIT",
    "Mozilla Public License 2.0 (MPL 2.0)": "MPL-2.0",
    "PSFL": "PSF-2.0",
    "Python Software Foundation License": "PSF-2.0",
}
_READ_BY_HAND = {"colorama": "BSD-3-Clause", "pyrage": "MIT"}
"""A package that only other systems install, and another whose licence is only in a file."""


class Package(NamedTuple):
    """A package of the lock, with the licence that it states (SPDX)."""

    name: str
    version: str
    licence: str

    @property
    def may_be_shipped(self) -> bool:
        """Return whether each part of the licence, or one of its alternatives, is accepted."""
        parts = (part.strip("() ").split(" OR ") for part in self.licence.split(" AND "))
        return all(not ACCEPTED.isdisjoint(choices) for choices in parts)


def read_lock(lock: Path = LOCK) -> Iterator[Package]:
    """Yield the packages of a lock file, with their licences."""
    for name, version in re.findall(r"^([\w.-]+)==([\w.]+)", lock.read_text(), re.MULTILINE):
        yield Package(name, version, find_licence(name))


def find_licence(name: str) -> str:
    """Return the licence that a package states: as SPDX, in the older field, or by its classifiers."""
    try:
        stated = metadata(name)
    except PackageNotFoundError:
        return _READ_BY_HAND.get(name, UNKNOWN)
    if "License-Expression" in stated:
        return stated["License-Expression"]
    classes = [text.rpartition(" :: ")[2] for text in stated.get_all("Classifier") or [] if "License" in text]
    said = [stated["License"], *classes] if "License" in stated else classes
    known = [_SPDX.get(text, text) for text in said]
    unclear = ", ".join(classes) or _READ_BY_HAND.get(name, UNKNOWN)
    return next((licence for licence in known if licence in ACCEPTED), unclear)


def add_licences(document: dict[str, object], packages: dict[str, Package]) -> None:
    """Add each component's licence to a CycloneDX document."""
    components = document["components"]
    assert isinstance(components, list)
    for component in components:
        licence = packages[component["name"]].licence
        component["licenses"] = [{"expression": licence, "acknowledgement": "declared"}]


def main(path: Path) -> int:
    """Complete a list; return the exit code."""
    packages = {package.name: package for package in read_lock()}
    document = json.loads(path.read_text())
    add_licences(document, packages)
    path.write_text(json.dumps(document, indent=1) + "\n")
    refused = [package for package in packages.values() if not package.may_be_shipped]
    for package in refused:
        print(f"{package.name} {package.version}: {package.licence} is not among the accepted licences")
    print(f"{path}: {len(packages)} third-party packages, {len(refused)} that may not be shipped")
    return 1 if refused else 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
