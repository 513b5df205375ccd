"""A column profile: names that a person gives to the columns of a table whose header does not name them."""

import hashlib
import io
import json
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from statistics import median
from typing import Any, BinaryIO, get_args

from acromion.fusion.conventions import PoseHeld, check_choice
from acromion.fusion.errors import (
    FusionError,
    SeveralSensors,
    UnknownColumns,
    UnknownFormat,
    UnusableProfile,
    UnusableTime,
)
from acromion.fusion.readers.archive import open_member, unpack
from acromion.fusion.readers.source import open_archive, open_source
from acromion.fusion.readers.tables.columns import (
    TIME_UNITS_EXPONENT,
    Channel,
    Column,
    DateOrder,
    choose_vector,
    parse_column_name,
)
from acromion.fusion.readers.tables.layout import (
    ARRIVAL,
    COLUMNS_OF_ONE,
    DELIMITERS,
    MIN_COLUMNS,
    SNIFFED_LINES,
    Place,
    TextLayout,
    decode_head,
    find_layout,
    find_sensors,
    split_fields,
)
from acromion.fusion.readers.tables.rows import choose_sensor, explain_misfit, find_unnamed_time, plan_table
from acromion.fusion.recording import ACC_UNITS_G, GYR_UNITS_DPS

HEADER_REACH = 4
CHOICES: Mapping[str, Sequence[object]] = {
    "acceleration_unit": ("", *ACC_UNITS_G),
    "angular_rate_unit": ("", *GYR_UNITS_DPS),
    "time_unit": ("", *TIME_UNITS_EXPONENT),
    "date_order": (None, *get_args(DateOrder)),
}
"""Allowed values of a profile, by field."""


@dataclass(frozen=True, slots=True)
class ColumnProfile:
    """The meaning of each column of a table.

    ``acceleration``, ``angular_rate``: columns of x, y and z; empty if ``sensor`` names them.
    ``acceleration_unit``, ``angular_rate_unit``: as in :mod:`acromion.fusion.readers.tables.columns`; empty:
    found from the data.
    ``acceleration_factor``, ``angular_rate_factor``: g and deg/s for one unit of the file; they override
    the units.
    ``time``: column of the time; None if there is none: then ``rate_hz`` is needed.
    ``time_unit``: empty: found from the data.
    ``rate_hz``: rows per second, for tables without time.
    ``date_order``: tells "dmy" from "mdy"; None: found from the data. A profile may state this alone.
    ``name``: name of the profile.
    ``sensor``: name of the sensor on the arm, if a table contains several.
    ``pose_held``: "start": in every recording with this profile the pose was held at the start of wear; "no":
    it was not, even if a file's header states it. A profile may contain only this, for a device with known
    columns.
    """

    acceleration: tuple[Place, ...] = ()
    angular_rate: tuple[Place, ...] = ()
    acceleration_unit: str = ""
    angular_rate_unit: str = ""
    acceleration_factor: float | None = None
    angular_rate_factor: float | None = None
    time: Place | None = None
    time_unit: str = ""
    rate_hz: float | None = None
    date_order: DateOrder | None = None
    name: str = ""
    sensor: str = ""
    pose_held: PoseHeld | None = None

    @property
    def names_columns(self) -> bool:
        """Return whether the profile names columns."""
        return bool(self.sensor or self.acceleration)

    @property
    def stated_time(self) -> Place | None:
        """Return the column of the time, "" if there is none, None if the profile names no columns."""
        return (self.time or "") if self.names_columns else None

    def __post_init__(self) -> None:
        """Raise ValueError with the allowed values for an unknown unit or order of the date."""
        for name, allowed in CHOICES.items():
            check_choice(name, getattr(self, name), allowed)

    def to_json(self) -> str:
        """The profile as it is saved."""
        return json.dumps(asdict(self), sort_keys=True)


def parse_profile(text: str) -> ColumnProfile:
    """Read a saved profile.

    Raises UnusableProfile if it is not JSON or contains an impossible value.
    """
    try:
        values = json.loads(text)
    except ValueError as error:
        raise UnusableProfile(why="json") from error
    known = {field.name for field in fields(ColumnProfile)}
    if not isinstance(values, dict) or not set(values) <= known:
        raise UnusableProfile(why="names")
    stated = {name for name, value in values.items() if value} - {"name"}
    if "sensor" not in stated and not (stated and stated <= {"pose_held", "date_order"}):
        if not {"acceleration", "angular_rate"} <= set(values):
            raise UnusableProfile(why="names")
        vectors = (values["acceleration"], values["angular_rate"])
        is_vector = [isinstance(one, list) and len(one) == 3 and all(map(_is_place, one)) for one in vectors]
        if not all(is_vector) or not (values.get("time") is None or _is_place(values["time"])):
            raise UnusableProfile(why="places")
    for name, units in CHOICES.items():
        if values.get(name, units[0]) not in units:
            raise UnusableProfile(why="units", name=name)
    if values.get("pose_held") not in {None, *get_args(PoseHeld)}:
        raise UnusableProfile(why="pose held", name="pose_held")
    for name in ("acceleration_factor", "angular_rate_factor", "rate_hz"):
        value = values.get(name)
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if value is not None and not (is_number and 0 < value < 1e6):
            raise UnusableProfile(why="profile-numbers", name=name)
    for name in ("name", "sensor"):
        if not isinstance(values.get(name, ""), str):
            raise UnusableProfile(why="names", name=name)
    arguments: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in values.items()}
    return ColumnProfile(**arguments)


def _is_place(place: object) -> bool:
    if isinstance(place, bool):
        return False
    return (isinstance(place, str) and place != "") or (isinstance(place, int) and 1 <= place <= 1000)


def apply_profile(layout: TextLayout, profile: ColumnProfile) -> TextLayout:
    """Name a table's columns as the profile says.

    Raises
    ------
    UnknownColumns
        A column that the profile names is not there.
    acromion.fusion.errors.SeveralSensors
        The sensor that it names is not there.
    """
    acc_unit = "g" if profile.acceleration_factor else profile.acceleration_unit or None
    gyr_unit = "dps" if profile.angular_rate_factor else profile.angular_rate_unit or None
    time_unit = profile.time_unit or None
    if profile.sensor:
        chosen = choose_sensor(layout, profile.sensor)
        units = {"acc": acc_unit, "gyr": gyr_unit, "time": time_unit}
        stated = (replace(column, unit=units.get(column.channel) or column.unit) for column in chosen.columns)
        return replace(chosen, columns=tuple(stated))
    if not profile.acceleration:
        return layout
    names = _find_names(layout, profile)
    beside = (parse_column_name(name) for name in names)
    columns = [one if one.channel == "gravity" else Column(one.name, "other") for one in beside]
    vectors: tuple[tuple[Channel, tuple[Place, ...], str | None], ...] = (
        ("acc", profile.acceleration, acc_unit),
        ("gyr", profile.angular_rate, gyr_unit),
    )
    for channel, places, unit in vectors:
        for axis, place in enumerate(places):
            at = _find_place(names, place)
            columns[at] = Column(names[at], channel, axis, unit)
    if profile.time is not None:
        at = _find_place(names, profile.time)
        columns[at] = Column(names[at], "time", unit=time_unit)
    return replace(layout, columns=tuple(columns))


def _find_names(layout: TextLayout, profile: ColumnProfile) -> list[str]:
    """Return the header's fields; an unrecognised header is the line just before the rows."""
    wanted = {p for p in (*profile.acceleration, *profile.angular_rate) if isinstance(p, str)}
    if layout.misfit_header and wanted:
        raise explain_misfit(layout)
    lines = [split_fields(line, layout.delimiter) for line in layout.preamble[-HEADER_REACH:]]
    best = max(lines, key=lambda names: len(wanted & set(names)), default=[])
    if layout.header is not None or not wanted & set(best):
        return [column.name for column in layout.columns]
    return [*best, *[""] * (layout.n_columns - len(best))][: layout.n_columns]


def _find_place(names: Sequence[str], place: Place) -> int:
    at = place - 1 if isinstance(place, int) else names.index(place) if place in names else -1
    if not 0 <= at < len(names):
        raise UnknownColumns(list=f"{place}: {', '.join(names)}"[:200])
    return at


# A proposal for a profile from a table's head, for a person to complete in a form.

PREVIEW_ROWS, LINES_ABOVE = 5, 5
WITHOUT_DATE = re.compile(r"^1970-01-0[1-3]T")
"""The date that a time of day is given while its rows are read."""
Vector = tuple[Place, Place, Place]


@dataclass(frozen=True, slots=True)
class ProfileProposal:
    """Known facts about a table's columns; a person completes the rest.

    ``columns``: the names as written, "" for none; ``rows``: the first rows, split;
    ``acceleration``, ``angular_rate``, ``time``: places as a column profile has them, None if
    unknown; units "" if unknown: they can be found from the data. ``sensors``: their names,
    if the table or the archive holds several. ``above``: the lines above the rows, split. ``is_pair``: these
    are the rows of one of two tables, and a person can state only the order of their dates.
    """

    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    acceleration: Vector | None
    angular_rate: Vector | None
    acceleration_unit: str
    angular_rate_unit: str
    time: Place | None
    time_unit: str
    sensors: tuple[str, ...] = ()
    above: tuple[tuple[str, ...], ...] = ()
    is_pair: bool = False

    @property
    def profile(self) -> ColumnProfile | None:
        """The profile, if both vectors are known."""
        if self.acceleration is None or self.angular_rate is None:
            return None
        return ColumnProfile(
            self.acceleration,
            self.angular_rate,
            self.acceleration_unit,
            self.angular_rate_unit,
            time=self.time,
            time_unit=self.time_unit,
        )


def propose_file_profile(file: BinaryIO, file_name: str = "") -> ProfileProposal:
    """Propose a profile for a file; for an archive of several recordings, their names.

    Raises FusionError: as :func:`acromion.fusion.readers.archive.unpack` and :func:`propose_profile`.
    """
    try:
        source = unpack(open_source(file, file_name, is_hashed=False))
    except SeveralSensors as refusal:
        sensors = tuple(str(refusal.facts["list"]).split(", "))
        return ProfileProposal((), (), None, None, "", "", None, "", sensors)
    if source.pair is None:
        return propose_profile(source.head)
    text = decode_head(open_member(open_archive(source), source.pair.angular_rate, source))
    layout = find_layout(text, "dmy", stated_time="", fewest=COLUMNS_OF_ONE)
    if layout is None:
        raise UnknownFormat(kind="text")
    names = tuple(column.name for column in layout.columns)
    return ProfileProposal(names, _find_first_rows(text, layout), None, None, "", "", None, "", is_pair=True)


def propose_profile(head: bytes) -> ProfileProposal:
    """Propose a profile from the first bytes of a table (64 KiB are plenty).

    Raises
    ------
    UnknownFormat
        No lines of six fields are found.
    acromion.fusion.errors.FusionError
        The table holds epochs, or its comma has two meanings.
    """
    text = decode_head(open_source(io.BytesIO(head), is_hashed=False))
    try:
        layout = _find_proposed_layout(text)
    except (UnknownColumns, UnusableTime):
        layout = None
    if layout is None:
        return _propose_without_layout(text)
    columns = _find_columns(layout)
    sensors = {} if choose_vector(columns, "acc") and choose_vector(columns, "gyr") else find_sensors(columns)
    columns = next(iter(sensors.values())) if len(sensors) == 1 else columns
    acceleration, acc_unit = _describe_vector(columns, choose_vector(columns, "acc"), ACC_UNITS_G)
    angular_rate, gyr_unit = _describe_vector(columns, choose_vector(columns, "gyr"), GYR_UNITS_DPS)
    time, time_unit = _find_time(layout, columns)
    return ProfileProposal(
        columns=tuple(column.name for column in columns),
        rows=_find_first_rows(text, layout),
        acceleration=acceleration,
        angular_rate=angular_rate,
        acceleration_unit=acc_unit,
        angular_rate_unit=gyr_unit,
        time=None if time is None else _format_place(columns, time),
        time_unit=time_unit,
        sensors=tuple(sensors),
        above=tuple(tuple(split_fields(line, layout.delimiter)) for line in layout.preamble[-LINES_ABOVE:]),
    )


def _find_proposed_layout(text: str) -> TextLayout | None:
    """Understand the head of a table; the order of its dates, if open, does not matter here."""
    try:
        return find_layout(text, stated_time=0)
    except UnusableTime as refusal:
        if refusal.facts["why"] != "date-order":
            raise
        return find_layout(text, "dmy", stated_time=0)


def _find_first_rows(text: str, layout: TextLayout) -> tuple[tuple[str, ...], ...]:
    """Return the first rows as written in the file, or as they are rewritten if their fields differ."""
    lines = text.split("\n")[layout.first_line : layout.first_line + PREVIEW_ROWS]
    rows = tuple(tuple(split_fields(line.rstrip("\r"), layout.delimiter)) for line in lines)
    is_plain = layout.writer is None and all(len(row) <= layout.n_columns for row in rows)
    if is_plain:
        return rows
    return tuple(
        tuple(WITHOUT_DATE.sub("", field) for field in row) for row in layout.sample_rows[:PREVIEW_ROWS]
    )


def _propose_without_layout(text: str) -> ProfileProposal:
    """Show the first lines of a text that no reader understands, if they have six fields."""
    lines = [line.rstrip("\r") for line in text.split("\n")[:SNIFFED_LINES] if line.strip()]
    mark = max(DELIMITERS, key=lambda mark: median([len(split_fields(line, mark)) for line in lines] or [0]))
    fields = [tuple(split_fields(line, mark)) for line in lines]
    width = max(Counter(map(len, fields)).most_common(1), default=(0, 0))[0]
    if width < MIN_COLUMNS:
        raise UnknownFormat(kind="text")
    first = next(k for k, row in enumerate(fields) if len(row) == width)
    above, rows = fields[:first][-LINES_ABOVE:], fields[first : first + PREVIEW_ROWS]
    return ProfileProposal(("",) * width, tuple(rows), None, None, "", "", None, "", above=tuple(above))


def identify_header(file: BinaryIO) -> str:
    """Identify the header of a table, so that columns named once can be offered for the next file.

    The same names in the same order between the same delimiters give the same 16 hexadecimal digits. They
    begin with "-" if no line names the columns: then only their number is known, and tables of many
    devices have the same. Empty if the file is not a table.
    """
    try:
        layout = _find_head_layout(unpack(open_source(file, is_hashed=False)).head)
    except FusionError:
        return ""
    names = [column.name for column in _find_columns(layout)]
    mark = "" if set(names) - {"", ARRIVAL} else "-"
    text = json.dumps(
        [layout.delimiter, [names[0], *[""] * (len(layout.sample_rows[0]) - 1)] if mark else names]
    )
    return mark + hashlib.sha256(text.encode()).hexdigest()[:16]


def check_profile(head: bytes, profile: ColumnProfile) -> None:
    """Check that a profile fits a table, by its first bytes.

    Raises
    ------
    UnknownFormat
        No rows of six numbers are found.
    acromion.fusion.errors.UnknownColumns
        A column that the profile names is not there, or is named twice.
    """
    plan_table(apply_profile(_find_head_layout(head, profile), profile))


def _find_head_layout(head: bytes, profile: ColumnProfile | None = None) -> TextLayout:
    text = decode_head(open_source(io.BytesIO(head), is_hashed=False))
    layout = find_layout(
        text,
        profile.date_order if profile else None,
        stated_time=profile.stated_time if profile else None,
    )
    if layout is None:
        raise UnknownFormat(kind="text")
    return layout


def _find_columns(layout: TextLayout) -> Sequence[Column]:
    """The columns by the header; a line of other names just before the rows is one too."""
    if layout.header is not None or not layout.preamble:
        return layout.columns
    names = split_fields(layout.preamble[-1], layout.delimiter)
    return [parse_column_name(name) for name in names] if len(names) == layout.n_columns else layout.columns


def _describe_vector(
    columns: Sequence[Column], places: tuple[int, int, int] | None, units: Mapping[str, float]
) -> tuple[Vector | None, str]:
    """The places of x, y, z as a profile has them, and their unit; None and "" if unknown."""
    if places is None:
        return None, ""
    x, y, z = (_format_place(columns, place) for place in places)
    unit = columns[places[0]].unit
    return (x, y, z), unit if unit is not None and unit in units else ""


def _format_place(columns: Sequence[Column], place: int) -> Place:
    """The name, if there is one and no other column has it; else the number from 1."""
    name = columns[place].name
    return name if name and [column.name for column in columns].count(name) == 1 else place + 1


def _find_time(layout: TextLayout, columns: Sequence[Column]) -> tuple[int | None, str]:
    """The column that is named as a time, or else the first that advances as stamps do; and its unit."""
    for place, column in enumerate(columns):
        if column.channel == "time":
            return place, column.unit or ""
    found = find_unnamed_time(layout, columns)
    if found is not None:
        return found
    return None, ""
