"""Periods of a recording, inwards and outwards: as rows of JSON or as a diary file."""

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from datetime import datetime
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, RootModel, StrictBool, StrictFloat

from app.report.tables import encode_table
from fusion.diary import DiaryEntry, read_diary
from fusion.periods import place_diary
from fusion.recording import MICROSECONDS

COLUMNS = ["start", "end", "kind", "label", "left_out", "file"]
LONGEST_US = 366 * 86_400 * MICROSECONDS
_YES_NO: Mapping[bool | None, str] = {None: "", True: "yes", False: "no"}


class PeriodView(BaseModel):
    """A stretch of the day: seconds from the first sample, or the clock as text (ISO 8601 or HH:MM)."""

    model_config = ConfigDict(extra="forbid")

    start: StrictFloat | str
    end: StrictFloat | str | None = None
    kind: Literal["shift", "work", "task", "seated", "supported", "break", "outside", "not_worn"]
    label: Annotated[str, Field(max_length=200)] = ""
    left_out: StrictBool | None = None


class PeriodList(RootModel[list[PeriodView]]):
    """The periods of a recording."""


def view_periods(diary: tuple[DiaryEntry, ...]) -> list[PeriodView]:
    """Show a diary as rows."""
    return [
        PeriodView(start=e.start, end=e.end, kind=e.kind, label=e.label, left_out=e.left_out) for e in diary
    ]


def write_periods(diary: tuple[DiaryEntry, ...]) -> bytes:
    """Write a diary as the CSV that is read again."""
    return encode_table(COLUMNS, [asdict(e) | {"left_out": _YES_NO[e.left_out]} for e in diary])


def read_periods(rows: list[PeriodView]) -> tuple[DiaryEntry, ...]:
    """Check rows by the very rules of the diary file (:func:`fusion.diary.read_diary`).

    Raises
    ------
    fusion.errors.UnusableDiary
        Its line is the place of the row, counted from 2: the header of a file would be line 1.
    """
    if not rows:
        return ()
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(COLUMNS[:5])
    for row in rows:
        label = " ".join(row.label.split())
        writer.writerow(
            [row.start, "" if row.end is None else row.end, row.kind, label, _YES_NO[row.left_out]]
        )
    return read_diary(text.getvalue().encode())


def check_periods(diary: Sequence[DiaryEntry], found: Mapping[str, Any] | None) -> None:
    """Place the periods on the recording as its analysis will; ``found`` is what an inspection told of it.

    Where nothing could be told (None), rows in seconds are compared with one another.

    Raises
    ------
    fusion.errors.UnusableDiary
        When a row ends before it begins, overlaps another or lies outside of the recording.
    """
    if found is None:
        numbered = [e for e in diary if isinstance(e.start, float) and isinstance(e.end, float)]
        place_diary(numbered, None, LONGEST_US)
        return
    start = datetime.fromisoformat(found["start"]) if found["start"] else None
    duration_us = round(found["recorded_s"] * MICROSECONDS)
    if place_diary(diary, start, duration_us).flags:
        for entry, following in zip(diary, [*diary[1:], None], strict=True):
            end = following.start if entry.end is None and following else entry.end
            place_diary((replace(entry, end=end),), start, duration_us)
