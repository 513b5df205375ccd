"""A server, workers and clients that can be killed at any instant, and the invariants checked afterwards."""

import hashlib
import math
import os
import random
import re
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Literal

import httpx2

from acromion.app.errors import Crashed, Interrupted
from acromion.app.library.audit_log import AuditFilter, find_lines
from acromion.app.library.jobs import JobStore
from acromion.app.library.rows import Job, JobState
from acromion.app.ops.verify import find_expected, find_faults
from acromion.app.settings import Settings
from acromion.app.store.folder import format_result_name, open_storage
from tests import ROOT
from tests.ways_in.servers import list_children, read_stat, wait_for

Victim = Literal["web", "worker", "child", "all"]
PARTS: tuple[Victim, ...] = ("web", "worker", "child")
Environment = Mapping[str, str]
_NONE: Environment = {}
END_PATIENCE_S = 600.0  # only a queue in which nothing ends for so long is called stuck
LOSSES = frozenset({"missing", "damaged"})  # other findings, as of files without a row, a start puts right
ENDS_BORNE = 5  # ends of the host that an analysis outlives before it is set aside


@dataclass
class Journal:
    """What the server has acknowledged, and the last that was seen of it."""

    recordings: dict[str, tuple[str, str]] = field(default_factory=dict)  # analysis: (recording, SHA-256)
    ends: dict[str, tuple[JobState, str | None]] = field(default_factory=dict)
    cuts: Counter[str] = field(default_factory=Counter)  # how often an analysis lost its worker by our hand
    retried: set[str] = field(default_factory=set)  # set aside after five such ends, and asked for again


class Site:
    """One data folder with its server and its workers; ``root`` is where their code is."""

    def __init__(
        self,
        data: Path,
        log: Path,
        sync: str = "synced",
        workers: int = 1,
        environment: Environment = _NONE,
        *,
        root: Path = ROOT,
    ) -> None:
        self.settings = Settings(data_dir=data, min_free_bytes=0)
        self._log, self._sync, self._environment, self._root = log, sync, environment, root
        self._web: subprocess.Popen[bytes] | None = None
        self._workers: list[subprocess.Popen[bytes]] = []
        self._wanted = workers
        self.address = ""
        self.start()

    def start(self) -> None:
        """Start whatever does not run."""
        if self._web is None or self._web.poll() is not None:
            self._log.write_bytes(b"")
            self._web = self._launch("web")
            self.address = wait_for(self._find_address, math.inf)  # fails at once when the server ends
        self._workers = [worker for worker in self._workers if worker.poll() is None]
        while len(self._workers) < self._wanted:
            self._workers.append(self._launch("worker"))

    def kill(self, victim: Victim, dice: random.Random) -> None:
        """Kill -9, with no chance to tidy up; "all" is every process, the helpers and children too."""
        assert self._web is not None
        if victim == "all":
            self.end()
            return
        groups = {"web": [self._web], "worker": self._workers}
        if victim == "child":
            children = self._find_attempts()
            if children:
                _end(dice.choice(children))
            return
        for process in groups[victim]:
            process.kill()
            process.wait()

    @property
    def web_pid(self) -> int:
        """The process that takes uploads."""
        assert self._web is not None
        return self._web.pid

    def freeze(self) -> None:
        """Stop every process where it stands, and wait until every thread does.

        Sending returns before that: until the signalled thread runs (it may wait for the disk),
        the others go on and may acknowledge.
        """
        pids = self._list_all()
        for pid in pids:
            os.kill(pid, signal.SIGSTOP)
        wait_for(lambda: all(_stands_still(pid) for pid in pids), math.inf)

    def check_lives(self) -> None:
        """Raise when the server or a worker has ended by itself: there is nothing to wait for."""
        for process in self._list_started():
            assert process.poll() is None, self._log.read_text(errors="replace")

    def end(self) -> None:
        """Kill everything; the parents first, so that none of them sees the death of a child."""
        for pid in self._list_all():
            _end(pid)
        for process in self._list_started():
            process.wait()

    def _launch(self, role: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", "tests.crash.program", role, str(self.settings.data_dir), self._sync]
        environment = os.environ | {"ACROMION_MIN_FREE_BYTES": "0", "PYTHONPATH": str(self._root)}
        environment |= self._environment
        with self._log.open("ab") as file:
            return subprocess.Popen(command, cwd=self._root, env=environment, stdout=file, stderr=file)

    def _find_address(self) -> str | None:
        assert self._web is not None
        text = self._log.read_text(errors="replace")
        assert self._web.poll() is None, text
        found = re.search(r"Acromion is at (http://\S+?)/ ", text)
        return found[1] if found else None

    def _list_started(self) -> list[subprocess.Popen[bytes]]:
        return [process for process in (self._web, *self._workers) if process is not None]

    def _list_all(self) -> list[int]:
        """Parents before children, so that nobody is started again meanwhile."""
        found = [process.pid for process in self._list_started() if process.poll() is None]
        for pid in found:
            found.extend(list_children(pid))
        return found

    def _find_attempts(self) -> list[int]:
        helpers = [child for worker in self._workers for child in list_children(worker.pid)]
        return [child for helper in helpers for child in list_children(helper)]


class Clients:
    """Threads that upload without a pause, and write down what was acknowledged.

    ``waits``: each waits for the end of its analysis, so that no queue grows on a slow machine.
    """

    def __init__(self, site: Site, journal: Journal, seed: int, *, waits: bool = False) -> None:
        self._site, self._journal, self._waits = site, journal, waits
        self._stopping = threading.Event()
        self._threads = [
            threading.Thread(target=self._upload, args=(random.Random(f"{seed} {k}"),), daemon=True)
            for k in range(3)
        ]
        for thread in self._threads:
            thread.start()

    def wait_for_first(self) -> None:
        """Wait for the first acknowledgement of all, however long a busy machine takes."""
        wait_for(self._has_first, math.inf)

    def stop(self) -> None:
        """Let every thread end; the server answers or is gone (one that is frozen is to be killed first)."""
        self._stopping.set()
        for thread in self._threads:
            thread.join()

    def _has_first(self) -> bool:
        self._site.check_lives()
        return bool(self._journal.recordings)

    def _upload(self, dice: random.Random) -> None:
        with httpx2.Client(timeout=None) as client:  # a killed server ends the connection
            while not self._stopping.is_set():
                content = dice.randbytes(dice.choice((100, 20_000, 700_000)))
                try:
                    answer = client.post(f"{self._site.address}/api/v1/analyze", content=content)
                except httpx2.HTTPError:
                    self._stopping.wait(0.05)
                    continue
                if answer.status_code == 202:
                    view = answer.json()
                    sha256 = hashlib.sha256(content).hexdigest()
                    self._journal.recordings[view["id"]] = (view["recording_id"], sha256)
                    if self._waits:
                        self._wait_for_end(client, view["id"])
                self._stopping.wait(dice.uniform(0, 0.1))

    def _wait_for_end(self, client: httpx2.Client, analysis_id: str) -> None:
        while not self._stopping.is_set():
            with suppress(httpx2.HTTPError):  # the server was killed
                address = f"{self._site.address}/api/v1/analyses/{analysis_id}?wait=2"
                if client.get(address).json().get("state") in ("succeeded", "failed"):
                    return
            self._stopping.wait(0.05)


def check_acknowledged(settings: Settings, journal: Journal) -> list[str]:
    """I1, I2, I3, I5: all that was acknowledged is there, whole, in a state that may follow the last seen."""
    broken: list[str] = []
    acknowledged = journal.recordings.copy()  # first: what is acknowledged later need not be read
    store = JobStore(settings)
    jobs = {job.id: job for job in store.find_newest(1_000_000)}
    store.close()
    for analysis_id, (recording_id, sha256) in acknowledged.items():
        job = jobs.get(analysis_id)
        if job is None:
            broken.append(f"I1 {analysis_id} lost")
        elif (job.sha256, job.recording_id) != (sha256, recording_id):
            broken.append(f"I2 {analysis_id} holds other bytes")
        elif not _may_follow(journal.ends.get(analysis_id), job):
            broken.append(f"I3 {analysis_id} went back from its end")
        elif job.is_over:
            journal.ends[analysis_id] = (job.state, job.token)
    faults = find_faults(settings, find_expected(settings))
    return broken + [f"I2/I5 {fault.name} {fault.finding}" for fault in faults if fault.finding in LOSSES]


def check_settled(settings: Settings, journal: Journal) -> list[str]:
    """I4, I6, I7, I15: undisturbed, every analysis ends well, once, and nothing half-made is left."""
    store = JobStore(settings)
    try:
        _wait_for_ends(store)
        _retry_set_aside(store, journal)
        _wait_for_ends(store)
    except TimeoutError:
        return [f"I6 {job.id} is stuck: {job.state}, attempt {job.attempts}" for job in _list_open(store)]
    finally:
        store.close()
    broken = check_acknowledged(settings, journal) + _check_results(settings, journal) + find_litter(settings)
    return broken + _find_lags(settings) + check_audit_log(settings, journal)


def check_audit_log(settings: Settings, journal: Journal) -> list[str]:
    """Every act that was acknowledged has its line, once; every line is of an act."""
    store = JobStore(settings)
    try:
        lines = tuple(find_lines(store.reader, AuditFilter()))
        jobs = {job.id: job for job in store.find_newest(1_000_000)}
    finally:
        store.close()
    stored = Counter(line.recording_id for line in lines if line.act == "recording.stored")
    asked = Counter(line.analysis_id for line in lines if line.act == "analysis.asked")
    ended = Counter(line.analysis_id for line in lines if line.act == "analysis.succeeded")
    expected = {
        "stored": Counter({job.recording_id for job in jobs.values()}),
        "asked": Counter(jobs.keys()),
        "succeeded": Counter(one for one, job in jobs.items() if job.state is JobState.SUCCEEDED),
    }
    found = {"stored": stored, "asked": asked, "succeeded": ended}
    broken = [f"T lines {name} differ from the rows" for name in expected if found[name] != expected[name]]
    return broken + [f"T {one} has no line" for one in journal.recordings if asked[one] != 1]


def _find_lags(settings: Settings) -> list[str]:
    """Side files that do not say what their rows say, once their writers have had time."""
    try:
        wait_for(lambda: not _list_lags(settings), END_PATIENCE_S)
    except TimeoutError:
        return _list_lags(settings)
    return []


def _list_lags(settings: Settings) -> list[str]:
    faults = find_faults(settings, find_expected(settings))
    return [f"I15 {fault.name} {fault.finding}" for fault in faults if fault.finding.startswith("side_")]


def _wait_for_ends(store: JobStore) -> None:
    """A long queue may take its time on a busy machine; a queue in which nothing ends is stuck."""
    while waiting := len(_list_open(store)):
        wait_for(partial(_has_fewer_open, store, waiting), END_PATIENCE_S)


def _retry_set_aside(store: JobStore, journal: Journal) -> None:
    """Ask again for what was set aside after enough ends of its host; after fewer it stays, as a break."""
    for job in store.find_newest(1_000_000):
        if job.problem_code == Interrupted.code and journal.cuts[job.id] >= ENDS_BORNE:
            journal.recordings[store.retry(job.id).id] = journal.recordings.pop(job.id)
            journal.retried.add(job.id)


def _has_fewer_open(store: JobStore, than: int) -> bool:
    return len(_list_open(store)) < than


def _list_open(store: JobStore) -> list[Job]:
    return [job for job in store.find_newest(1_000_000) if not job.is_over]


def count_blamed(settings: Settings) -> int:
    """Count the analyses that ended as E-CRASHED: every recording here is sound."""
    store = JobStore(settings)
    blamed = store.count_problems().get(Crashed.code, 0)
    store.close()
    return blamed


def _check_results(settings: Settings, journal: Journal) -> list[str]:
    broken, storage = [], open_storage(settings)
    for analysis_id, (_, sha256) in journal.recordings.items():
        state, token = journal.ends[analysis_id]
        result = format_result_name(analysis_id, str(token), "results.json")
        if state is not JobState.SUCCEEDED or sha256.encode() not in storage.read_part(result, 0, 1 << 20):
            broken.append(f"I4 {analysis_id} ended {state}")
    return broken


def find_litter(settings: Settings) -> list[str]:
    """Files on the disk that no row promises; each recording has its side file."""
    promised = {file.name for file in find_expected(settings)}
    promised |= {f"{name}.json" for name in promised if name.startswith("recordings/")}
    kept = [path for kind in ("recordings", "analyses") for path in (settings.data_dir / kind).rglob("*")]
    names = {str(path.relative_to(settings.data_dir)) for path in kept if path.is_file()}
    return [f"I7 {name} has no row" for name in sorted(names - promised)]


def _may_follow(before: tuple[JobState, str | None] | None, job: Job) -> bool:
    return before is None or before == (job.state, job.token)


def _stands_still(pid: int) -> bool:
    states = [read_stat(path)[:1] for path in Path(f"/proc/{pid}/task").glob("*/stat")]
    return all(state in ([], ["T"], ["Z"]) for state in states)


def _end(pid: int) -> None:
    try:
        os.kill(pid, signal.SIGKILL)
    except ProcessLookupError:
        time.sleep(0)  # it had ended by itself
