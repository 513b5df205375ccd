"""Coverage-guided fuzzing with Atheris, which is only imported when it is run.

    python -m benchmarks.fuzz.atheris_targets --format "LSM9DS1 CSV" [libFuzzer options, a corpus folder]

The bytes from libFuzzer are the file (for the parts of a `.gt3x`: the part, put back into an archive). Any
exception except a FusionError, and any second not accounted for, stops the run and is stored. Modules with
compiled kernels report no coverage; they are reached through the Python around them. With NUMBA_BOUNDSCHECK=1
and a separate NUMBA_CACHE_DIR, they raise an error when they read outside an array.
"""

import argparse
import importlib
import io
import re
import sys
from collections.abc import Callable
from pathlib import Path

COMPILED = re.compile(r"^@(njit|kernel|inner)\b", re.MULTILINE)


def make_target(name: str) -> Callable[[bytes], None]:
    """Return the function that libFuzzer calls with each input."""
    readers = importlib.import_module("acromion.fusion.readers")
    errors = importlib.import_module("acromion.fusion.errors")
    outcome = importlib.import_module("benchmarks.fuzz.outcome")
    mutations = importlib.import_module("benchmarks.fuzz.mutations")
    seeds = importlib.import_module("benchmarks.fuzz.seeds")

    def read_one(content: bytes) -> None:
        if name == "gt3x log, checksums mended":
            content = b"".join(mutations.close_record(one) for one in mutations.split_records(content))
        elif name == "cwa, checksums mended":
            blocks = [content[at : at + 512] for at in range(1024, len(content), 512)]
            content = content[:1024] + b"".join(map(mutations.close_block, blocks))
        whole = seeds.wrap(name, content)
        try:
            recording = readers.read_recording(io.BytesIO(whole))
        except errors.FusionError:
            return
        outcome.check_recording(recording, outcome.PACKED_RATIO * len(whole))

    return read_one


def list_compiled() -> list[str]:
    """Return the modules with kernels: numba cannot compile code that Atheris has instrumented."""
    root = Path(__file__).parents[2]
    paths = sorted((root / "fusion").rglob("*.py"))
    compiled = [path for path in paths if COMPILED.search(path.read_text("utf-8"))]
    return [".".join(path.relative_to(root).with_suffix("").parts) for path in compiled]


def write_corpus(name: str, folder: Path) -> None:
    """Put the valid file of the format into the corpus, where libFuzzer starts."""
    folder.mkdir(parents=True, exist_ok=True)
    seeds = importlib.import_module("benchmarks.fuzz.seeds")
    (folder / "seed").write_bytes(seeds.SEEDS[name])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--format", required=True, help="as in benchmarks.fuzz.seeds")
    parser.add_argument("--corpus", type=Path, required=True)
    options, rest = parser.parse_known_args()
    atheris = importlib.import_module("atheris")
    with atheris.instrument_imports(include=["fusion"], exclude=list_compiled()):
        target = make_target(options.format)
    write_corpus(options.format, options.corpus)
    atheris.Setup([sys.argv[0], str(options.corpus), *rest], target)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
