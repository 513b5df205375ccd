"""Frozen values to JSON and back, by their types: dataclasses, tuples, mappings, arrays, moments.

Numbers keep every digit; NaN and infinity, which an array may hold, are written as ``json`` writes them. A
clock that follows a zone keeps the zone's name beside its time.
"""

import types
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from datetime import datetime
from functools import cache
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints
from zoneinfo import ZoneInfo

import numpy as np


def encode(value: Any) -> Any:
    """Turn a value into what ``json`` can write."""
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: encode(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, Mapping):
        return {str(key): encode(inner) for key, inner in value.items()}
    if isinstance(value, tuple | list):
        return [encode(inner) for inner in value]
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return _encode_moment(value) if isinstance(value, datetime) else value


def decode(value: Any, kind: Any) -> Any:
    """Turn what ``json`` read into a value of the type ``kind``."""
    origin, inner = get_origin(kind), get_args(kind)
    if value is None or origin is Literal:
        return value
    if origin in {Union, types.UnionType}:
        return _decode_one_of(value, inner)
    if origin is tuple:
        return _decode_tuple(value, inner)
    if origin is np.ndarray:
        return np.array(value, get_args(inner[1])[0])
    if origin in {dict, Mapping}:
        return {inner[0](key): decode(item, inner[1]) for key, item in value.items()}
    return _decode_plain(value, kind)


def _decode_one_of(value: Any, kinds: tuple[Any, ...]) -> Any:
    """Only one of the kinds is not a plain value of JSON, or none of them is."""
    structured = [kind for kind in kinds if kind not in {type(None), str, int, float}]
    return decode(value, structured[0]) if structured else value


def _decode_tuple(values: Any, kinds: tuple[Any, ...]) -> tuple[Any, ...]:
    if len(kinds) == 2 and kinds[1] is Ellipsis:
        return tuple(decode(value, kinds[0]) for value in values)
    return tuple(decode(value, kind) for value, kind in zip(values, kinds, strict=True))


def _decode_plain(value: Any, kind: Any) -> Any:
    if is_dataclass(kind):
        hints = _read_hints(kind)  # type: ignore[arg-type]
        return kind(**{name: decode(inner, hints[name]) for name, inner in value.items()})  # type: ignore[operator]
    return _decode_moment(value) if kind is datetime else value


@cache
def _read_hints(kind: Any) -> dict[str, Any]:
    return get_type_hints(kind)


def _encode_moment(moment: datetime) -> list[str]:
    zone = moment.tzinfo.key if isinstance(moment.tzinfo, ZoneInfo) else ""
    return [moment.isoformat(), zone]


def _decode_moment(written: list[str]) -> datetime:
    moment = datetime.fromisoformat(written[0])
    return moment.astimezone(ZoneInfo(written[1])) if written[1] else moment
