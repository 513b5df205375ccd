"""A small store, made by a real server, to be copied and damaged: today's, yesterday's, and a foreign one."""

import base64
import hashlib
import math
import os
import re
import shutil
import signal
import subprocess
import sys
import zipfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx2

from acromion.fusion.simulation import simulate_shift, write_shift
from tests import ROOT
from tests.ways_in.servers import wait_for

MINUTE_HOURS = 1 / 60
TUS = {"Tus-Resumable": "1.0.0", "Content-Type": "application/offset+octet-stream"}
CODE = re.compile(r"\bE-[A-Z][A-Z-]+\b")


@dataclass(slots=True)
class Ended:
    """What a command came to."""

    exit_code: int
    output: str

    @property
    def code(self) -> str:
        """The code of the refusal; "" where there was none."""
        found = CODE.search(self.output)
        return found[0] if found else ""


@dataclass(frozen=True, slots=True)
class Store:
    """A data folder and what is in it.

    ``recordings`` gives the SHA-256 of all that are stored; of them ``recording`` has a note, an inspection
    and the finished ``analysis``, and ``trashed`` is in the trash. ``upload`` is under way: ``sent`` is its
    whole file.
    """

    folder: Path
    recordings: dict[str, str]
    recording: str
    analysis: str
    trashed: str
    upload: str
    sent: bytes = field(repr=False)

    @property
    def database(self) -> Path:
        """The file of the rows."""
        return self.folder / "acromion.sqlite3"

    def raw(self, recording_id: str) -> Path:
        """The bytes of a recording."""
        return self.folder / "recordings" / recording_id

    def side(self, recording_id: str) -> Path:
        """What lies beside them and says what the row says."""
        return self.folder / "recordings" / f"{recording_id}.json"

    def result(self, name: str) -> Path:
        """One file of the finished analysis."""
        return next((self.folder / "analyses" / self.analysis).glob(f"*/{name}"))

    def incoming(self) -> Path:
        """The bytes of the upload under way."""
        return self.folder / "incoming" / self.upload

    def move_to(self, folder: Path) -> "Store":
        """Say the same of a copy of the folder."""
        return Store(
            folder,
            self.recordings,
            self.recording,
            self.analysis,
            self.trashed,
            self.upload,
            self.sent,
        )


class Server:
    """``acromion serve`` on a folder that may be damaged: it is at an address, or it has ended."""

    def __init__(self, folder: Path, log: Path, workers: int = 0) -> None:
        command = [sys.executable, "-m", "acromion", "serve", "--port", "0", "-j", str(workers)]
        self._log = log
        with log.open("wb") as file:
            self._process = subprocess.Popen(
                [*command, "--data", str(folder)], cwd=ROOT, env=_environment(), stdout=file, stderr=file
            )
        wait_for(self._has_begun, math.inf)
        found = re.search(r"Acromion is at (http://\S+?)/ ", self.read_log())
        self.address = found[1] if found else ""
        apart = {"Connection": "close"}  # a bug's answer ends the connection; the next question needs its own
        self.client = httpx2.Client(base_url=self.address, timeout=None, headers=apart)

    @property
    def runs(self) -> bool:
        """Whether it serves."""
        return self._process.poll() is None

    def read_log(self) -> str:
        """Give what it has written."""
        return self._log.read_text(errors="replace")

    def stop(self) -> Ended:
        """Ask it to end, and wait until it has."""
        self.client.close()
        if self.runs:
            self._process.send_signal(signal.SIGTERM)
        return Ended(self._process.wait(), self.read_log())

    def send(self, method: str, path: str, **rest: Any) -> dict[str, Any]:
        """Ask for what must be answered well; gives the answer's JSON, {} where it has none."""
        answer = self.client.request(method, f"/api/v1{path}", **rest).raise_for_status()
        found: dict[str, Any] = answer.json() if answer.content else {}
        return found

    def wait_for_end(self, analysis_id: str) -> dict[str, Any]:
        """Wait until an analysis is over, however long it takes."""
        while True:
            view = self.send("GET", f"/analyses/{analysis_id}", params={"wait": 60})
            if view["state"] not in ("queued", "running"):
                return view

    def _has_begun(self) -> bool:
        return self._answers() or not self.runs

    def _answers(self) -> bool:
        """Return whether it takes requests: its address is printed a moment before."""
        found = re.search(r"Acromion is at (http://\S+?)/ ", self.read_log())
        try:
            return found is not None and httpx2.get(f"{found[1]}/healthz").status_code == 200
        except httpx2.HTTPError:
            return False


def run_command(*arguments: object) -> Ended:
    """Run ``acromion`` as a person would."""
    command = [sys.executable, "-m", "acromion", *map(str, arguments)]
    done = subprocess.run(command, cwd=ROOT, env=_environment(), capture_output=True, text=True, check=False)
    return Ended(done.returncode, done.stdout + done.stderr)


def build_stores(folder: Path) -> tuple[Store, Path, Store]:
    """Make a store, the copy of its folder of yesterday, and a foreign store."""
    folder.mkdir(parents=True, exist_ok=True)
    foreign = _build(folder / "foreign", _make_shifts(folder / "theirs", 3, seed=2))
    own = _build(folder / "own", _make_shifts(folder / "ours", 5, seed=1))
    return own, folder / "own" / "yesterday", foreign


def _build(folder: Path, shifts: list[bytes]) -> Store:
    """Fill a folder on two days: the older copy knows less."""
    folder.mkdir()
    data, (first, second, sent, *later) = folder / "data", shifts
    server = Server(data, folder / "log", workers=1)
    known = {_store(server, content, f"S-{k}"): content for k, content in enumerate((first, second))}
    recording, trashed = known
    analysis = server.send("POST", "/analyses", json={"recording_ids": [recording]})["id"]
    assert server.wait_for_end(analysis)["state"] == "succeeded"
    server.send("GET", f"/recordings/{recording}/inspection")
    upload = _begin_upload(server, sent)
    _send_more(server, upload, sent, 0, len(sent) // 3)
    server.stop()
    shutil.copytree(data, folder / "yesterday")
    server = Server(data, folder / "log")
    server.send("PATCH", f"/recordings/{recording}", json={"note": "N-1 of today"})
    server.send("PUT", f"/recordings/{recording}/periods", json=[PERIOD])
    known |= {_store(server, content, f"S-later-{k}"): content for k, content in enumerate(later)}
    server.send("DELETE", f"/recordings/{trashed}")
    _send_more(server, upload, sent, len(sent) // 3, 2 * len(sent) // 3)
    server.stop()
    digests = {name: hashlib.sha256(content).hexdigest() for name, content in known.items()}
    return Store(data, digests, recording, analysis, trashed, upload, sent)


PERIOD = {"start_s": 0, "end_s": 30, "kind": "task", "label": "sorting"}


def _make_shifts(folder: Path, number: int, seed: int) -> list[bytes]:
    """Make recordings of a minute that differ in the comment of their archive."""
    folder.mkdir()
    simulated = simulate_shift("gt9x", MINUTE_HOURS, seed=seed)
    shift, found = write_shift(folder, simulated, actilife_csv=False)[0], []
    for k in range(number):
        with zipfile.ZipFile(shift, "a") as archive:
            archive.comment = f"{seed} {k}".encode()
        found.append(shift.read_bytes())
    return found


def _store(server: Server, content: bytes, subject: str) -> str:
    params = {"file_name": f"{subject}.gt3x", "subject": subject, "side": "right"}
    return str(server.send("POST", "/recordings", content=content, params=params)["id"])


def _begin_upload(server: Server, content: bytes) -> str:
    name = base64.b64encode(b"upload.gt3x").decode()
    head = TUS | {"Upload-Length": str(len(content)), "Upload-Metadata": f"filename {name}"}
    del head["Content-Type"]
    answer = server.client.post("/api/v1/uploads", headers=head).raise_for_status()
    return str(answer.headers["Location"].rpartition("/")[2])


def _send_more(server: Server, upload: str, content: bytes, begin: int, end: int) -> None:
    head = TUS | {"Upload-Offset": str(begin)}
    server.client.patch(
        f"/api/v1/uploads/{upload}", headers=head, content=content[begin:end]
    ).raise_for_status()


def _environment() -> dict[str, str]:
    return os.environ | {"ACROMION_MIN_FREE_BYTES": "0"}
