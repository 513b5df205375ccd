"""The settings of a study as ``settings.yaml``, which a run writes and ``--config`` reads.

The names are those of the command's options. Files, arms and the number of parallel jobs are not settings of
a study: they are in the list of participants and on the command line.
"""

import json
import math
import re
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from difflib import get_close_matches
from typing import Any, get_args

import yaml

from acromion.app.batch.stated import list_settings
from acromion.app.errors import UnusableSettings
from acromion.app.request import (
    SHIFT_HINT,
    SLIP_HINT,
    WINDOW_HINT,
    Language,
    Paper,
    ReportKind,
    ReportRequest,
    check_hours,
    parse_slip_time,
    write_profile,
)
from acromion.fusion.clocks import (
    OFFSET_HINT,
    ZONE_HINT,
    parse_clock_offset,
    parse_time_zone,
)
from acromion.fusion.conventions import AXIS_HINT, MethodName, Pose, PoseHeld, Side, parse_arm_axis
from acromion.fusion.diary import KINDS, DiaryEntry, read_moment, split_times
from acromion.fusion.errors import UnusableDiary

Read = Callable[[Any], Any]
DIARY_HINT = '[{start: "07:58" | start_s: 60, end | end_s, kind, label}]'


class _PlainLoader(yaml.SafeLoader):
    """Loads ``10:30`` as text; YAML 1.1 would read it as 630 in base 60."""


_PlainLoader.yaml_implicit_resolvers = {
    first: [
        (tag, pattern)
        for tag, pattern in resolvers
        if tag.rpartition(":")[2] not in {"int", "float", "timestamp"}
    ]
    for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}


class _PlainDumper(yaml.SafeDumper):
    """Quotes also a text that :class:`_PlainLoader` would read as a number."""


for _one in (_PlainLoader, _PlainDumper):
    _one.add_implicit_resolver("tag:yaml.org,2002:int", re.compile(r"[-+]?\d+$"), list("-+0123456789"))
    _one.add_implicit_resolver(
        "tag:yaml.org,2002:float",
        re.compile(r"[-+]?(\d+\.\d*|\.\d+)([eE][-+]?\d+)?$|[-+]?\d+[eE][-+]?\d+$"),
        list("-+.0123456789"),
    )


@dataclass(frozen=True, slots=True)
class Setting:
    """A name in the file: the request field it sets, how to parse its value, and a hint of allowed values."""

    name: str
    field: str
    read: Read
    allowed: str


def _choose(values: Iterable[str], *, may_be_empty: bool = False) -> tuple[Read, str]:
    allowed = tuple(values)

    def read(value: Any) -> Any:
        if (value is None and may_be_empty) or value in allowed:
            return value
        raise ValueError

    return read, "|".join(allowed)


def _read_window_list(value: Any) -> tuple[tuple[float, float], ...]:
    windows = tuple((float(start_s), float(end_s)) for start_s, end_s in value or ())
    if any(not 0 <= start_s < end_s < math.inf for start_s, end_s in windows):
        raise ValueError
    return windows


def _read_held(value: Any) -> PoseHeld | None:
    """Parse ``start`` or ``no``, which YAML 1.1 reads as "false"."""
    known: tuple[PoseHeld | None, ...] = (*get_args(PoseHeld), None)
    return known[known.index("no" if value is False else value)]


def _read_flag(value: Any) -> bool:
    if not isinstance(value, bool):
        raise ValueError
    return value


def _read_slip_list(value: Any) -> tuple[float, ...]:
    return tuple(parse_slip_time(time_s) for time_s in value or ())


def _read_rate(value: Any) -> float | None:
    return None if value is None else _read_number(value, 1, 10_000)


def _read_number(value: Any, least: float, most: float) -> float:
    if not least <= float(value) <= most:
        raise ValueError
    return float(value)


def _read_clock_offset(value: Any) -> float:
    return parse_clock_offset(str(value)) if value else 0.0


def _read_kinds(value: Any) -> tuple[ReportKind, ...]:
    known = get_args(ReportKind)
    kinds = tuple(kind for kind in known if kind in value)
    if not kinds or set(value) - set(known):
        raise ValueError
    return kinds


def _read_entry(
    *, start: str = "", end: str = "", start_s: Any = "", end_s: Any = "", kind: Any, **others: Any
) -> DiaryEntry:
    """Parse a row; seconds are allowed only in ``start_s`` and ``end_s``."""
    if kind not in KINDS or not (isinstance(start, str) and isinstance(end, str)):
        raise ValueError
    try:
        begin, stop = read_moment(0, start, str(start_s)), read_moment(0, end, str(end_s))
    except UnusableDiary:
        raise ValueError from None
    if begin is None:
        raise ValueError
    return DiaryEntry(begin, stop, kind, **others)


SETTINGS: tuple[Setting, ...] = (
    Setting("method", "method", *_choose(get_args(MethodName))),
    Setting("pose", "pose", *_choose(get_args(Pose))),
    Setting("side", "side", *_choose(get_args(Side), may_be_empty=True)),
    Setting("calibration", "calibration_windows_s", _read_window_list, f"[[{WINDOW_HINT}]]"),
    Setting("pose_held", "pose_held", _read_held, "|".join(get_args(PoseHeld))),
    Setting("axis", "arm_axis", lambda value: None if value is None else parse_arm_axis(value), AXIS_HINT),
    Setting("slip_at", "slip_times_s", _read_slip_list, f"[{SLIP_HINT}]"),
    Setting("no_slip_at", "no_slip_times_s", _read_slip_list, f"[{SLIP_HINT}]"),
    Setting("shift", "shift", lambda value: check_hours(value) if value else "", SHIFT_HINT),
    Setting("min_hours", "min_hours", lambda hours: _read_number(hours, 0, 24), "0 to 24"),
    Setting("rate_hz", "rate_hz", _read_rate, "1 to 10000"),
    Setting("time_zone", "time_zone", lambda name: parse_time_zone(name or ""), ZONE_HINT),
    Setting("clock_offset", "clock_offset_s", _read_clock_offset, OFFSET_HINT),
    Setting(
        "lang",
        "languages",
        lambda value: (_choose(get_args(Language))[0](value),),
        "|".join(get_args(Language)),
    ),
    Setting("report", "kinds", _read_kinds, "[html, pdf]"),
    Setting("paper", "paper", *_choose(get_args(Paper))),
    Setting("appendix", "appendix", _read_flag, "true|false"),
    Setting("diary", "diary", lambda rows: tuple(_read_entry(**row) for row in rows or ()), DIARY_HINT),
    Setting(
        "profile",
        "profile",
        lambda value: write_profile(dict(value)) if value else "",
        "{acceleration, angular_rate, ...}",
    ),
)
_BY_NAME = {setting.name: setting for setting in SETTINGS}


def encode_settings(request: ReportRequest) -> bytes:
    """Format all settings of a request as YAML, in a fixed order."""
    values = list_settings(request) | {
        "diary": [  # the line in the original file is not a setting
            {name: value for name, value in row.items() if value not in {None, ""} and name != "line"}
            for row in (asdict(entry) | split_times(entry) for entry in request.diary)
        ],
        "profile": json.loads(request.profile) if request.profile else None,
    }
    text: str = yaml.dump(values, Dumper=_PlainDumper, sort_keys=False, allow_unicode=True)
    return text.encode("utf-8")


def read_settings(content: bytes) -> dict[str, Any]:
    """Parse a settings file; return the fields of :class:`ReportRequest` that it sets.

    Raises UnusableSettings with the line or name, the allowed values and, for an unknown name, the nearest
    known one.
    """
    try:
        values = yaml.load(content, _PlainLoader)  # noqa: S506  a SafeLoader
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        raise UnusableSettings(line=mark.line + 1 if mark else 1, why="yaml") from None
    if values is None:
        return {}
    if not isinstance(values, dict):
        raise UnusableSettings(line=1, why="yaml")
    read = {}
    for name, value in ((str(name), value) for name, value in values.items()):
        setting = _BY_NAME.get(name)
        if setting is None:
            nearest, allowed = "".join(get_close_matches(name, _BY_NAME, 1)), ", ".join(_BY_NAME)
            raise UnusableSettings(name=name[:60], why="setting name", nearest=nearest, allowed=allowed)
        try:
            read[setting.field] = setting.read(value)
        except (TypeError, ValueError):
            shown, allowed = str(value)[:60], setting.allowed
            raise UnusableSettings(name=name, why="setting value", value=shown, allowed=allowed) from None
    return read
