"""Analyse the recordings of a folder on a server and write the tables: python batch.py FOLDER ADDRESS.

ACROMION_SECRET is the content of acromion-data/secret or, with accounts, a token. Each file is named after
its subject code: S01.gt3x. A second call reuses what exists.
"""

import os
import sys
import time
from pathlib import Path

import httpx2


def send(api: httpx2.Client, path: Path) -> str:
    """Store a recording and return its id; bytes that were stored in the last 24 h are not stored again."""
    words = {"file_name": path.name, "subject": path.stem}
    with path.open("rb") as file:
        answer = api.post("/api/v1/recordings", content=file, params=words)
    return answer.raise_for_status().json()["id"]


folder, address = Path(sys.argv[1]), sys.argv[2]
secret = os.environ.get("ACROMION_SECRET", "").strip()
who = {"Authorization": f"Bearer {secret}"} if secret else {}
with httpx2.Client(base_url=address, headers=who, timeout=300) as api:
    items = [{"recording_id": send(api, path)} for path in sorted(folder.glob("*.gt3x"))]
    body = {"name": folder.name, "settings": {"pose_held": "start"}, "items": items}
    answer = api.post("/api/v1/batches", json=body)
    if answer.is_error:
        sys.exit(answer.json()["fix"])
    batch = answer.json()
    while not batch["is_over"]:
        time.sleep(2)
        batch = api.get(batch["links"]["self"]).raise_for_status().json()
    for name in ("summary_csv", "problems_csv"):
        table = api.get(batch["links"][name]).raise_for_status()
        (folder / name.replace("_", ".")).write_bytes(table.content)
    print(batch["counts"])
