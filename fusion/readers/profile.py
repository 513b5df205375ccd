"""A column profile: what a person says about a table that the readers cannot understand by themselves."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

from fusion.errors import UnknownColumns, UnusableProfile
from fusion.readers.columns import TIME_UNITS_EXPONENT, Channel, Column
from fusion.readers.date_order import DateOrder
from fusion.readers.text_layout import TextLayout, split_fields
from fusion.units import ACC_UNITS_G, GYR_UNITS_DPS

Place = str | int
"""A column by its name in the header, or by its number, counted from 1."""
HEADER_REACH = 4


@dataclass(frozen=True, slots=True)
class ColumnProfile:
    """Which column of a table is what.

    ``acceleration``, ``angular_rate``: places of x, y, z. Units as in ``columns``; "" leaves a unit to be
    found from the data. ``acceleration_factor`` and ``angular_rate_factor``, where given, are g and deg/s for
    one unit of the file and go before the units. ``time`` is None where the rows hold no time; then
    ``rate_hz`` is needed. ``date_order`` tells "dmy" from "mdy".
    """

    acceleration: tuple[Place, Place, Place]
    angular_rate: tuple[Place, Place, Place]
    acceleration_unit: str = ""
    angular_rate_unit: str = ""
    acceleration_factor: float | None = None
    angular_rate_factor: float | None = None
    time: Place | None = None
    time_unit: str = ""
    rate_hz: float | None = None
    date_order: DateOrder | None = None
    name: str = ""

    def to_json(self) -> str:
        """The profile as it is saved."""
        return json.dumps(asdict(self), sort_keys=True)


def parse_profile(text: str) -> ColumnProfile:
    """Read a saved profile.

    Raises
    ------
    UnusableProfile
        It is not JSON, or a value in it cannot be.
    """
    try:
        values = json.loads(text)
    except ValueError as error:
        raise UnusableProfile(why="json") from error
    known = {field.name for field in fields(ColumnProfile)}
    if not isinstance(values, dict) or not {"acceleration", "angular_rate"} <= set(values) <= known:
        raise UnusableProfile(why="names")
    _check_places(values)
    _check_units(values)
    arguments: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in values.items()}
    return ColumnProfile(**arguments)


def _check_places(values: Mapping[str, Any]) -> None:
    places = [values["acceleration"], values["angular_rate"], [values.get("time", 1)]]
    for three, count in zip(places, (3, 3, 1), strict=True):
        is_list = isinstance(three, list) and len(three) == count
        if not is_list or not all(_is_place(place) for place in three if count == 3 or place is not None):
            raise UnusableProfile(why="places")


def _is_place(place: object) -> bool:
    if isinstance(place, bool):
        return False
    return (isinstance(place, str) and place != "") or (isinstance(place, int) and 1 <= place <= 1000)


def _check_units(values: Mapping[str, Any]) -> None:
    allowed: dict[str, Sequence[object]] = {
        "acceleration_unit": ("", *ACC_UNITS_G),
        "angular_rate_unit": ("", *GYR_UNITS_DPS),
        "time_unit": ("", *TIME_UNITS_EXPONENT),
        "date_order": (None, "ymd", "dmy", "mdy"),
    }
    for name, units in allowed.items():
        if values.get(name, units[0]) not in units:
            raise UnusableProfile(why="units", name=name)
    for name in ("acceleration_factor", "angular_rate_factor", "rate_hz"):
        value = values.get(name)
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if value is not None and not (is_number and 0 < value < 1e6):
            raise UnusableProfile(why="profile-numbers", name=name)
    if not isinstance(values.get("name", ""), str):
        raise UnusableProfile(why="names", name="name")


def apply_profile(layout: TextLayout, profile: ColumnProfile) -> TextLayout:
    """Name a table's columns as the profile says.

    Raises
    ------
    UnknownColumns
        A column that the profile names is not there.
    """
    names = _find_names(layout, profile)
    columns = [Column(name, "other") for name in names]
    acc_unit = "g" if profile.acceleration_factor else profile.acceleration_unit or None
    gyr_unit = "dps" if profile.angular_rate_factor else profile.angular_rate_unit or None
    vectors: tuple[tuple[Channel, tuple[Place, Place, Place], str | None], ...] = (
        ("acc", profile.acceleration, acc_unit),
        ("gyr", profile.angular_rate, gyr_unit),
    )
    for channel, places, unit in vectors:
        for axis, place in enumerate(places):
            at = _find_place(names, place)
            columns[at] = Column(names[at], channel, axis, unit)
    if profile.time is not None:
        at = _find_place(names, profile.time)
        columns[at] = Column(names[at], "time", unit=profile.time_unit or None)
    return replace(layout, columns=tuple(columns))


def _find_names(layout: TextLayout, profile: ColumnProfile) -> list[str]:
    """The header's fields; a header that was not recognised as one stands just before the rows."""
    if layout.header is not None:
        return [column.name for column in layout.columns]
    wanted = {p for p in (*profile.acceleration, *profile.angular_rate) if isinstance(p, str)}
    lines = [split_fields(line, layout.delimiter) for line in layout.preamble[-HEADER_REACH:]]
    best = max(lines, key=lambda names: len(wanted & set(names)), default=[])
    named = best if wanted & set(best) else []
    return [*named, *[""] * (layout.n_columns - len(named))][: layout.n_columns]


def _find_place(names: Sequence[str], place: Place) -> int:
    at = place - 1 if isinstance(place, int) else names.index(place) if place in names else -1
    if not 0 <= at < len(names):
        raise UnknownColumns(list=f"{place}: {', '.join(names)}"[:200])
    return at
