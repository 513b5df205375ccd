"""Provenance of results for programs: an RO-Crate (Process Run), ``ro-crate-metadata.json``.

Each recording is an action: Acromion (version, revision) made these files from a recording with these
settings. A recording is identified by the SHA-256 of its bytes (RFC 6920) and its row in ``summary.csv``. Its
file name, which may contain a person's name, appears only if a folder has it. Format: RO-Crate 1.1, Process
Run Crate 0.5.
"""

import base64
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import date, datetime, timedelta
from typing import Any
from urllib.parse import quote

from app.report.figures import Results
from app.version import software_revision, software_version

CRATE = "ro-crate-metadata.json"
PROFILE = "https://w3id.org/ro/wfrun/process/0.5"
_SPECIFICATION = "https://w3id.org/ro/crate/1.1"
_SOFTWARE = "#acromion"
_STATUS = "http://schema.org"
_NO_DATE = date(1970, 1, 1)
"""Date of a recording without a clock, as in the PDF."""

_MEDIA_TYPES = {
    "csv": "text/csv",
    "html": "text/html",
    "json": "application/json",
    "md": "text/markdown",
    "parquet": "application/vnd.apache.parquet",
    "pdf": "application/pdf",
    "txt": "text/plain",
    "xlsx": "application/vnd.openxmlformats-officedocument.spreadsheetml.sheet",
    "yaml": "application/yaml",
}
Entity = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Made:
    """The files made from one recording (path in the crate: size in bytes), and its results.

    A failed recording has its ``code`` instead.
    """

    files: Mapping[str, int] = field(default_factory=dict)
    results: Results | None = None
    code: str | None = None


def encode_crate(every: Sequence[Made], others: Mapping[str, int], ended_at: str = "") -> bytes:
    """Return the crate: the files of every recording, and ``others`` that belong to all of them.

    ``ended_at``: time of the last file; "" omits it, so that the same analysis gives the same bytes.
    """
    actions = [_describe_action(rank, made, ended_at) for rank, made in enumerate(every, 1)]
    sizes = [*others.items(), *(item for made in every for item in made.files.items())]
    files = [_describe_file(path, size_bytes) for path, size_bytes in sizes]
    objects = {one["@id"]: one for made in every for one in _describe_objects(made)}
    graph = [
        {
            "@id": CRATE,
            "@type": "CreativeWork",
            "about": {"@id": "./"},
            "conformsTo": {"@id": _SPECIFICATION},
        },
        {
            "@id": "./",
            "@type": "Dataset",
            "conformsTo": {"@id": PROFILE},
            "name": "Upper-arm elevation",
            "description": "Exposure of the upper arm to elevation, from recordings of a motion sensor.",
            "datePublished": max(map(_find_date, every), default=_NO_DATE).isoformat(),
            "license": {"@id": "#rights"},
            "hasPart": [_refer(file) for file in files],
            "mentions": [_refer(action) for action in actions],
        },
        {"@id": PROFILE, "@type": "CreativeWork", "name": "Process Run Crate", "version": "0.5"},
        {
            "@id": "#rights",
            "@type": "CreativeWork",
            "name": "Not stated",
            "description": "Health data. Acromion states no licence: ask the owner of the recordings.",
        },
        {
            "@id": _SOFTWARE,
            "@type": "SoftwareApplication",
            "name": "Acromion",
            "softwareVersion": f"{software_version()} ({software_revision()})",
            "description": "Turns a recording of an upper-arm motion sensor into a report.",
        },
        *actions,
        *objects.values(),
        *files,
    ]
    crate = {"@context": f"{_SPECIFICATION}/context", "@graph": graph}
    return (json.dumps(crate, ensure_ascii=False, indent=1) + "\n").encode()


def _refer(entity: Entity) -> Entity:
    return {"@id": entity["@id"]}


def _find_date(made: Made) -> date:
    results = made.results or {}
    start = results.get("recording", {}).get("start")
    if not start:
        return _NO_DATE
    return (datetime.fromisoformat(start) + timedelta(seconds=results["time"]["recorded_s"])).date()


def _describe_action(rank: int, made: Made, ended_at: str) -> Entity:
    action: Entity = {
        "@id": f"#analysis-{rank}",
        "@type": "CreateAction",
        "name": f"Analysis of the recording in row {rank} of summary.csv",
        "instrument": {"@id": _SOFTWARE},
        **({"endTime": ended_at} if ended_at else {}),
    }
    if made.code:
        return action | {"actionStatus": f"{_STATUS}/FailedActionStatus", "error": made.code}
    return action | {
        "actionStatus": f"{_STATUS}/CompletedActionStatus",
        "object": [_refer(one) for one in _describe_objects(made)],
        "result": [{"@id": quote(path)} for path in made.files],
    }


def _describe_objects(made: Made) -> list[Entity]:
    """Describe the input of an analysis: the bytes of the recording, and the settings."""
    if made.results is None or "recording" not in made.results:
        return []
    recording, method = made.results["recording"], made.results["method"]
    calibration = made.results["calibration"] or {}
    asked = {
        "side": recording["side"],
        "method": f"{method['name']} {method['version']}" if method else None,
        "pose": calibration.get("pose"),
        "axis": calibration.get("axis"),
    }
    settings = [
        {
            "@id": f"#{name}-" + "".join(sign if sign.isalnum() else "-" for sign in value),
            "@type": "PropertyValue",
            "name": name,
            "value": value,
        }
        for name, value in asked.items()
        if value
    ]
    digest = base64.urlsafe_b64encode(bytes.fromhex(recording["sha256"])).decode().rstrip("=")
    described = {
        "@id": f"ni:///sha-256;{digest}",
        "@type": "CreativeWork",
        "name": f"Recording of a motion sensor ({recording['device']})",
        "identifier": recording["sha256"],
    }
    return [described, *settings]


def _describe_file(path: str, size_bytes: int) -> Entity:
    kind = _MEDIA_TYPES.get(path.rpartition(".")[2])
    described = {"@id": quote(path), "@type": "File", "name": path, "contentSize": str(size_bytes)}
    return described | ({"encodingFormat": kind} if kind else {})
