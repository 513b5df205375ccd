"""Kill -9 while bytes are sealed: of an upload, and of what an earlier release stored in clear."""

import hashlib
import math
import random
import time
from pathlib import Path

import httpx2

from app.storage.open import open_storage
from app.storage.sealing import SealedStorage
from app.upkeep.verify import find_faults, find_kept
from tests.crash.harness import Site
from tests.ways_in.servers import wait_for

TUS = {"tus-resumable": "1.0.0"}
KILLS = 5


def test_an_upload_that_is_cut_again_and_again_loses_no_byte_that_counted(tmp_path: Path) -> None:
    site, dice = Site(tmp_path / "data", tmp_path / "log", workers=0), random.Random(1)
    content, counted, recording = dice.randbytes(12_000_000), 0, ""
    try:
        with httpx2.Client(base_url=site.address, timeout=None) as client:
            head = TUS | {"upload-length": str(len(content))}
            path = client.post("/api/v1/uploads", headers=head).headers["location"]
        for kill in range(KILLS + 1):
            found = read_offset(site, path)
            assert found >= counted
            counted = send(site, path, content, found, dice, cut=kill < KILLS)
            site.start()
        with httpx2.Client(base_url=site.address, timeout=None) as client:
            recording = client.head(path, headers=TUS).headers["acromion-recording"]
    finally:
        site.end()

    kept = open_storage(site.settings).hash(f"recordings/{recording}")
    assert kept[0] == hashlib.sha256(content).hexdigest()


def read_offset(site: Site, path: str) -> int:
    with httpx2.Client(base_url=site.address, timeout=None) as client:
        return int(client.head(path, headers=TUS).headers["upload-offset"])


def send(site: Site, path: str, content: bytes, begin: int, dice: random.Random, *, cut: bool) -> int:
    """Send pieces of odd sizes until all is there, or kill the server meanwhile; gives what counts."""
    kind = {"content-type": "application/offset+octet-stream"}
    pieces = dice.randrange(1, 4)
    with httpx2.Client(base_url=site.address, timeout=None) as client:
        while begin < len(content):
            end = min(len(content), begin + dice.randrange(1, 1_500_000))
            headers = TUS | kind | {"upload-offset": str(begin)}
            answer = client.patch(path, content=content[begin:end], headers=headers)
            begin = int(answer.headers["upload-offset"])
            pieces -= 1
            if cut and pieces == 0:
                site.kill("web", dice)
                return begin
    return begin


def test_what_was_in_clear_is_whole_however_often_its_sealing_is_cut(tmp_path: Path) -> None:
    site, dice, known = Site(tmp_path / "data", tmp_path / "log", workers=0), random.Random(2), {}
    try:
        with httpx2.Client(base_url=site.address, timeout=None) as client:
            for _ in range(60):
                content = dice.randbytes(400_000)
                made = client.post("/api/v1/recordings", content=content).json()
                known[made["id"]] = content
        site.end()
        storage = open_storage(site.settings)
        put_in_clear(storage, known)
        for _ in range(KILLS):
            site.start()
            time.sleep(dice.uniform(0.5, 2.0))
            site.kill("web", dice)
            assert not find_losses(site)
        site.start()
        wait_for(lambda: all(storage.is_sealed(f"recordings/{name}") for name in known), math.inf)
    finally:
        site.end()

    assert not find_losses(site)
    for name, content in known.items():
        assert storage.hash(f"recordings/{name}")[0] == hashlib.sha256(content).hexdigest()


def put_in_clear(storage: SealedStorage, known: dict[str, bytes]) -> None:
    """Leave the folder as a release before sealing left it: no key, and every byte in clear."""
    for name, content in known.items():
        side = storage.read_small(f"recordings/{name}.json")
        assert side is not None
        (storage.root / "recordings" / name).write_bytes(content)
        (storage.root / "recordings" / f"{name}.json").write_bytes(side)
        storage.keys.destroy(name)


def find_losses(site: Site) -> list[str]:
    faults = find_faults(site.settings, find_kept(site.settings))
    return [fault.name for fault in faults if fault.finding in ("missing", "damaged", "no_key")]
