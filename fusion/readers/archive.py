"""Unpack a packed file, and choose the recording in an archive: a file, a table, or a pair of tables."""

import gzip
import re
import zipfile
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import product
from pathlib import PurePath
from typing import IO, BinaryIO, Literal, cast

from acromion.fusion.conventions import is_sidecar
from acromion.fusion.errors import (
    EmptyFile,
    FusionError,
    NoGyroscope,
    NoPair,
    SeveralSensors,
    UnsafeArchive,
    UnusableTime,
)
from acromion.fusion.readers.source import (
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
from acromion.fusion.readers.tables.columns import find_own_axes, read_named_axis
from acromion.fusion.readers.tables.layout import (
    COLUMNS_OF_ONE,
    MIN_COLUMNS,
    TextLayout,
    decode_head,
    find_layout,
)
from acromion.fusion.readers.tables.rows import LONGEST_LIST, plan_table
from acromion.fusion.recording import ACC_UNITS_G, GYR_UNITS_DPS

PHYPHOX_FOLDER = "meta/"
OWN_FOLDERS = ("xl/", "word/")
OWN_ARCHIVES = ("log.bin", "info.txt", "activity.bin", "[Content_Types].xml", "mimetype")
"""Members of `.gt3x`, Office, OpenDocument and NumPy files, which are archives themselves."""
DEVICE_PARTS = ("log.bin", "info.txt")
TABLES = (".csv", ".txt", ".tsv")
UNCALIBRATED = re.compile(r"uncalibrated", re.IGNORECASE)
Kind = Literal["gyr", "total", "acc", "linear", "gravity", "other"]
ACCELERATIONS: tuple[Literal["total", "acc", "linear"], ...] = ("total", "acc", "linear")
PAIRED = ("gyr", *ACCELERATIONS)
SENSOR_WORDS: Mapping[Kind, re.Pattern[str]] = {
    "other": re.compile(r"magn|(?<![a-z])mag(?![a-z])", re.IGNORECASE),
    "gyr": re.compile(
        r"gyro(?:scope)?|(?<![a-z])gyr(?![a-z])|(?:angular|rotation)[ _]?(?:velocity|rate)", re.IGNORECASE
    ),
    "gravity": re.compile(r"gravity", re.IGNORECASE),
    "linear": re.compile(r"(?:linear|user)[ _]?accel(?:eration|erometer)?", re.IGNORECASE),
    "total": re.compile(r"total[ _]?accel(?:eration)?", re.IGNORECASE),
    "acc": re.compile(r"accel(?:eration|erometer)?|(?<![a-z])acc[el]?(?![a-z])", re.IGNORECASE),
}
"""Words for a sensor in the name of a table."""
PLACE_WORDS = re.compile(
    r"(?<![a-z])(left|right|phones?|watch|ear|wrist|chest|forearm|upperarm|waist|thigh|shin|head)(?![a-z])",
    re.IGNORECASE,
)
"""Words for a device or its place in the names of tables: of Sensor Logger (`WatchGyroscope`), and of the
public data sets HHAR (`Phones_accelerometer`), WISDM (`data_1600_gyro_watch`), FatigueSet (`ear_acc_left`)
and RealWorld (`Gyroscope_walking_upperarm`).
"""
SAMPLING_RATE = re.compile(r"[ _]?\d{1,6}(?:\.\d{1,6})?hz\b.*", re.IGNORECASE)
OWN_START = re.compile(
    r"(?<!\d)(?:20\d{2}[-_.]?\d{2}[-_.]?\d{2}[ _T.-]{0,3}\d{2}[-_.:h]?\d{2}[-_.:m]?\d{2}(?:[-_.]?\d{3,6})?"
    r"|1[4-9]\d{8}(?:\d{3}){0,3})(?!\d)"
)
"""The start time of each table in its name, as Polar Sensor Logger writes it, or since 1970: it may differ
by a second."""
WORDS = re.compile(r"[^\W_]+")
SERIAL = re.compile(r"(?=.*\d)[0-9a-f]{4,}|(?=(?:.*\d){4})\w+", re.IGNORECASE)
SEPARATORS = re.compile(r"[ _.-]+")


@dataclass(frozen=True, slots=True)
class ArchivedRecording:
    """A recording in an archive: one table, or the tables of a pair.

    ``beside``: tables of a sensor of another device that it does not use.
    """

    name: str
    table: str = ""
    pair: PairNames | None = None
    beside: tuple[str, ...] = ()

    @property
    def n_files(self) -> int:
        """How many members it takes."""
        return 1 if self.pair is None else 2 + bool(self.pair.gravity)


def find_recordings(tables: Mapping[str, str]) -> list[ArchivedRecording]:
    """Find the recordings among the tables of an archive, by their heads: text by name.

    Two tables are of one device if their names agree apart from the word for the sensor. If no two agree,
    the only angular rate may belong to each acceleration.
    """
    found = [ArchivedRecording(PurePath(name).stem, name) for name, head in tables.items() if _is_whole(head)]
    wholes = {one.table for one in found}
    sensors = _find_sensors({name: head for name, head in tables.items() if name not in wholes})
    groups: dict[str, dict[str, Kind]] = {}
    for name, kind in sensors.items():
        groups.setdefault(_name_device(name), {})[name] = kind
    pairs = {device: pair for device, group in groups.items() if (pair := _find_pair(group, device))}
    if not pairs:
        return [*found, *_find_loose_pairs(sensors)]
    alone = [group for device, group in groups.items() if device not in pairs]
    beside = tuple(name for group in alone for name, kind in group.items() if kind in PAIRED)
    return [*found, *(replace(pair, beside=beside) for pair in pairs.values())]


def _find_loose_pairs(sensors: Mapping[str, Kind]) -> list[ArchivedRecording]:
    """Return the only table of one sensor with each of the other that may be of the same device."""
    rates = [name for name, kind in sensors.items() if kind == "gyr"]
    kind = next((kind for kind in ACCELERATIONS if kind in sensors.values()), None)
    accelerations = [name for name, found in sensors.items() if found == kind]
    if 1 not in (len(rates), len(accelerations)):
        return []
    pairs = []
    for name, rate in product(accelerations, rates):
        others = tuple(other for other in (*accelerations, *rates) if other not in (name, rate))
        pair = _find_pair({one: found for one, found in sensors.items() if one not in others})
        if pair and not _are_apart(name, rate):
            called = PurePath(name if len(rates) == 1 else rate).stem
            pairs.append(replace(pair, name=called, beside=others))
    return pairs


def _find_sensors(tables: Mapping[str, str]) -> dict[str, Kind]:
    """Return the tables of one sensor, with its kind."""
    return {name: kind for name, head in tables.items() if (kind := _find_sensor(name, head))}


def _is_whole(head: str) -> bool:
    """Return whether a table holds both sensors."""
    layout = _find_layout(head)
    if layout is None or layout.header is None:
        return False
    try:
        plan_table(layout)
    except (SeveralSensors, UnusableTime):
        return True
    except FusionError:
        return False
    return True


def _find_layout(head: str, fewest: int = MIN_COLUMNS) -> TextLayout | None:
    """Understand the columns of a table; the order of its dates, if open, does not matter here."""
    with suppress(FusionError):
        return find_layout(head, "dmy", stated_time="", fewest=fewest)
    return None


def _find_sensor(name: str, head: str) -> Kind | None:
    """Return the sensor of a table: by its own name, by the names of its columns, or by their unit."""
    stem = PurePath(name).stem
    if UNCALIBRATED.search(stem):
        return None
    for kind, pattern in SENSOR_WORDS.items():
        if pattern.search(stem):
            return kind
    layout = _find_layout(head, COLUMNS_OF_ONE)
    columns = layout.columns if layout else ()
    axes = find_own_axes([one.name for one in columns])
    if axes is None:
        return None
    channels = {one.channel for one in columns} & {"acc", "gyr", "linear", "gravity"}
    units = {(read_named_axis(columns[k].name) or ("", None))[1] or columns[k].unit for k in axes}
    if not channels and units <= set(ACC_UNITS_G):
        return "acc"
    if not channels and units <= set(GYR_UNITS_DPS):
        return "gyr"
    return cast("Kind", channels.pop()) if len(channels) == 1 else None


def _name_device(name: str) -> str:
    """Return what the names of the tables of one device have in common."""
    path = PurePath(name)
    parts = [*path.parent.parts, OWN_START.sub("", SAMPLING_RATE.sub("", path.stem))]
    for pattern in SENSOR_WORDS.values():
        parts = [pattern.sub("", part) for part in parts]
    return " ".join(word for part in parts if (word := SEPARATORS.sub("_", part).strip("_")))


def _find_pair(sensors: Mapping[str, Kind], device: str = "") -> ArchivedRecording | None:
    """Return the one acceleration and the one angular rate of a device; None if there is not one of each.

    ``sensors``: kinds by the names of the tables.
    """
    names: dict[Kind, list[str]] = {}
    for name, kind in sensors.items():
        names.setdefault(kind, []).append(name)
    if len(names.get("gyr", ())) != 1:
        return None
    for kind in ACCELERATIONS:
        if len(names.get(kind, ())) == 1:
            (acceleration,), (angular_rate,) = names[kind], names["gyr"]
            gravity = "" if kind == "total" else names.get("gravity", [""])[0]
            is_named = any(letter.isalpha() for letter in device)
            return ArchivedRecording(
                device if is_named else PurePath(acceleration).stem,
                pair=PairNames(acceleration, angular_rate, gravity, kind),
            )
    return None


def _are_apart(one: str, other: str) -> bool:
    """Return whether each of two names has a word for its device or its place that the other lacks.

    Unless both names contain their sensor, only places on the body and serial numbers are such words.
    """
    stems = [PurePath(name).stem for name in (one, other)]
    is_named = all(any(pattern.search(stem) for pattern in SENSOR_WORDS.values()) for stem in stems)
    first, second = (
        {
            word.lower()
            for word in WORDS.findall(_name_device(name))
            if is_named or PLACE_WORDS.fullmatch(word) or SERIAL.fullmatch(word)
        }
        for name in (one, other)
    )
    return bool(first - second and second - first)


def _name_apart(found: Sequence[ArchivedRecording]) -> dict[str, ArchivedRecording]:
    """Return recordings by names that differ: those of one name are called by their folders too."""
    counts = Counter(one.name for one in found)
    named: dict[str, ArchivedRecording] = {}
    for one in found:
        path = PurePath(one.table or (one.pair.acceleration if one.pair else ""))
        name = one.name if counts[one.name] == 1 else str(path.with_suffix(""))
        name = name.replace(",", " ")
        name = name if name not in named else str(path).replace(",", " ")
        named[name] = replace(one, name=name)
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
        return open_member(archive, members[0], source, len(every) - 1)
    chosen = _choose_recording(archive, members, sensor, source)
    left_aside = len(every) - chosen.n_files
    if chosen.pair:
        return replace(
            source,
            pair=chosen.pair,
            left_aside=left_aside,
            beside=chosen.beside,
            is_chosen=chosen.name == sensor,
        )
    member = open_member(archive, chosen.table, source, left_aside)
    return replace(member, is_chosen=chosen.name == sensor)


def is_in_zip(source: Source) -> bool:
    """Return whether a file was unpacked from a zip."""
    if source.packed is None:
        return False
    source.packed.seek(0)
    return source.packed.read(len(ZIP_MAGIC)) == ZIP_MAGIC


def _choose_recording(
    archive: zipfile.ZipFile, members: Sequence[str], sensor: str, source: Source
) -> ArchivedRecording:
    tables = {name: _read_head(archive, name, source) for name in members if name.lower().endswith(TABLES)}
    found = find_recordings(tables)
    if any(name.lower().endswith((".gt3x", ".cwa")) for name in members):
        raise UnsafeArchive(reason="several", count=len(members))
    if not found:
        raise _explain_refusal(_find_sensors(tables), len(members))
    named = _name_apart(found)
    if sensor in named:
        return named[sensor]
    if len(found) == 1 and (not sensor or found[0].table):  # the table may hold that sensor
        return found[0]
    raise SeveralSensors(n=len(found), list=", ".join(named), **({"wanted": sensor} if sensor else {}))


def _explain_refusal(sensors: Mapping[str, Kind], n_members: int) -> FusionError:
    """Return the error for an archive without a recording, by the sensors of its tables."""
    paired = {name: kind for name, kind in sensors.items() if kind in PAIRED}
    if not paired:
        return UnsafeArchive(reason="several", count=n_members)
    if "gyr" not in paired.values():
        return NoGyroscope(cure="both in the zip")
    if set(paired.values()) == {"gyr"}:
        return NoPair(why="one sensor", list=", ".join(paired)[:LONGEST_LIST])
    devices = Counter((_name_device(name), kind) for name, kind in paired.items())
    why = "tables twice" if max(devices.values()) > 1 else "tables apart"
    return NoPair(why=why, list=", ".join(paired)[:LONGEST_LIST])


def _read_head(archive: zipfile.ZipFile, name: str, packed: Source) -> str:
    return decode_head(replace(packed, head=read_text(archive, name)))


def open_member(archive: zipfile.ZipFile, name: str, packed: Source, left_aside: int = 0) -> Source:
    """Return a member of an archive as a file that is unpacked as it is read."""
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
