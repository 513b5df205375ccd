"""The reader of ``docs/write-a-reader.md``, packed as its author would, installed in a fresh environment."""

import base64
import hashlib
import re
import struct
import subprocess
import sys
import sysconfig
import tomllib
import venv
import zipfile
from pathlib import Path

import numpy as np

from acromion.fusion.readers import read_recording
from acromion.fusion.simulation import write_recordings

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "write-a-reader.md"
START = 1_772_438_400  # 2026-03-02T08:00:00Z


def read_blocks() -> tuple[str, str]:
    """Return ``pyproject.toml`` and the module as the page prints them."""
    settings, module = re.findall(r"```(?:toml|python)\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)
    return settings, module


def write_wheel(folder: Path, module: str, version: str) -> Path:
    """Write the wheel that any build backend makes of the page: no backend need be installed."""
    project = tomllib.loads(read_blocks()[0])["project"]
    stem = f"{project['name'].replace('-', '_')}-{version}"
    groups = project["entry-points"].items()
    entries = "".join(
        f"[{group}]\n" + "".join(f"{name} = {value}\n" for name, value in named.items())
        for group, named in groups
    )
    files = {
        "acme_armband.py": module,
        f"{stem}.dist-info/METADATA": f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {version}\n",
        f"{stem}.dist-info/WHEEL": "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
        f"{stem}.dist-info/entry_points.txt": entries,
    }
    wheel = folder / f"{stem}-py3-none-any.whl"
    with zipfile.ZipFile(wheel, "w") as archive:
        for name, text in files.items():
            archive.writestr(name, text)
        archive.writestr(f"{stem}.dist-info/RECORD", _list_files(files, stem))
    return wheel


def _list_files(files: dict[str, str], stem: str) -> str:
    rows = []
    for name, text in files.items():
        digest = base64.urlsafe_b64encode(hashlib.sha256(text.encode()).digest()).decode().rstrip("=")
        rows.append(f"{name},sha256={digest},{len(text.encode())}\n")
    return "".join(rows) + f"{stem}.dist-info/RECORD,,\n"


def make_environment(folder: Path) -> Path:
    """Make a fresh environment that sees this program and what it needs; gives its Python."""
    venv.create(folder, with_pip=False)
    python = folder / "bin" / "python"
    here = sysconfig.get_path("purelib")
    packages = subprocess.run(
        [python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout.strip()
    (Path(packages) / "ours.pth").write_text(f"{ROOT}\nimport site; site.addsitedir({here!r})\n")
    return python


def install(python: Path, wheel: Path) -> None:
    """Install a wheel with no network."""
    command = [sys.executable, "-m", "pip", "--python", str(python), "install", "--quiet", "--no-index"]
    subprocess.run([*command, "--no-deps", "--force-reinstall", str(wheel)], check=True)


def write_armband(folder: Path) -> Path:
    """Write three minutes of a simulated shift as the armband would, at 100 Hz."""
    recording = read_recording(write_recordings(folder / "made", "lsm9ds1", 0.05, 1, 100.0)[0])
    scaled = [(run.acc_g * 2048, run.gyr_dps * 16.4) for run in recording.segments]
    rows = np.concatenate([np.hstack(both) for both in scaled]).round().astype("<i2")
    path = folder / "shift.acme"
    path.write_bytes(struct.pack("<4sHHq", b"ACME", 7, 100, START) + rows.tobytes())
    return path
