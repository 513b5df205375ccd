"""Anchors: the head of the trail, written down where whoever alters the database does not reach.

The administrator names a file or an ``https://`` address (ACROMION_TRAIL_ANCHOR). A line goes there at each
start and stop and once a day. With the file at hand the trail is proved to its end; without one, an end that
was cut off cannot be seen.
"""

import base64
import hashlib
import json
import logging
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from app.delivery import Message, send_message
from app.errors import NoHead
from app.jobs.trail import Head, read_head
from app.organisation import OWN_ORGANISATION
from app.settings import Settings
from app.storage.permissions import create_file

logger = logging.getLogger(__name__)


def is_address(anchor: str) -> bool:
    """Tell an address from the path of a file."""
    return anchor.startswith("https://")


def find_organisation(settings: Settings) -> str:
    """Give the organisation whose settings these are."""
    place = settings.data_dir
    return place.name if place.parent.name == "organisations" else OWN_ORGANISATION


async def anchor_trail(settings: Settings, reader: Any) -> bool:
    """Write the head down; False where no place is named, or it does not take it (that is logged)."""
    anchor, head = settings.trail_anchor, read_head(reader)
    if not anchor or not head.seq:
        return False
    line = {"organisation": find_organisation(settings), "at": head.at, "seq": head.seq, "hash": head.hash}
    if is_address(anchor):
        body = json.dumps({"type": "trail.head", "timestamp": head.at, "data": line})
        secret = "whsec_" + base64.b64encode(hashlib.sha256(anchor.encode()).digest()).decode()
        message = Message(f"msg_{head.hash[:16]}", anchor, secret, body)
        is_taken = await send_message(message, allow_private=True)
        if not is_taken:  # the path of an address may be a secret
            logger.warning("the head of the trail is not written to %s", urlsplit(anchor).hostname)
        return is_taken
    try:
        _append(Path(anchor), json.dumps(line).encode() + b"\n")
    except OSError as error:
        logger.warning("the head of the trail is not written to %s: %s", anchor, error.strerror)
        return False
    return True


def _append(path: Path, line: bytes) -> None:
    """Add a line, durably; the first makes the file, for its owner alone."""
    if not path.exists():
        create_file(path).close()
    with path.open("ab") as file:
        file.write(line)
        file.flush()
        os.fsync(file.fileno())


def read_anchors(path: Path, organisation: str) -> tuple[Head, ...]:
    """Read the heads of an organisation from a file; lines that are none are left out.

    Raises
    ------
    NoHead
        The file cannot be read, or holds no head of the organisation.
    """
    try:
        lines = path.read_text("utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    heads = []
    for line in lines:
        try:
            found = json.loads(line)
            if found["organisation"] == organisation:
                heads.append(Head(str(found["at"]), int(found["seq"]), str(found["hash"])))
        except (ValueError, KeyError, TypeError):
            continue
    if not heads:
        raise NoHead(file=str(path), organisation=organisation)
    return tuple(heads)


def find_anchors(settings: Settings, file: Path | None = None) -> Sequence[Head] | None:
    """Give the heads written down in a file, else in that of the settings; None where no file is named.

    Raises
    ------
    NoHead
    """
    named = settings.trail_anchor
    place = file or (Path(named) if named and not is_address(named) else None)
    return None if place is None else read_anchors(place, find_organisation(settings))
