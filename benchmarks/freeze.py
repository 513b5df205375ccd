"""Record digests of the command line's output, and compare them after a change that must not alter a result.

    python -m benchmarks.freeze make FILE       write the digest of every output
    python -m benchmarks.freeze compare FILE    create the outputs again and list the differences (exit 1)

Covers the samples and flags of every readable recording under ``../shared/data``, and a dozen recordings of
every format, with the settings that change a report, pairs, changes and agreements. Recordings under
``../shared/data`` are used if they exist; the others are simulated. ``software.revision`` would change with
every source file, so it alone is replaced by a constant.
"""

import argparse
import hashlib
import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SHARED = ROOT.parent / "shared" / "data"
HOLD_REVISION = "import acromion.app.version\napp.version._source_files = lambda: []\n"
PASSING = frozenset({"run.json", "done.json"})
"""Files that contain the time of the run or the path of the output folder."""
END_TIME = re.compile(rb'"endTime": "[^"]*"')
"""The time of the run in the RO-Crate."""

SIMULATED: Mapping[str, tuple[str, ...]] = {
    "gt9x": ("--device", "gt9x", "--hours", "0.75", "--seed", "1"),
    "gt9x_later": ("--device", "gt9x", "--hours", "0.75", "--seed", "2"),
    "lsm9ds1": ("--device", "lsm9ds1", "--hours", "0.4", "--seed", "3"),
}
RECORDINGS: Mapping[str, str] = {
    "real_gt3x": "gt9x/link_imu_100hz_179s.gt3x",
    "real_actilife": "gt9x/link_imu_100hz_179s_actilife.csv",
    "real_excel": "gt9x/link_imu_23s_excel_resaved.csv",
    "real_nano": "lsm9ds1/arduino_nano_hori.csv",
    "real_rpi": "lsm9ds1/calib1.dat",
    "real_cwa": "other_layouts/ax6_sample.cwa",
    "real_pololu": "other_layouts/pololu_raw_ms.txt",
    "real_xio": "other_layouts/xio_seconds_dps_g.csv",
    "real_ferraris": "calibration/example_ferraris_session.csv",
}
DIARY = "start,end,kind,label\n07:05:00,07:15:00,task,packing\n07:15:00,07:20:00,break,tea\n"


def main() -> None:
    """Create the digests, or compare with those of a file."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("verb", choices=("make", "compare"))
    parser.add_argument("file", type=Path)
    parser.add_argument("--keep", type=Path, help="keep the outputs in this folder")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = freeze(asked.keep or Path(folder))
    if asked.verb == "make":
        asked.file.write_text(json.dumps(found, indent=0, sort_keys=True))
        print(f"{len(found)} outputs frozen")
        return
    frozen = json.loads(asked.file.read_text())
    differing = sorted(name for name in frozen.keys() | found.keys() if frozen.get(name) != found.get(name))
    print(*differing, f"{len(frozen)} outputs frozen, {len(differing)} differ", sep="\n")
    sys.exit(1 if differing else 0)


def freeze(folder: Path) -> dict[str, str]:
    """Create every output in a folder; return the SHA-256 of each by its name."""
    work, hook = folder / "work", folder / "hook"
    for made in (work, hook):
        made.mkdir(parents=True)
    (hook / "sitecustomize.py").write_text(HOLD_REVISION)
    found = {}
    for name, command in list_commands(work):
        found[f"{name}/screen"] = _hash(_run(command, hook, work))
    found |= {f"samples/{path.relative_to(SHARED)}": digest_samples(path) for path in list_shared()}
    for path in sorted(work.rglob("*")):
        if path.is_file() and path.name not in PASSING:
            found[path.relative_to(work).as_posix()] = _hash(END_TIME.sub(b"", path.read_bytes()))
    return found


def list_shared() -> list[Path]:
    """Return the shared files that could be recordings."""
    return sorted(
        path
        for path in SHARED.rglob("*")
        if path.is_file() and path.suffix not in {".md", ".npz", ".mat"} and "LICENSE" not in path.name
    )


def digest_samples(path: Path) -> str:
    """Return the digest of a file as read (samples, segments, flags), or its error."""
    from acromion.fusion import read_recording  # noqa: PLC0415  only here
    from acromion.fusion.errors import FusionError  # noqa: PLC0415

    digest = hashlib.sha256()
    try:
        recording = read_recording(path)
    except FusionError as refused:
        return f"{refused.code} {_hash(repr(sorted(refused.facts.items())).encode())}"
    for segment in recording.segments:
        digest.update(repr((segment.start_us, segment.rate_hz, segment.bridged)).encode())
        digest.update(segment.acc_g.tobytes())
        digest.update(segment.gyr_dps.tobytes())
    flags = " ".join(sorted(str(flag.code) for flag in recording.flags))
    return f"{digest.hexdigest()} {flags}"


def list_commands(work: Path) -> Iterator[tuple[str, list[str]]]:
    """Yield every command in order; later ones use the output of earlier ones."""
    for name, options in SIMULATED.items():
        yield f"simulate_{name}", ["simulate", name, *options]
    for name, path in RECORDINGS.items():
        if (SHARED / path).exists():
            yield f"inspect_{name}", ["inspect", str(SHARED / path), "--json"]
            yield name, ["run", str(SHARED / path), "-o", f"out/{name}", "--rate-hz", "100"]
    (work / "diary.csv").write_text(DIARY)
    first, second = "gt9x/*.gt3x", "gt9x_later/*.gt3x"
    subject = ["--subject", "S012", "--side", "left"]
    yield "left", ["run", first, "-o", "out/left", *subject, "--diary", "diary.csv", "--lang", "fr"]
    yield "right", ["run", second, "-o", "out/right", "--subject", "S012", "--side", "right"]
    yield "later", ["run", second, "-o", "out/later", *subject, "--paper", "letter"]
    yield "actilife", ["run", "gt9x/*.csv", "-o", "out/actilife"]
    yield "lsm9ds1", ["run", "lsm9ds1/*.csv", "-o", "out/lsm9ds1"]
    yield "published", ["run", first, "-o", "out/published", "--method", "published", "--report", "html"]
    yield "live", ["run", first, "-o", "out/live", "--method", "live", "--report", "html"]
    yield "window", ["run", first, "-o", "out/window", "--calibration", "5,15", "--report", "html"]
    yield "lean", ["run", first, "-o", "out/lean", "--pose", "side-lean", "--report", "html"]
    two = ["--pose", "two-point", "--calibration", "5,15", "--calibration", "100,105"]
    yield "two_point", ["run", first, "-o", "out/two_point", *two, "--report", "html"]
    yield "joined", ["run", first, second, "--join", "-o", "out/joined", "--report", "html"]
    yield "study", ["run", "gt9x/*.gt3x", "gt9x_later/*.gt3x", "-o", "out/study", "--lang", "fr"]
    yield "pair", ["pair", "out/left/*", "out/right/*", "-o", "out/pair", "--offset-s", "5"]
    yield "compare", ["compare", "out/left/*", "out/later/*", "-o", "out/compare", "--lang", "fr"]
    yield "angles", ["exposure", "angles.csv", "-o", "out/angles"]
    yield "validate", ["validate", "gt9x/*.gt3x", "--reference", "angles.csv", "-o", "out/validate"]
    yield from _list_captures()
    yield "refused", ["run", *_list_refused(), "-o", "out/refused"]


def _list_captures() -> Iterator[tuple[str, list[str]]]:
    for path in sorted((SHARED / "xsens").glob("*")):
        if path.suffix in (".txt", ".csv", ".mvnx") and "LICENSE" not in path.name:
            yield f"xsens_{path.stem}", ["run", str(path), "-o", f"out/xsens_{path.stem}", "--side", "right"]


def _list_refused() -> list[str]:
    return [str(path) for path in sorted((SHARED / "refuse").glob("*")) if path.suffix not in (".md", "")]


def _run(command: list[str], hook: Path, work: Path) -> bytes:
    """Run one command as a user would; return its output, without paths of this machine."""
    if "angles.csv" in command and not (work / "angles.csv").exists():
        _write_angles(work)
    arguments = [found for word in command for found in _expand(word, work)]
    paths = os.pathsep.join((str(hook), str(ROOT)))
    environment = os.environ | {"PYTHONPATH": paths, "COLUMNS": "120", "TZ": "UTC"}
    done = subprocess.run(
        [sys.executable, "-m", "acromion", *arguments],
        cwd=work,
        env=environment,
        capture_output=True,
        check=False,
    )
    print(f"{done.returncode} {' '.join(command)}", flush=True)
    if command[0] == "run":  # its lines contain its duration
        return str(done.returncode).encode()
    output = done.stdout.replace(str(work).encode(), b"").replace(str(SHARED).encode(), b"")
    return str(done.returncode).encode() + output


def _expand(word: str, work: Path) -> list[str]:
    found = sorted(path for path in work.glob(word) if not path.name.startswith(".")) if "*" in word else []
    folders = [path for path in found if path.is_dir()] if word.endswith("/*") else found
    return [path.relative_to(work).as_posix() for path in folders] or [word]


def _write_angles(work: Path) -> None:
    """Write the true angle of the first simulated recording as a precomputed angle series at 20 Hz."""
    import pyarrow.parquet as pq  # noqa: PLC0415  only here

    truth = next((work / "gt9x").glob("*truth*.parquet"))
    table = pq.read_table(truth).to_pydict()
    rows = list(zip(table["time_s"], table["elevation_deg"], strict=True))[::5]
    lines = ["time_s,elevation_deg", *(f"{time_s:.2f},{angle_deg:.3f}" for time_s, angle_deg in rows)]
    (work / "angles.csv").write_text("\n".join(lines) + "\n")


def _hash(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


if __name__ == "__main__":
    main()
