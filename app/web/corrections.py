"""What a person corrects on the page of an analysis: whose arm, which pose and window, what the day held."""

import csv
import io
from collections.abc import Iterator
from dataclasses import replace
from itertools import zip_longest
from typing import TypeVar, get_args

from app.errors import BadParameter
from app.report.subject import MAX_TEXT
from app.request import SUBJECT_ALLOWED, ReportRequest, check_subject, list_window_counts
from app.web.clock_times import DayClock, place_rows
from app.web.forms import Form, first
from fusion.choices import Pose, Side
from fusion.diary import DiaryEntry, read_diary
from fusion.errors import UnusableCalibration

COLUMNS = ("start", "end", "kind", "label")
BOM = "\ufeff"

T = TypeVar("T", bound=str)


def correct_request(before: ReportRequest, form: Form, clock: DayClock) -> ReportRequest:
    """Give the request of the next analysis.

    Raises
    ------
    BadParameter, fusion.errors.UnusableDiary, fusion.errors.UnusableCalibration
    """
    pose = _choose_pose(first(form, "pose"))
    windows = tuple(_read_windows(form, clock))
    if len(windows) not in list_window_counts(pose):
        counts = "|".join(map(str, list_window_counts(pose)))
        raise BadParameter(name="calibration", value=str(len(windows)), allowed=f"{pose}: {counts}")
    diary = read_rows(form)
    place_rows(diary, clock)  # so that a row that cannot be placed is told at once
    return replace(
        before,
        subject=_read_subject(first(form, "subject")),
        side=_choose_side(first(form, "side")),
        pose=pose,
        calibration_windows_s=windows,
        diary=diary,
        reason=first(form, "reason").strip()[:MAX_TEXT],
    )


def read_rows(form: Form) -> tuple[DiaryEntry, ...]:
    """Give the periods of the form; rows without a time are left aside.

    Raises
    ------
    fusion.errors.UnusableDiary
        With the row as ``line``, counted from 1 with the heading.
    """
    rows = [
        row for row in zip_longest(*(form.get(name, []) for name in COLUMNS), fillvalue="") if row[0].strip()
    ]
    return read_diary(write_csv(rows)) if rows else ()


def write_csv(rows: list[tuple[str, ...]], *, bom: str = "") -> bytes:
    """Write rows of start, end, kind, label as a diary that we read again."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, delimiter=";")
    writer.writerows([COLUMNS, *rows])
    return (bom + text.getvalue()).encode()


def _read_windows(form: Form, clock: DayClock) -> Iterator[tuple[float, float]]:
    """Give the windows that were typed; an empty one is left to the proposal."""
    starts, ends = form.get("window_start", []), form.get("window_end", [])
    for start, end in zip_longest(starts, ends, fillvalue=""):
        if start.strip() or end.strip():
            if not (start.strip() and end.strip()):
                told = " – ".join(moment.strip() or "?" for moment in (start, end))
                raise BadParameter(name="calibration", value=told[:60], allowed=clock.tell_bounds())
            yield _check_order(*(clock.read(moment.strip(), "calibration") for moment in (start, end)))


def _check_order(start_s: float, end_s: float) -> tuple[float, float]:
    if end_s <= start_s:
        raise UnusableCalibration(why="end first", start_s=start_s, end_s=end_s)
    return start_s, end_s


def _read_subject(text: str) -> str:
    try:
        return check_subject(text)
    except ValueError:
        raise BadParameter(name="subject", value=text[:60], allowed=SUBJECT_ALLOWED) from None


def _choose_pose(text: str) -> Pose:
    poses: tuple[Pose, ...] = get_args(Pose)
    return _find(poses, text, "pose")


def _choose_side(text: str) -> Side | None:
    sides: tuple[Side, ...] = get_args(Side)
    return _find(sides, text, "side") if text else None


def _find(allowed: tuple[T, ...], text: str, name: str) -> T:
    for choice in allowed:
        if choice == text:
            return choice
    raise BadParameter(name=name, value=text[:60], allowed=", ".join(allowed))
