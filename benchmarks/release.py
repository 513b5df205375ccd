"""Create a release: check that it is ready, build, and test the wheel in an empty environment.

    python -m benchmarks.release -o dist [--python python3.12 ...]

The release is rejected if: the changelog has no entry for the version, or has unreleased entries;
``CITATION.cff`` or ``docs/cite.md`` name another version; files are not committed; two builds differ. Then
each ``--python`` gets an empty environment with the wheel and its dependencies, and simulates, analyses and
reads a shift in an empty folder.
"""

import argparse
import hashlib
import os
import re
import subprocess
import sys
import tarfile
import tempfile
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parents[1]
TRIAL = """
import json, pathlib
from acromion import analyse
analysis = analyse(next(pathlib.Path("out/recording").glob("*.gt3x")))
results = json.loads(next(pathlib.Path("out").glob("*/results.json")).read_text("utf-8"))
share = next(row["percent"] for row in results["exposure"]["time_above"] if row["threshold_deg"] == 60)
(row,) = [row for row in analysis.exposure.time_above if row.threshold_deg == 60]
assert abs(row.percent - share) < 1e-5, (row.percent, share)
print(analysis)
"""


class NotReady(Exception):
    """The reason why the release is not ready."""


def read_version(root: Path) -> str:
    """Return the version of ``pyproject.toml``."""
    version: str = tomllib.loads((root / "pyproject.toml").read_text("utf-8"))["project"]["version"]
    return version


def check_changelog(text: str, version: str) -> None:
    """Check that the changelog describes this version.

    Raises
    ------
    NotReady
        Without a heading "## VERSION - YYYY-MM-DD" and an entry below it, or with entries under "Unreleased".
    """
    parts = dict(re.findall(r"^## ([^\n]+)\n(.*?)(?=^## |\Z)", text, re.DOTALL | re.MULTILINE))
    if re.search(r"^- ", parts.get("Unreleased", ""), re.MULTILINE):
        raise NotReady("CHANGELOG.md: move the entries under Unreleased to a heading of the version")
    for heading, body in parts.items():
        if re.fullmatch(rf"{re.escape(version)} - \d{{4}}-\d\d-\d\d", heading):
            if re.search(r"^- ", body, re.MULTILINE):
                return
            raise NotReady(f"CHANGELOG.md: {version} has no entry")
    raise NotReady(f'CHANGELOG.md: no heading "## {version} - YYYY-MM-DD"')


def check_citation(root: Path, version: str) -> None:
    """Check that the citation names this version."""
    cited = yaml.safe_load((root / "CITATION.cff").read_text("utf-8"))["version"]
    if str(cited) != version:
        raise NotReady(f"CITATION.cff names version {cited}, not {version}")
    if f"(version {version})" not in (root / "docs" / "cite.md").read_text("utf-8"):
        raise NotReady(f"docs/cite.md does not name version {version}")


def check_committed(root: Path) -> None:
    """Check that all changes are committed."""
    changed = _ask(["git", "status", "--porcelain"], root)
    if changed:
        raise NotReady(f"not committed:\n{changed}")


def build(root: Path, out: Path, seconds: int) -> Mapping[str, str]:
    """Build the source archive and the wheel; return the SHA-256 of each by its name.

    Parameters
    ----------
    root
        A work tree, or an unpacked source archive.
    out
        The output folder.
    seconds
        Since 1970: the time of every file in them (``SOURCE_DATE_EPOCH``).
    """
    environment = os.environ | {
        "SOURCE_DATE_EPOCH": str(seconds),
        "ACROMION_RELEASE": read_version(root),  # read by hatch_build.py
    }
    command = [sys.executable, "-m", "hatchling", "build", "-d", str(out)]
    subprocess.run(command, cwd=root, env=environment, check=True, capture_output=True)
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(out.iterdir())}


def build_twice(root: Path, out: Path, seconds: int) -> Mapping[str, str]:
    """Build twice, then the wheel from the source archive; raise NotReady if any two builds differ."""
    made = build(root, out, seconds)
    (archive,) = (out / name for name in made if name.endswith(".tar.gz"))
    with tempfile.TemporaryDirectory() as folder:
        again = build(root, Path(folder) / "again", seconds)
        with tarfile.open(archive) as packed:
            packed.extractall(Path(folder) / "source", filter="data")
        (unpacked,) = Path(folder, "source").iterdir()
        from_archive = build(unpacked, Path(folder) / "from_archive", seconds)
    wheels = {name: digest for name, digest in made.items() if name.endswith(".whl")}
    if again != made or not wheels.items() <= from_archive.items():
        raise NotReady(f"two builds differ:\n{made}\n{again}\n{from_archive}")
    return made


def try_wheel(wheel: Path, python: str) -> str:
    """Install the wheel into an empty environment and use it in an empty folder; return its output."""
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        bin_folder = home / "env" / "bin"
        clean = {
            name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")
        } | {"HOME": folder, "XDG_CACHE_HOME": str(home / "cache")}
        for command in (
            [python, "-m", "venv", "env"],
            [str(bin_folder / "pip"), "install", "--quiet", str(wheel.resolve())],
            [str(bin_folder / "acromion"), "version"],
            [str(bin_folder / "acromion"), "demo", "--hours", "0.2", "-o", "out"],
            [str(bin_folder / "python"), "-c", TRIAL],
        ):
            ended = subprocess.run(command, cwd=home, env=clean, capture_output=True, text=True, check=False)
            if ended.returncode:
                raise NotReady(f"{' '.join(command)} failed:\n{ended.stdout}{ended.stderr}")
        return ended.stdout.strip()


def release(out: Path, pythons: Sequence[str]) -> None:
    """Run all steps."""
    version = read_version(ROOT)
    check_changelog((ROOT / "CHANGELOG.md").read_text("utf-8"), version)
    check_citation(ROOT, version)
    check_committed(ROOT)
    out.mkdir(parents=True)
    made = build_twice(ROOT, out, int(_ask(["git", "log", "-1", "--format=%ct"], ROOT)))
    (wheel,) = (out / name for name in made if name.endswith(".whl"))
    for python in pythons:
        print(f"{_ask([python, '--version'], ROOT)}: {try_wheel(wheel, python)}")
    lines = "".join(f"{digest}  {name}\n" for name, digest in made.items())
    (out / "SHA256SUMS").write_text(lines, "utf-8")
    print(lines, end="")


def _ask(command: Sequence[str], folder: Path) -> str:
    return subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True).stdout.strip()


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-o", "--out", type=Path, default=ROOT / "dist", help="a new folder")
    parser.add_argument(
        "--python", action="append", help="an interpreter to test the wheel with; may be repeated"
    )
    asked = parser.parse_args()
    try:
        release(asked.out, asked.python or [sys.executable])
    except NotReady as reason:
        raise SystemExit(f"not released: {reason}") from None


if __name__ == "__main__":
    main()
