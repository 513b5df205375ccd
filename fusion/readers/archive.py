"""Unpack a packed file, and choose the recording in an archive: a file, a table, or a pair of tables."""

import gzip
import re
import zipfile
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import PurePath
from typing import IO, BinaryIO, Literal, cast

from fusion.conventions import is_sidecar
from fusion.errors import EmptyFile, FusionError, SeveralSensors, UnsafeArchive
from fusion.readers.source import (
    EMPTY_ZIP_MAGIC,
    GZIP_MAGIC,
    HEAD_BYTES,
    ZIP_MAGIC,
    PairNames,
    Source,
    UnpackedFile,
    open_archive,
    read_text,
)
from fusion.readers.tables.columns import parse_column_name, read_axis
from fusion.readers.tables.layout import find_layout, split_fields
from fusion.readers.tables.rows import plan_table
from fusion.recording import ACC_UNITS_G, GYR_UNITS_DPS

PHYPHOX_FOLDER = "meta/"
OWN_FOLDERS = ("xl/", "word/")
OWN_ARCHIVES = ("log.bin", "info.txt", "activity.bin", "[Content_Types].xml", "mimetype")
"""Members of `.gt3x`, Office, OpenDocument and NumPy files, which are archives themselves."""
DEVICE_PARTS = ("log.bin", "info.txt")
TABLES = (".csv", ".txt", ".tsv")
UNCALIBRATED = re.compile(r"uncalibrated", re.IGNORECASE)
SENSOR_WORDS = {
    "other": re.compile(r"magn|(?<![a-z])mag(?![a-z])", re.IGNORECASE),
    "gyr": re.compile(r"gyro(?:scope)?|(?<![a-z])gyr(?![a-z])", re.IGNORECASE),
    "gravity": re.compile(r"gravity", re.IGNORECASE),
    "linear": re.compile(r"(?:linear|user)[ _]?accel(?:eration|erometer)?", re.IGNORECASE),
    "total": re.compile(r"total[ _]?accel(?:eration)?", re.IGNORECASE),
    "acc": re.compile(r"accel(?:eration|erometer)?|(?<![a-z])acc(?![a-z])", re.IGNORECASE),
}
"""Words for a sensor in the name of a table."""
PLACE_WORDS = re.compile(
    r"(?<![a-z])(left|right|gauche|droit|droite|phone|watch|wrist|chest|thigh|hip|head|back)(?![a-z])",
    re.IGNORECASE,
)
"""Words for a device or its place on the body, in the path of a table."""
SAMPLING_RATE = re.compile(r"[ _]?\d{1,6}(?:\.\d{1,6})?hz\b.*", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class ArchivedRecording:
    """A recording in an archive: one table, or the tables of a pair."""

    name: str
    table: str = ""
    pair: PairNames | None = None

    @property
    def n_files(self) -> int:
        """How many members it takes."""
        return 1 if self.pair is None else 2 + bool(self.pair.gravity)


def find_recordings(tables: Mapping[str, str]) -> list[ArchivedRecording]:
    """Find the recordings among the tables of an archive, by their heads: text by name."""
    found = [ArchivedRecording(PurePath(name).stem, name) for name, head in tables.items() if _is_whole(head)]
    wholes = {one.table for one in found}
    sensors = {
        name: kind
        for name, head in tables.items()
        if name not in wholes and (kind := _find_sensor(name, head))
    }
    if list(sensors.values()).count("gyr") == 1:
        pair = _find_pair(sensors)
        return [*found, *([pair] if pair else [])]
    groups: dict[str, dict[str, str]] = {}
    for name, kind in sensors.items():
        groups.setdefault(_name_device(name), {})[name] = kind
    pairs = (_find_pair(group, device) for device, group in groups.items())
    return [*found, *(pair for pair in pairs if pair)]


def _is_whole(head: str) -> bool:
    """Return whether a table holds both sensors."""
    try:
        layout = find_layout(head)
        if layout is not None and layout.header is not None:
            plan_table(layout)
            return True
    except SeveralSensors:
        return True
    except FusionError:
        return False
    return False


def _find_sensor(name: str, head: str) -> str:
    """Return the sensor of a table: by its own name, by the names of its columns, or by their unit."""
    stem = PurePath(name).stem
    if UNCALIBRATED.search(stem):
        return ""
    for kind, pattern in SENSOR_WORDS.items():
        if pattern.search(stem):
            return kind
    header = head.split("\n", 1)[0]
    fields = split_fields(header.strip("\ufeff\r"), max(",;\t", key=header.count))
    columns = [parse_column_name(field) for field in fields]
    axes = [axis for field in fields if (axis := read_axis(field))]
    if sorted(axis for axis, _ in axes) != ["x", "y", "z"] or "time" not in {one.channel for one in columns}:
        return ""
    channels = {one.channel for one in columns} & {"acc", "gyr", "linear", "gravity"}
    units = {unit for _, unit in axes}
    if not channels and units <= set(ACC_UNITS_G):
        return "acc"
    if not channels and units <= set(GYR_UNITS_DPS):
        return "gyr"
    return channels.pop() if len(channels) == 1 else ""


def _name_device(name: str) -> str:
    """Return what the names of the tables of one device have in common."""
    path = PurePath(name)
    stem = SAMPLING_RATE.sub("", path.stem)
    for pattern in SENSOR_WORDS.values():
        stem = pattern.sub("", stem)
    return " ".join(part for part in (str(path.parent).strip("."), stem.strip(" _-.")) if part)


def _find_pair(sensors: Mapping[str, str], device: str = "") -> ArchivedRecording | None:
    """Return the one acceleration and the one angular rate of a device; None if there is not one of each.

    ``sensors``: kinds by the names of the tables.
    """
    by_kind = {
        kind: [name for name, found in sensors.items() if found == kind]
        for kind in ("gyr", "total", "acc", "linear", "gravity")
    }
    if len(by_kind["gyr"]) != 1:
        return None
    gravity = next(iter(by_kind["gravity"]), "")
    kinds: tuple[Literal["total", "acc", "linear"], ...] = ("total", "acc", "linear")
    for kind in kinds:
        if len(by_kind[kind]) == 1:
            (acceleration,) = by_kind[kind]
            if _are_apart(acceleration, by_kind["gyr"][0]):
                return None
            pair = PairNames(acceleration, by_kind["gyr"][0], "" if kind == "total" else gravity, kind)
            return ArchivedRecording(device or PurePath(acceleration).stem, pair=pair)
    return None


def _are_apart(one: str, other: str) -> bool:
    """Return whether the paths of two tables name different devices or places on the body."""
    places = [{word.lower() for word in PLACE_WORDS.findall(name)} for name in (one, other)]
    return all(places) and not places[0] & places[1]


def _name_apart(found: Sequence[ArchivedRecording]) -> dict[str, ArchivedRecording]:
    """Return recordings by names that differ: those of one name are called by their folders too."""
    counts = Counter(one.name for one in found)
    named: dict[str, ArchivedRecording] = {}
    for one in found:
        path = PurePath(one.table or (one.pair.acceleration if one.pair else ""))
        name = one.name if counts[one.name] == 1 else str(path.with_suffix(""))
        name = name.replace(",", " ")
        named[name if name not in named else str(path).replace(",", " ")] = one
    return named


def unpack(source: Source, sensor: str = "") -> Source:
    """Return the one recording inside; the source itself if nothing is packed.

    ``sensor``: the name of one of several recordings.

    Raises DamagedFile: the archive is cut, corrupt or unsafe, packed twice, or holds several files.
    Raises SeveralSensors: it holds several recordings, and nobody said which one, or none has that name.
    """

    def open_gzip() -> IO[bytes]:
        source.file.seek(0)
        return cast("IO[bytes]", gzip.GzipFile(fileobj=source.file, mode="rb"))

    if source.head.startswith(GZIP_MAGIC):
        name = source.name[:-3] if source.extension == ".gz" else source.name
        return _open_unpacked(UnpackedFile(open_gzip, source.size_bytes, source.name), name, source)
    if not source.head.startswith(ZIP_MAGIC):
        return source
    archive = open_archive(source)
    names = archive.namelist()
    if any(name in OWN_ARCHIVES or name.startswith(OWN_FOLDERS) or name.endswith(".npy") for name in names):
        return source
    every = [member.filename for member in archive.infolist() if not member.is_dir()]
    members = [name for name in every if not is_sidecar(name) and not name.startswith(PHYPHOX_FOLDER)]
    if any(PurePath(name).name in DEVICE_PARTS for name in members):
        raise UnsafeArchive(reason="folder")
    if len(members) == 1:
        return _open_member(archive, members[0], source, len(every) - 1)
    chosen = _choose_recording(archive, members, sensor)
    left_aside = len(every) - chosen.n_files
    if chosen.pair:
        return replace(source, pair=chosen.pair, left_aside=left_aside)
    return _open_member(archive, chosen.table, source, left_aside)


def is_in_zip(source: Source) -> bool:
    """Return whether a file was unpacked from a zip."""
    if source.packed is None:
        return False
    source.packed.seek(0)
    return source.packed.read(len(ZIP_MAGIC)) == ZIP_MAGIC


def _choose_recording(archive: zipfile.ZipFile, members: Sequence[str], sensor: str) -> ArchivedRecording:
    tables = {name: _read_head(archive, name) for name in members if name.lower().endswith(TABLES)}
    found = find_recordings(tables)
    if not found or any(name.lower().endswith((".gt3x", ".cwa")) for name in members):
        raise UnsafeArchive(reason="several", count=len(members))
    if len(found) == 1:
        return found[0]
    named = _name_apart(found)
    if sensor in named:
        return named[sensor]
    raise SeveralSensors(n=len(found), list=", ".join(named), **({"wanted": sensor} if sensor else {}))


def _read_head(archive: zipfile.ZipFile, name: str) -> str:
    return read_text(archive, name).decode("utf-8", "replace")


def _open_member(archive: zipfile.ZipFile, name: str, packed: Source, left_aside: int) -> Source:
    file = UnpackedFile(lambda: archive.open(name), packed.size_bytes, name)
    return replace(_open_unpacked(file, PurePath(name).name, packed), left_aside=left_aside)


def _open_unpacked(file: UnpackedFile, name: str, packed: Source) -> Source:
    head = b""
    while len(head) < HEAD_BYTES and (piece := file.read(HEAD_BYTES - len(head))):
        head += piece
    if not head:
        raise EmptyFile
    if head.startswith((GZIP_MAGIC, ZIP_MAGIC, EMPTY_ZIP_MAGIC)):
        raise UnsafeArchive(reason="nested")
    return Source(cast("BinaryIO", file), name, packed.size_bytes, head, packed.file)
