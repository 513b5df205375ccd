"""Which recording a row of a table is about: two files of one name are told apart by where they lie."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Origin:
    """What is known of a recording before it is read, and where it is.

    ``path`` leads to the recording: in a run from the folder that was named, by REST its address. ``folder``
    leads to its results in the same way, and is empty where there are none.
    """

    file_name: str
    subject: str = ""
    side: str | None = None
    path: str = ""
    folder: str = ""


def add_origin(results: Mapping[str, Any], origin: Origin) -> dict[str, Any]:
    """Give the results with where they come from beside them, for the tables of many recordings.

    It stands in no ``results.json``, which is the same wherever the file lies.
    """
    return {**results, "origin": {"path": origin.path, "folder": origin.folder}}


def find_place(results: Mapping[str, Any], name: str) -> str | None:
    """Give ``path`` or ``folder``; None for results on their own."""
    place: str | None = results.get("origin", {}).get(name)
    return place or None
