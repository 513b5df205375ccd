"""What a table's head says about its columns, for a person to complete: the answers of a mapping form."""

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from fusion.errors import UnknownFormat
from fusion.readers.columns import Column, choose_vector, understand_column
from fusion.readers.profile import ColumnProfile, Place, apply_profile
from fusion.readers.source import open_source
from fusion.readers.table_plan import plan_table, read_times
from fusion.readers.text_layout import TextLayout, find_layout, split_fields
from fusion.readers.text_stream import decode_head, find_form
from fusion.readers.time_unit import UNIT_NAMES, guess_exponent
from fusion.units import ACC_UNITS_G, GYR_UNITS_DPS

SHOWN_ROWS = 5
Vector = tuple[Place, Place, Place]


@dataclass(frozen=True, slots=True)
class ProfileProposal:
    """What is known of a table, and what a person has to say.

    ``columns``: the names as they stand, "" where there is none; ``rows``: the first rows, split;
    ``acceleration``, ``angular_rate``, ``time``: places as a column profile has them, None where
    nothing tells; units "" where nothing tells: they can be found from the data.
    """

    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    acceleration: Vector | None
    angular_rate: Vector | None
    acceleration_unit: str
    angular_rate_unit: str
    time: Place | None
    time_unit: str

    @property
    def profile(self) -> ColumnProfile | None:
        """The profile, where both vectors are known."""
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


def propose_profile(head: bytes) -> ProfileProposal:
    """Propose a profile from the first bytes of a table (64 KiB are plenty).

    Raises
    ------
    UnknownFormat
        No rows of six numbers are found.
    fusion.errors.FusionError
        As :func:`fusion.readers.text_layout.find_layout`.
    """
    layout = _understand(head)
    columns = _name_columns(layout)
    acc, gyr = choose_vector(columns, "acc"), choose_vector(columns, "gyr")
    time, time_unit = _find_time(layout, columns)
    return ProfileProposal(
        columns=tuple(column.name for column in columns),
        rows=layout.sample_rows[:SHOWN_ROWS],
        acceleration=_name_places(columns, acc),
        angular_rate=_name_places(columns, gyr),
        acceleration_unit=_unit_of(columns, acc, ACC_UNITS_G),
        angular_rate_unit=_unit_of(columns, gyr, GYR_UNITS_DPS),
        time=None if time is None else _name_place(columns, time),
        time_unit=time_unit,
    )


def check_profile(head: bytes, profile: ColumnProfile) -> None:
    """Say whether a profile fits a table, by its first bytes.

    Raises
    ------
    UnknownFormat
        No rows of six numbers are found.
    fusion.errors.UnknownColumns
        A column that the profile names is not there, or is named twice.
    """
    plan_table(apply_profile(_understand(head, profile), profile))


def _understand(head: bytes, profile: ColumnProfile | None = None) -> TextLayout:
    source = open_source(io.BytesIO(head), is_hashed=False)
    text = decode_head(source, find_form(source.head))
    layout = find_layout(text, profile.date_order if profile else None)
    if layout is None:
        raise UnknownFormat(kind="text")
    return layout


def _name_columns(layout: TextLayout) -> Sequence[Column]:
    """The columns by the header; a line of other names just before the rows is one too."""
    if layout.header is not None or not layout.preamble:
        return layout.columns
    names = split_fields(layout.preamble[-1], layout.delimiter)
    return [understand_column(name) for name in names] if len(names) == layout.n_columns else layout.columns


def _name_places(columns: Sequence[Column], places: tuple[int, int, int] | None) -> Vector | None:
    if places is None:
        return None
    x, y, z = (_name_place(columns, place) for place in places)
    return x, y, z


def _name_place(columns: Sequence[Column], place: int) -> Place:
    """The name, where it is one and no other column has it; else the number from 1."""
    name = columns[place].name
    return name if name and [column.name for column in columns].count(name) == 1 else place + 1


def _unit_of(
    columns: Sequence[Column], places: tuple[int, int, int] | None, known: Mapping[str, float]
) -> str:
    unit = columns[places[0]].unit if places else None
    return unit if unit is not None and unit in known else ""


def _find_time(layout: TextLayout, columns: Sequence[Column]) -> tuple[int | None, str]:
    """The column that is named as a time, or else the first that advances as stamps do; and its unit."""
    for place, column in enumerate(columns):
        if column.channel == "time":
            return place, column.unit or ""
    for place, column in enumerate(columns):
        times = read_times([row[place] for row in layout.sample_rows if len(row) > place], layout.decimal)
        exponent = guess_exponent(times) if column.channel == "other" and _advances(times) else None
        if exponent is not None:
            return place, UNIT_NAMES[exponent]
    return None, ""


def _advances(times: Sequence[float]) -> bool:
    return len(times) > 1 and all(before < after for before, after in pairwise(times))
