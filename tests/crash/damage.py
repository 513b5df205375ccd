"""The damage matrix: one part of a store is damaged, then the software is asked to do one thing.

In every cell these hold (:func:`observe` names each break): the software has removed no byte that was there,
though it may have moved it; it has answered nothing damaged as good; a recording whose bytes are gone or
altered has kept its row, and ``verify`` names it; nothing ended in a traceback or a 500.
"""

import hashlib
import re
import shutil
import sqlite3
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args

import httpx2

from acromion.app.settings import Settings
from acromion.app.store.folder import open_storage
from tests.crash.stores import CODE, TUS, Ended, Server, Store, build_stores, run_command

Part = Literal[
    "database",
    "raw file",
    "side file",
    "result",
    "report",
    "inspection",
    "trash",
    "upload in flight",
    "stranger's files",
]
Damage = Literal["missing", "emptied", "older", "one byte altered", "foreign"]
Action = Literal["start", "serve", "analyse again", "backup", "verify", "restore", "recover"]
PARTS: tuple[Part, ...] = get_args(Part)
DAMAGES: tuple[Damage, ...] = get_args(Damage)
ACTIONS: tuple[Action, ...] = get_args(Action)

_UNCHANGING = "its bytes never change, so no older state exists"
_ONLY_PRESENT = "such files are only there or not there"
MEANINGLESS: Mapping[tuple[Part, Damage], str] = {
    ("raw file", "older"): _UNCHANGING,
    ("result", "older"): _UNCHANGING,
    ("report", "older"): _UNCHANGING,
    ("trash", "older"): _UNCHANGING,
    ("inspection", "older"): "it follows from bytes that never change",
    **{("stranger's files", damage): _ONLY_PRESENT for damage in DAMAGES if damage != "foreign"},
}
MEANINGLESS_ACTIONS: Mapping[tuple[Part, Action], str] = {
    ("upload in flight", "analyse again"): "what is still arriving cannot be analysed",
}
PROMISED: frozenset[Part] = frozenset({"raw file", "result", "report", "trash"})
"""Parts whose bytes a row promises by SHA-256: verify and backup name their damage."""
LIMITS: Mapping[tuple[Part, Damage], str] = {
    ("upload in flight", "one byte altered"): "no digest of an upload exists before its end",
    ("upload in flight", "foreign"): "no digest of an upload exists before its end",
    ("inspection", "foreign"): "it is a value of a row, and rows have no digest",
}
"""Damage that nothing can tell, and why."""
VANISHING = ("cache", "server.lock", "inspections", "acromion.sqlite3", "copies")
_STRANGERS = (
    "recordings/notes.txt",
    "recordings/holiday/photo.jpg",
    "uploads/letter.odt",
    "incoming/list.csv",
    "analyses/an_0000000000000000/1111111111111111/thesis.txt",
)


@dataclass(frozen=True, slots=True)
class Cell:
    """One cell of the matrix."""

    part: Part
    damage: Damage
    action: Action

    @property
    def why_meaningless(self) -> str:
        """Why it is left out; "" when it is not."""
        of_part = MEANINGLESS.get((self.part, self.damage), "")
        return of_part or MEANINGLESS_ACTIONS.get((self.part, self.action), "")

    @property
    def limit(self) -> str:
        """Why nothing can detect this damage; "" when it is detectable."""
        return LIMITS.get((self.part, self.damage), "")


@dataclass(slots=True)
class Seen:
    """What was seen in a cell: a word of a fixed vocabulary, what it was read from, and what was broken."""

    word: str = ""
    detail: str = ""
    broken: list[str] = field(default_factory=list)

    def expect(self, holds: object, what: str) -> None:
        """Write down as broken what does not hold."""
        if not holds:
            self.broken.append(what)


@dataclass(frozen=True, slots=True)
class Stock:
    """What every cell starts from, and what is answered of it while nothing is damaged."""

    own: Store
    yesterday: Path
    foreign: Store
    backup: Path
    answers: Mapping[str, str]
    """Digests of bodies by address; of files only, for pages tell the time."""
    doctor: frozenset[str]


def make_stock(folder: Path) -> Stock:
    """Build the stores, and see that all is well with them.

    Raises
    ------
    RuntimeError
        When the undamaged store is not answered well: the matrix would mean nothing.
    """
    own, yesterday, foreign = build_stores(folder)
    whole = own.move_to(folder / "whole")
    shutil.copytree(own.folder, whole.folder)
    verified = run_command("verify", "--data", whole.folder)
    backed_up = run_command("backup", folder / "whole.zip", "--data", whole.folder)
    doctor = run_command("doctor", "--data", whole.folder)
    server = Server(whole.folder, folder / "log")
    answers = {path: server.client.get(path) for path in _list_addresses(own)}
    server.stop()
    bad = [f"{path}: {answer.status_code}" for path, answer in answers.items() if answer.status_code != 200]
    if bad or verified.exit_code or backed_up.exit_code:
        raise RuntimeError(f"{bad} {verified} {backed_up}")
    digests = {path: _hash(answer.content) for path, answer in answers.items() if path.startswith("/api")}
    shutil.rmtree(whole.folder)
    return Stock(own, yesterday, foreign, folder / "whole.zip", digests, _read_lines(doctor))


def list_cells() -> Iterator[Cell]:
    """Return every cell, the meaningless ones too."""
    for part in PARTS:
        for damage in DAMAGES:
            for action in ACTIONS:
                yield Cell(part, damage, action)


def observe(stock: Stock, cell: Cell, folder: Path) -> Seen:
    """Copy the store, damage it, do the action, and say what was seen."""
    store = stock.own.move_to(folder / "data")
    shutil.copytree(stock.own.folder, store.folder)
    _inflict(stock, cell, store)
    before, seen = _list_digests(store.folder, with_side_files=_keeps_side_files(cell)), Seen()
    scene = Scene(stock, cell, store, folder, seen)
    try:
        _ACTS[cell.action](scene)
    finally:
        for server in scene.servers:  # an answer that nobody expected ends the act in the middle
            server.stop()
    after = set(_list_digests(store.folder, with_side_files=True).values())
    finished = f"incoming/{store.upload}" if (cell.part, cell.action) == ("upload in flight", "serve") else ""
    for name, digest in before.items():
        seen.expect(digest in after or name == finished, f"removed {name}")
    for log in folder.glob("log*"):
        text = log.read_text(errors="replace")
        seen.expect("Traceback" not in text, f"traceback: {text.strip().splitlines()[-1:]}")
    return seen


@dataclass(frozen=True, slots=True)
class Scene:
    """Where an action is done, and where what is seen is written down."""

    stock: Stock
    cell: Cell
    store: Store
    folder: Path
    seen: Seen
    servers: list[Server] = field(default_factory=list)

    def serve(self, log: str, workers: int = 0) -> Server:
        """Start a server; it is stopped at the end, whatever happens."""
        self.servers.append(Server(self.store.folder, self.folder / log, workers))
        return self.servers[-1]

    @property
    def victim(self) -> str:
        """The recording that is damaged."""
        return self.store.trashed if self.cell.part == "trash" else self.store.recording

    @property
    def damaged_name(self) -> str:
        """How verify and backup call what is damaged."""
        if self.cell.part in ("raw file", "trash"):
            return f"recordings/{self.victim}"
        return {"result": "results.json", "report": "report.en.html"}.get(self.cell.part, "")

    def run(self, *arguments: object) -> Ended:
        """Run a command; none may end in a traceback."""
        ended = run_command(*arguments)
        self.seen.expect("Traceback" not in ended.output, f"traceback of {arguments[0]}")
        return ended

    def ask(self, server: Server, method: str, path: str, **rest: Any) -> httpx2.Response:
        """Ask the server; a 500 is never right, and a refusal has a code."""
        answer = server.client.request(method, path, **rest)
        code = CODE.search(answer.text) if answer.status_code >= 400 else None
        self.seen.expect(answer.status_code != 500, f"500 at {_shorten(path)}: {code[0] if code else ''}")
        self.seen.expect(answer.status_code < 400 or code, f"no code at {_shorten(path)}")
        return answer


# The damage


def _inflict(stock: Stock, cell: Cell, store: Store) -> None:
    if cell.part == "inspection":
        _damage_inspection(stock, cell.damage, store)
    elif cell.part == "stranger's files":
        for name in _STRANGERS:
            path = store.folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(f"a stranger's {name}")
    else:
        path, theirs = _find_path(cell.part, store), _find_path(cell.part, stock.foreign)
        _damage_file(cell, path, stock.yesterday / path.relative_to(store.folder), theirs)


def _find_path(part: Part, store: Store) -> Path:
    places: dict[Part, Callable[[], Path]] = {
        "database": lambda: store.database,
        "raw file": lambda: store.raw(store.recording),
        "side file": lambda: store.side(store.recording),
        "result": lambda: store.result("results.json"),
        "report": lambda: store.result("report.en.html"),
        "trash": lambda: store.raw(store.trashed),
        "upload in flight": store.incoming,
    }
    return places[part]()


def _damage_file(cell: Cell, path: Path, older: Path, foreign: Path) -> None:
    if cell.damage == "missing":
        path.unlink()
    elif cell.damage == "emptied":
        path.write_bytes(b"")
    elif cell.damage == "older":
        shutil.copyfile(older, path)
    elif cell.damage == "foreign":
        shutil.copyfile(foreign, path)
    else:
        content = bytearray(path.read_bytes())
        place = _find_byte(cell.part, path, len(content))
        content[place] ^= 0xFF if cell.part == "database" else 0x01
        path.write_bytes(content)


def _find_byte(part: Part, path: Path, size_bytes: int) -> int:
    """Choose the byte that is hardest to miss wrongly."""
    if part == "database":
        with sqlite3.connect(path) as connection:
            size, root = (connection.execute(question).fetchone()[0] for question in (PAGE_SIZE, ROOT_PAGE))
        connection.close()
        return int(size) * (int(root) - 1)  # says of which kind the first page of the recordings is
    return size_bytes // 2


PAGE_SIZE = "PRAGMA page_size"
ROOT_PAGE = "SELECT rootpage FROM sqlite_master WHERE type = 'table' AND name = 'recordings'"


def _damage_inspection(stock: Stock, damage: Damage, store: Store) -> None:
    """Damage the value of the row: an inspection has no file."""
    kept = str(_read_inspection(store, store.recording))
    values: dict[Damage, str | None] = {
        "missing": None,
        "emptied": "",
        "one byte altered": "z" + kept[1:],  # JSON no more; another digit would be another row
        "foreign": _read_inspection(stock.foreign, stock.foreign.recording),
    }
    with sqlite3.connect(store.database) as connection:
        change = "UPDATE recordings SET inspection = ? WHERE id = ?"
        connection.execute(change, (values[damage], store.recording))
    connection.close()


def _read_inspection(store: Store, recording_id: str) -> str | None:
    connection = sqlite3.connect(store.database)
    asked = connection.execute("SELECT inspection FROM recordings WHERE id = ?", (recording_id,))
    found: str | None = asked.fetchone()[0]
    connection.close()
    return found


# The actions


def _start(scene: Scene) -> None:
    server = _open_server(scene)
    if server is None:
        return
    scene.seen.expect(scene.cell.part != "database", "started with a database that is not the folder's")
    server.stop()
    scene.seen.word = "starts"
    if (scene.store.folder / "quarantine").is_dir():
        number = sum(path.is_file() for path in (scene.store.folder / "quarantine").rglob("*"))
        scene.seen.detail = f"{number} in quarantine"


def _serve(scene: Scene) -> None:
    server = _open_server(scene)
    if server is None:
        return
    problems = _ask_everything(scene, server)
    if scene.cell.part in ("raw file", "trash"):
        _look_at_raw(scene, server)
    if scene.cell.part in ("result", "report"):
        _look_at_page(scene, server)
    if scene.cell.part == "upload in flight":
        problems += _go_on_with_upload(scene, server)
    server.stop()
    scene.seen.word = "problem answers" if problems else "good"
    if scene.cell.limit and not problems:
        scene.seen.word = "not noticed"
    scene.seen.detail = ", ".join(sorted(set(problems)))


def _ask_everything(scene: Scene, server: Server) -> list[str]:
    """Return the codes of the problem answers; what is answered with 200 is as it was before the damage."""
    problems = []
    for path in _list_addresses(scene.store):
        answer = scene.ask(server, "GET", path)
        if answer.status_code >= 400:
            found = CODE.search(answer.text)
            problems.append(found[0] if found else str(answer.status_code))
        elif path in scene.stock.answers and not scene.cell.limit:
            same = _hash(answer.content) == scene.stock.answers[path]
            scene.seen.expect(same or _may_differ(scene.cell, path), f"damaged as 200: {_shorten(path)}")
    return problems


def _look_at_raw(scene: Scene, server: Server) -> None:
    """The row stays; what reads the bytes is refused."""
    if scene.cell.part == "trash":
        scene.ask(server, "POST", f"/api/v1/recordings/{scene.victim}/restore")
    row = scene.ask(server, "GET", f"/api/v1/recordings/{scene.victim}")
    scene.seen.expect(row.status_code == 200, "the row is gone")
    read = scene.ask(server, "GET", f"/api/v1/recordings/{scene.victim}/inspection?rate_hz=30")
    scene.seen.expect(read.status_code >= 400, "damaged raw bytes were read as good")


def _look_at_page(scene: Scene, server: Server) -> None:
    """A script gets a problem; a browser gets a page that tells it and offers to analyse again."""
    name = {"result": "results.json", "report": "report.html"}[scene.cell.part]
    address = f"/api/v1/analyses/{scene.store.analysis}/{name}"
    read = scene.ask(server, "GET", address)
    scene.seen.expect(read.status_code >= 400, f"damaged {name} as {read.status_code}")
    page = scene.ask(server, "GET", address, headers={"Accept": "text/html"}).text
    if scene.cell.part == "result":  # the page of the analysis reads the results, too
        page += scene.ask(server, "GET", f"/analyses/{scene.store.analysis}").text
    scene.seen.expect(CODE.search(page), "the page does not tell the damage")
    scene.seen.expect("/retry" in page, "the page does not offer to analyse again")


def _go_on_with_upload(scene: Scene, server: Server) -> list[str]:
    """Send the rest; what then counts as stored has to be what was sent."""
    sent, address = scene.store.sent, f"/api/v1/uploads/{scene.store.upload}"
    view = scene.ask(server, "GET", address)
    if view.status_code != 200:
        return [view.json()["code"]]
    offset = view.json()["offset_bytes"]
    head = TUS | {"Upload-Offset": str(offset)}
    answer = scene.ask(server, "PATCH", address, headers=head, content=sent[offset:])
    if answer.status_code >= 400:
        return [answer.json()["code"]]
    known = {row["sha256"] for row in server.send("GET", "/recordings")["items"]}
    if not scene.cell.limit:
        scene.seen.expect(_hash(sent) in known, "other bytes than were sent were stored as the recording")
    return []


def _analyse_again(scene: Scene) -> None:
    server, seen = _open_server(scene, workers=1), scene.seen
    if server is None:
        return
    if scene.cell.part == "trash":
        scene.ask(server, "POST", f"/api/v1/recordings/{scene.victim}/restore")
    if scene.cell.part in ("result", "report"):
        asked = scene.ask(server, "POST", f"/api/v1/analyses/{scene.store.analysis}/retry")
    else:
        wish = {"recording_ids": [scene.victim], "again": True}
        asked = scene.ask(server, "POST", "/api/v1/analyses", json=wish)
    if asked.status_code >= 400:
        seen.word, seen.detail = "refused", asked.json()["code"]
    else:
        view = server.wait_for_end(asked.json()["id"])
        good = view["state"] == "succeeded"
        seen.word, seen.detail = ("succeeds", "") if good else ("fails", view["problem"]["code"])
        seen.expect(good or scene.cell.part in ("raw file", "trash"), f"analysing again: {seen.detail}")
        for name in ("results.json", "report.html") if good else ():
            made = scene.ask(server, "GET", f"/api/v1/analyses/{view['id']}/{name}")
            first = scene.stock.answers[f"/api/v1/analyses/{scene.store.analysis}/{name}"]
            same = scene.cell.part not in ("result", "report") or _hash(made.content) == first
            seen.expect(made.status_code == 200 and same, f"{name} was not made again: {made.status_code}")
    if scene.cell.part in ("raw file", "trash"):
        seen.expect(seen.word != "succeeds", "damaged raw bytes were analysed")
    server.stop()


def _back_up(scene: Scene) -> None:
    made = scene.run("backup", scene.folder / "backup.zip", "--data", scene.store.folder)
    exists = (scene.folder / "backup.zip").exists()
    words = {0: "whole", 1: "made, names the damage"}
    scene.seen.word = words.get(made.exit_code, "refused") if exists else "refused"
    scene.seen.detail = _tell(made)
    if scene.cell.part in PROMISED:
        scene.seen.expect(exists and made.exit_code == 1, f"backup of a damaged store: exit {made.exit_code}")
        scene.seen.expect(scene.damaged_name in made.output, f"backup does not name {scene.damaged_name}")
    elif scene.cell.part == "database":
        scene.seen.expect(made.exit_code, "the backup of a folder without its rows is called whole")
    else:
        scene.seen.expect(exists, "no backup was made")


def _verify(scene: Scene) -> None:
    verified = scene.run("verify", "--data", scene.store.folder)
    scene.seen.word = {0: "good", 1: "names it"}.get(verified.exit_code, "refused")
    scene.seen.detail = _tell(verified)
    if scene.cell.part in PROMISED:
        scene.seen.expect(scene.damaged_name in verified.output, f"verify does not name {scene.damaged_name}")
    if scene.cell.part in ("side file", "database", *PROMISED):
        scene.seen.expect(verified.exit_code != 0, "verify calls it good")
    if scene.cell.part in ("raw file", "trash"):
        doctor = scene.run("doctor", "--data", scene.store.folder)
        scene.seen.expect(_read_lines(doctor) - scene.stock.doctor, "doctor does not name it")


def _restore(scene: Scene) -> None:
    """Restore the damaged store's own backup elsewhere; over a lost database, the last good backup."""
    into, source = scene.folder / "restored", scene.folder / "backup.zip"
    if scene.cell.part == "database":
        into, source = scene.store.folder, scene.stock.backup
    elif run_command("backup", source, "--data", scene.store.folder).exit_code not in (0, 1):
        scene.seen.word = "no backup to restore"
        return
    restored = scene.run("restore", source, "--data", into)
    words = {0: "whole", 4: "restored, names the damage"}
    scene.seen.word, scene.seen.detail = words.get(restored.exit_code, "refused"), _tell(restored)
    if restored.exit_code not in (0, 4):
        scene.seen.expect(scene.cell.part == "database", f"restore: exit {restored.exit_code}")
        return
    found = _hash_recordings(into)
    lost = scene.victim if scene.cell.part in ("raw file", "trash") else ""
    for recording_id, digest in scene.store.recordings.items():
        scene.seen.expect(recording_id == lost or digest in found, f"not restored: {recording_id}")
    if scene.cell.part in PROMISED:
        scene.seen.expect(restored.exit_code == 4, "restore calls it whole")


def _recover(scene: Scene) -> None:
    recovered, seen = scene.run("recover", "--data", scene.store.folder), scene.seen
    words = {0: "recovered", 4: "recovered, names the rest"}
    seen.word, seen.detail = words.get(recovered.exit_code, "refused"), _tell(recovered)
    if scene.cell.part != "database":
        seen.expect(recovered.exit_code in (0, 4), f"recover: exit {recovered.exit_code}")
        return
    server = scene.serve("log-after")
    if not server.runs:
        seen.expect(recovered.exit_code not in (0, 4), "no start after a recovery")
        return
    rows = [*_list_rows(server, trashed=False), *_list_rows(server, trashed=True)]
    known = {row["id"]: row["note"] for row in rows}
    seen.detail = f"{len(set(known) & set(scene.store.recordings))} of {len(scene.store.recordings)} back"
    seen.expect(set(scene.store.recordings) <= set(known), f"not recovered: {seen.detail}")
    trashed = {row["id"] for row in _list_rows(server, trashed=True)}
    seen.expect(scene.store.trashed in trashed or scene.cell.damage == "older", "trashed came back as stored")
    seen.expect(
        scene.cell.damage == "older" or known.get(scene.store.recording), "the note did not come back"
    )
    server.stop()


_ACTS: Mapping[Action, Callable[[Scene], None]] = {
    "start": _start,
    "serve": _serve,
    "analyse again": _analyse_again,
    "backup": _back_up,
    "verify": _verify,
    "restore": _restore,
    "recover": _recover,
}


def _open_server(scene: Scene, workers: int = 0) -> Server | None:
    """Start; None where the start was refused, which has to be by name and only for a database's sake."""
    server = scene.serve("log", workers)
    if server.runs:
        return server
    ended = server.stop()
    scene.seen.word, scene.seen.detail = "start refused", _tell(ended)
    scene.seen.expect(ended.code, f"ended without a code, exit {ended.exit_code}")
    scene.seen.expect(scene.cell.part == "database", "one damaged file kept the server from starting")
    return None


def _list_addresses(store: Store) -> list[str]:
    """Give what is asked while the server runs; the first ones are pages and lists."""
    of_it = f"/api/v1/analyses/{store.analysis}"
    files = ("results.json", "report.html", "report.pdf", "elevation.parquet", "answer.txt", "fhir.json")
    made = ("bundle.zip", "tasks.csv", "settings.yaml", "elevation.csv.gz")
    return [
        *("/", "/trash", "/library/summary.csv", f"/analyses/{store.analysis}"),
        f"/analyses/{store.analysis}/curve?from_s=0&to_s=60",
        *(f"{of_it}/{name}" for name in (*files, *made)),
        f"/api/v1/recordings/{store.recording}/inspection",
        f"/api/v1/recordings/{store.recording}",
        of_it,
    ]


def _may_differ(cell: Cell, path: str) -> bool:
    """Return whether other bytes may be right: rows of an older database are older."""
    return cell.part == "database" or path.rpartition("/")[2].startswith(("rec_", "an_"))


def _list_rows(server: Server, *, trashed: bool) -> list[dict[str, Any]]:
    asked = {"limit": 100} | ({"trashed": True} if trashed else {})
    found: list[dict[str, Any]] = server.send("GET", "/recordings", params=asked)["items"]
    return found


def _keeps_side_files(cell: Cell) -> bool:
    """Side files are written anew from their rows; not from the rows of a database that was lost."""
    return cell.part == "database"


def _list_digests(folder: Path, *, with_side_files: bool) -> dict[str, str]:
    """Hash what nobody but a person may remove."""
    found = {}
    for path in (path for path in folder.rglob("*") if path.is_file()):
        name = path.relative_to(folder).as_posix()
        is_side = re.fullmatch(r"recordings/rec_\w+\.json", name)
        if not name.startswith(VANISHING) and (with_side_files or not is_side):
            found[name] = _hash(path.read_bytes())
    return found


def _hash_recordings(folder: Path) -> set[str]:
    """Hash every recording."""
    storage = open_storage(Settings(data_dir=folder))
    return {storage.hash(f"recordings/{name}")[0] for name in storage.find_recordings()}


def _read_lines(doctor: Ended) -> frozenset[str]:
    """Give what doctor tells, without its numbers (free space changes)."""
    return frozenset(re.sub(r"\d+", "#", line) for line in doctor.output.splitlines())


def _tell(ended: Ended) -> str:
    return f"{ended.code} exit {ended.exit_code}".strip() if ended.exit_code else ""


def _shorten(path: str) -> str:
    return re.sub(r"(rec|an|up)_[0-9a-f]+", r"\1", path)


def _hash(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
