"""Follow the steps of ``docker/Dockerfile`` without a container engine: in an empty root, with chroot.

    debootstrap --variant=minbase bookworm BASE              an empty Debian
    cp -a PYTHON/. BASE/usr/local/ && chroot BASE ldconfig   a Python 3.12, as in the base image
    python -m benchmarks.container BASE WORK                 as root, on Linux

Each stage is a copy of BASE in WORK. FROM, WORKDIR, COPY, RUN, USER and ENV work as in Docker. At the end the
program of ENTRYPOINT and CMD starts as in ``compose.yaml`` (read-only except ``/tmp`` and the volume, here
with a network that reaches no other computer), and its HEALTHCHECK must succeed.
"""

import argparse
import json
import os
import re
import shlex
import shutil
import subprocess
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
HEALTHY_WITHIN_S = 120
PASSED_ON = ("PIP_CERT", "PIP_INDEX_URL", "SSL_CERT_FILE", "HTTPS_PROXY", "https_proxy")
"""Variables that this machine needs to reach its package index; not stored in the root's files."""


@dataclass
class Stage:
    """An image being built."""

    root: Path
    folder: str = "/"
    user: str = "root"
    variables: dict[str, str] = field(
        default_factory=lambda: {"PATH": "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"}
    )
    entry: list[str] = field(default_factory=list)
    command: list[str] = field(default_factory=list)
    health: list[str] = field(default_factory=list)


def read_steps(text: str) -> Iterator[tuple[str, str]]:
    """Yield each instruction and its words, without comments, with continued lines joined."""
    bare = re.sub(r"^\s*#.*\n", "", text, flags=re.MULTILINE)
    for line in re.sub(r"\\\n\s*", " ", bare).splitlines():
        if line.strip():
            name, _, words = line.strip().partition(" ")
            yield name, words


def run_steps(base: Path, work: Path) -> Stage:
    """Run every step; a failing command ends the run."""
    stages: dict[str, Stage] = {}
    stage = Stage(base)
    for name, words in read_steps((ROOT / "docker" / "Dockerfile").read_text("utf-8")):
        print(name, words[:100], flush=True)
        if name == "FROM":
            title = words.partition(" AS ")[2] or "final"
            stage = stages[title] = Stage(work / title)
            subprocess.run(["cp", "-a", "--", str(base), str(stage.root)], check=True)
        elif name == "COPY":
            _copy(shlex.split(words), stage, stages)
        elif name == "RUN":
            _run(f"mount -t proc proc {stage.root}/proc && {_enter(stage, words)}", stage)
        else:
            _apply_setting(name, words, stage)
    return stage


def _apply_setting(name: str, words: str, stage: Stage) -> None:
    if name == "WORKDIR":
        stage.folder = words
        (stage.root / words.lstrip("/")).mkdir(parents=True, exist_ok=True)
    elif name == "USER":
        stage.user = words
    elif name == "ENV":
        for pair in shlex.split(words):
            key, _, value = pair.partition("=")
            stage.variables[key] = value.replace("$PATH", stage.variables["PATH"])
    elif name == "ENTRYPOINT":
        stage.entry = json.loads(words)
    elif name == "CMD":
        stage.command = json.loads(words)
    elif name == "HEALTHCHECK":
        stage.health = json.loads(words.partition("CMD ")[2])


def _copy(words: list[str], stage: Stage, stages: dict[str, Stage]) -> None:
    source = ROOT
    if words[0].startswith("--from="):
        source = stages[words.pop(0).partition("=")[2]].root
    *names, target = words
    goal = stage.root / str(Path(stage.folder) / target).lstrip("/")
    for name in names:
        found = source / name.lstrip("/")
        if found.is_dir():
            unwanted = shutil.ignore_patterns("__pycache__") if source == ROOT else None
            shutil.copytree(found, goal, symlinks=True, dirs_exist_ok=True, ignore=unwanted)
        else:
            shutil.copy(found, goal / found.name if target.endswith("/") or goal.is_dir() else goal)


def _enter(stage: Stage, script: str) -> str:
    """Return the shell command that runs a script inside, as the stage's user, in its folder."""
    number = "0:0" if stage.user == "root" else "1000:1000"
    inside = shlex.join(["/bin/sh", "-c", f"cd {shlex.quote(stage.folder)} && {script}"])
    return f"chroot --userspec={number} {stage.root} {inside}"


def _run(script: str, stage: Stage, *isolated: str) -> None:
    """Run a script of the outer shell with separate mounts and processes, which end with it."""
    own = ["unshare", "--mount", "--pid", "--fork", "--kill-child", *isolated, "/bin/sh", "-ec", script]
    subprocess.run(own, env=_build_environment(stage), check=True)


def _build_environment(stage: Stage) -> dict[str, str]:
    home = "/root" if stage.user == "root" else f"/home/{stage.user}"
    known = {name: os.environ[name] for name in PASSED_ON if name in os.environ}
    return known | stage.variables | {"HOME": home}


def start(stage: Stage) -> None:
    """Start the program as the compose file does, and poll its health check until it succeeds."""
    serve = _enter(stage, "exec " + shlex.join([*stage.entry, *stage.command]))
    healthy = _enter(stage, shlex.join(stage.health))
    script = f"""
mount --bind {stage.root} {stage.root}
mount -t proc proc {stage.root}/proc
mount -t tmpfs -o mode=0700,uid=1000,gid=1000 data {stage.root}/data
mount -t tmpfs -o mode=1777 tmp {stage.root}/tmp
mount -o remount,bind,ro {stage.root}
ip link set lo up
{serve} &
for second in $(seq {HEALTHY_WITHIN_S}); do
  if {healthy} 2>/dev/null; then echo healthy after $second s; kill $!; wait $! || true; exit 0; fi
  sleep 1
done
echo never healthy
exit 1"""
    _run(script, stage, "--net")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("base", type=Path, help="an empty Debian with a Python in /usr/local")
    parser.add_argument("work", type=Path, help="a folder that does not exist yet; the stages are kept in it")
    asked = parser.parse_args()
    os.umask(0o022)
    asked.work.mkdir()
    began = time.monotonic()
    start(run_steps(asked.base, asked.work))
    print(f"{time.monotonic() - began:.0f} s")


if __name__ == "__main__":
    main()
