"""What the report cites, with the identifiers that lead there; the same in every language.

Context for a reader: nothing here is turned into a figure about one person.
"""

import tomllib
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Publication:
    """A publication as the text cites it and in full; ``doi`` is empty where none is known."""

    cited: str
    full: str
    doi: str = ""


_LISTED = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
BIBLIOGRAPHY = tuple(Publication(cited, **told) for cited, told in _LISTED.items())


def format_bibliography() -> tuple[str, ...]:
    """Return every publication in full, in the order of the first author."""
    return tuple(f"{one.full} doi:{one.doi}" if one.doi else one.full for one in BIBLIOGRAPHY)
