"""One run as several processes: each does a slice into the same folder, and one makes the tables in the end.

What they tell each other lies in ``shards/`` of the results: ``plan.json`` names every recording, its folder
and what is asked of it; it is the same whichever process writes it. ``K-of-N.json`` has the failures of one
slice, which leave no folder. Neither holds a path of this computer.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from app.batch.folder import has_report, read_marker, take_fingerprint
from app.batch.plan import SHARDS, Task
from app.batch.run import Outcome
from app.errors import Interrupted
from app.request import ReportRequest
from app.storage.store import write_durably

SHARD_HINT = "K/N, 1 <= K <= N"
_PLAN = "plan.json"


@dataclass(frozen=True, slots=True)
class Shard:
    """The K-th of N slices; K counts from 1."""

    number: int
    count: int

    def select(self, tasks: Sequence[Task]) -> list[Task]:
        """Give every N-th task in the order of their paths: slices differ by one recording at most."""
        ordered = sorted(tasks, key=lambda task: (task.name, task.folder.name))
        return ordered[self.number - 1 :: self.count]

    @property
    def stem(self) -> str:
        """Where its failures stand, without ".json"."""
        return f"{self.number}-of-{self.count}"

    def __str__(self) -> str:
        """Write it as it is typed."""
        return f"{self.number}/{self.count}"


def parse_shard(text: str) -> Shard:
    """Read ``K/N``. Raises ValueError."""
    number, count = (int(part) for part in text.split("/"))
    if not 1 <= number <= count:
        raise ValueError(SHARD_HINT)
    return Shard(number, count)


class ShardRecord:
    """What one slice leaves for ``acromion collect``."""

    def __init__(self, out: Path, shard: Shard, tasks: Sequence[Task], request: ReportRequest) -> None:
        recordings = [
            {
                "path": task.name,
                "folder": task.folder.name,
                "request": replace(task.request, joined=()).to_json(),
            }
            for task in tasks
        ]
        self._folder, self._shard = out / SHARDS, shard
        self._content = _encode({"request": request.to_json(), "recordings": recordings})
        self._plan_sha256 = hashlib.sha256(self._content).hexdigest()

    def begin(self) -> None:
        """Write the plan, and take back what an earlier run of this slice, or of other slices, reported."""
        self._folder.mkdir(parents=True, exist_ok=True)
        plan = self._folder / _PLAN
        if not plan.exists() or plan.read_bytes() != self._content:
            write_durably(plan, self._content)
        for path in self._folder.glob("*-of-*.json"):
            if not path.name.endswith(f"-of-{self._shard.count}.json"):
                path.unlink(missing_ok=True)
        self.write(())

    def write(self, outcomes: Sequence[Outcome]) -> None:
        """Write the failures of this slice."""
        problems = {o.task.name: {"code": o.code, "facts": dict(o.facts)} for o in outcomes if o.code}
        body = _encode({"plan": self._plan_sha256, "problems": problems})
        write_durably(self._folder / f"{self._shard.stem}.json", body)


@dataclass(frozen=True, slots=True)
class Collected:
    """What all slices left.

    ``undone`` are the slices ("K/N") that have recordings to do still, and ``differing`` those that ran with
    other files or options than the slice that began last.
    """

    outcomes: list[Outcome]
    request: ReportRequest
    undone: tuple[str, ...]
    differing: tuple[str, ...]


def collect_outcomes(out: Path) -> Collected:
    """Read what became of every recording of the plan, in its order, and the settings of the run.

    A recording without a report or a failure is not done: a process that was killed can say nothing.

    Raises
    ------
    OSError, ValueError, KeyError, TypeError
        Where no process with ``--shard`` has written, or its plan cannot be read.
    """
    content = (out / SHARDS / _PLAN).read_bytes()
    plan, plan_sha256 = json.loads(content), hashlib.sha256(content).hexdigest()
    records = {path.stem: json.loads(path.read_bytes()) for path in (out / SHARDS).glob("*-of-*.json")}
    others = {stem for stem, record in records.items() if record["plan"] != plan_sha256}
    problems: dict[str, Mapping[str, Any]] = {}
    for stem in records.keys() - others:  # what was reported of other plans says nothing
        problems |= records[stem]["problems"]
    outcomes = [_find_outcome(out, told, problems.get(told["path"])) for told in plan["recordings"]]
    undone = {outcome.task.name for outcome in outcomes if outcome.code == Interrupted.code}
    tasks = [outcome.task for outcome in outcomes]
    count = max(int(stem.split("-of-")[1]) for stem in records)
    shards = [Shard(number, count) for number in range(1, count + 1)]
    return Collected(
        outcomes,
        ReportRequest.from_json(plan["request"]),
        tuple(str(one) for one in shards if any(task.name in undone for task in one.select(tasks))),
        tuple(str(one) for one in shards if one.stem in others),
    )


def _encode(value: Any) -> bytes:
    return (json.dumps(value, ensure_ascii=False, indent=1) + "\n").encode()


def _find_outcome(out: Path, told: Mapping[str, Any], problem: Mapping[str, Any] | None) -> Outcome:
    """Give what became of one recording: its failure, its report, or nothing yet."""
    request = ReportRequest.from_json(told["request"])
    task = Task(Path(told["path"]), request, out / told["folder"], path=told["path"])
    if problem is not None:
        return Outcome(task, code=problem["code"], facts=problem["facts"])
    marker = read_marker(task.folder)
    is_current = marker is not None and marker.fingerprint == take_fingerprint(marker.input, request)
    if marker is None or not is_current or not has_report(task.folder, marker, request):
        return Outcome(task, code=Interrupted.code)
    return Outcome(task, version=marker.version)
