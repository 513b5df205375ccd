"""Provenance of results for programs: an RO-Crate (Process Run), ``ro-crate-metadata.json``.

Each analysis is an action: Acromion (version, revision) made these files from a recording with these
settings, or failed. Every recording is described with the result of its row in ``summary.csv``, including
failures and copies. It is identified by the SHA-256 of its bytes (RFC 6920), or by its row
if its bytes are not known. Its file name, which may contain a person's name, appears only if a folder has it.
Format: RO-Crate 1.1, Process Run Crate 0.5.
"""

import base64
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import date, datetime, timedelta
from typing import Any
from urllib.parse import quote

from acromion.app.report.figures import Results
from acromion.app.version import software_version, source_revision
from acromion.fusion.errors import DOUBLE_RECORDING

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

    A failed recording has its ``code`` instead, and the ``sha256`` of its bytes, "" if it is not known.
    ``double_of``: the row of the same recording, which is analysed instead; 0 for none.
    """

    files: Mapping[str, int] = field(default_factory=dict)
    results: Results | None = None
    code: str | None = None
    sha256: str = ""
    double_of: int = 0


def encode_crate(
    every: Sequence[Made],
    others: Mapping[str, int],
    ended_at: str = "",
    inputs: Mapping[str, int] | None = None,
) -> bytes:
    """Return the crate: the files of every recording, and ``others`` that belong to all of them.

    ``inputs``: files with the settings, the list of participants and the diaries of all analyses.

    ``ended_at``: time of the last file; "" omits it, so that the same analysis gives the same bytes.
    """
    recordings = [_describe_recording(rank, made) for rank, made in enumerate(every, 1)]
    actions = [
        _describe_action(rank, made, recording, ended_at, inputs or {})
        for rank, (made, recording) in enumerate(zip(every, recordings, strict=True), 1)
        if made.code != DOUBLE_RECORDING
    ]
    named: dict[str, Entity] = {}
    for one in recordings:  # one entity for several rows with the same bytes
        first = named.setdefault(one["@id"], one)
        if first is not one:
            first["description"] += f" {one['description']}"
    sizes = [
        *others.items(),
        *(inputs or {}).items(),
        *(item for made in every for item in made.files.items()),
    ]
    files = [_describe_file(path, size_bytes) for path, size_bytes in sizes]
    settings = {one["@id"]: one for made in every for one in _describe_settings(made)}
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
            "mentions": [_refer(one) for one in (*actions, *named.values())],
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
            "softwareVersion": f"{software_version()} ({source_revision()})",
            "description": "Turns a recording of an upper-arm motion sensor into a report.",
        },
        *actions,
        *named.values(),
        *settings.values(),
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


def _describe_action(
    rank: int, made: Made, recording: Entity, ended_at: str, inputs: Mapping[str, int]
) -> Entity:
    objects = [
        *map(_refer, (recording, *_describe_settings(made))),
        *({"@id": quote(path)} for path in inputs),
    ]
    action: Entity = {
        "@id": f"#analysis-{rank}",
        "@type": "CreateAction",
        "name": f"Analysis of the recording in row {rank} of summary.csv",
        "instrument": {"@id": _SOFTWARE},
        **({"endTime": ended_at} if ended_at else {}),
        "object": objects,
    }
    if made.code:
        return action | {"actionStatus": f"{_STATUS}/FailedActionStatus", "error": made.code}
    return action | {
        "actionStatus": f"{_STATUS}/CompletedActionStatus",
        "result": [{"@id": quote(path)} for path in made.files],
    }


def _describe_recording(rank: int, made: Made) -> Entity:
    """Describe a recording by its bytes, and the result of its row."""
    facts = (made.results or {}).get("recording", {})
    sha256 = facts.get("sha256") or made.sha256
    device = f" ({facts['device']})" if facts else ""
    state = (
        f"the recording of row {made.double_of} again, not analysed"
        if made.double_of
        else f"failed with {made.code}"
        if made.code
        else "analysed"
    )
    described = {
        "@id": f"#recording-{rank}",
        "@type": "CreativeWork",
        "name": f"Recording of a motion sensor{device}",
        "description": f"Row {rank} of summary.csv: {state}.",
    }
    if not sha256:
        return described
    digest = base64.urlsafe_b64encode(bytes.fromhex(sha256)).decode().rstrip("=")
    return described | {"@id": f"ni:///sha-256;{digest}", "identifier": sha256}


def _describe_settings(made: Made) -> list[Entity]:
    """Describe the settings of an analysis."""
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
    return [
        {
            "@id": f"#{name}-" + "".join(sign if sign.isalnum() else "-" for sign in value),
            "@type": "PropertyValue",
            "name": name,
            "value": value,
        }
        for name, value in asked.items()
        if value
    ]


def _describe_file(path: str, size_bytes: int) -> Entity:
    kind = _MEDIA_TYPES.get(path.rpartition(".")[2])
    described = {"@id": quote(path), "@type": "File", "name": path, "contentSize": str(size_bytes)}
    return described | ({"encodingFormat": kind} if kind else {})
