"""All sentences for people: one TOML file per language, with a table for each part of the product.

The code contains only the keys. Untrusted texts are cleaned here, and are only ever used as text.
"""

import re
import tomllib
import unicodedata
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, get_args

from acromion.app.request import LONGEST_CONCLUSION
from acromion.app.request import Language as Language  # noqa: PLC0414  also named here
from acromion.fusion.devices import KNOWN_DEVICES
from acromion.fusion.devices import find_device_name as find_known_name

Part = Literal[
    "report",
    "pairs",
    "days",
    "agreement",
    "run",
    "fields",
    "tables",
    "page",
    "day",
    "columns",
    "pair_pages",
    "help",
    "operations",
    "live",
    "access",
    "trail",
]
Words = Mapping[str, Any]
EVERY_LANGUAGE: tuple[Language, ...] = get_args(Language)
LANGUAGES: tuple[Language, ...] = tuple(code for code in EVERY_LANGUAGE if "-" not in code)
"""Languages with a file of words; rules derive the French of Québec from the French file."""

_FOLDER = Path(__file__).parent
_TABLES = re.compile(r"^(?=\[)", re.MULTILINE)
_TABLE_PART = re.compile(r"\[+(\w+)")
_PLACEHOLDER = re.compile(r"\{(\w+)\}")
_PLURAL = re.compile(r"\{(\w+)\|([^{}|]*)\|([^{}|]*)\}")
_COUNTED = re.compile(r"\{(\w+):([a-z]{2})\|([^{}|]*)\|([^{}|]*)\}")
_OPTIONAL = re.compile(r"\[([^\[\]]*)\]")
_NARROW_SPACE = "\u202f"
_NO_BREAK_SPACE = "\u00a0"
_QUEBEC_WORDS = tuple(
    (re.compile(rf"\b{france}(s?)\b"), rf"{quebec}\1")
    for france, quebec in (("poste", "quart"), ("Poste", "Quart"))
)
"""Québec's words for a shift. Both are masculine and start with a consonant, so articles stay."""


@cache
def load_wording(language: Language, part: Part = "report") -> Words:
    """Return one part of the words: of the report, the pages, the commands, ...

    The files are written with plain spaces and straight apostrophes; this function sets the no-break spaces
    of French punctuation and the curly apostrophe, so that translators need not type them. The meanings of
    columns ("tables") stay unchanged, because programs read them.
    """
    words = tomllib.loads(_split_language(language[:2])[part])[part]
    if part != "tables":
        words = _change_all(words, lambda text: apply_typography(text, language))
    return MappingProxyType(words)


@cache
def _split_language(language: str) -> Mapping[str, str]:
    """Return the text of each part, because parsing all takes ten times as long as most callers need."""
    texts: dict[str, str] = {}
    for table in _TABLES.split((_FOLDER / f"{language}.toml").read_text(encoding="utf-8")):
        part = _TABLE_PART.match(table)
        if part:
            texts[part[1]] = texts.get(part[1], "") + table
    return texts


def is_french(language: Language) -> bool:
    """Return whether a language is French, of France or of Québec."""
    return language in ("fr", "fr-CA")


def find_other_language(language: Language) -> Language:
    """Return the second language of a bilingual report."""
    return "en" if is_french(language) else "fr"


def find_nearest(wanted: Language, made: Sequence[Language]) -> Language:
    """Return the best available language: ``wanted``, else a similar one, else the first."""
    if wanted in made:
        return wanted
    return next((one for one in made if is_french(one) == is_french(wanted)), made[0] if made else wanted)


def join_clauses(clauses: Iterable[str], language: Language) -> str:
    """Join clauses with a semicolon."""
    return (f"{_NARROW_SPACE}; " if language == "fr" else "; ").join(clauses)


def find_device_name(words: Words, device: str) -> str:
    """Return the name of a known device, the same in every language; a plug-in's device keeps its name."""
    return find_known_name(device) or str(words["device"].get(device) or clean_text(device))


def load_device_names(language: Language) -> dict[str, str]:
    """Return the names of all kinds of device, known ones and those in the words."""
    known = {one.device: find_known_name(one.device) or "" for one in KNOWN_DEVICES}
    return known | dict(load_wording(language)["device"])


def fill(text: str, facts: Mapping[str, str]) -> str:
    """Fill facts into a text: ``"{n} bytes[ in {member}]"``.

    A part in square brackets is omitted if one of its facts is missing or empty. A fact missing elsewhere
    becomes an ellipsis, because an incomplete sentence is better than none. ``{n|time|times}`` follows the
    number in ``n``.
    """
    kept = _OPTIONAL.sub(lambda part: part[1] if _is_complete(part[1], facts) else "", text)
    kept = _COUNTED.sub(lambda form: form[3] if _is_one(facts.get(form[1], ""), form[2]) else form[4], kept)
    return _PLACEHOLDER.sub(lambda place: facts.get(place[1]) or "…", kept)


def name_ranges(words: Words, kind: str) -> Words:
    """Insert the name of a kind of range into the words of a report: ``{range_name}``, ``{Range_name}``."""
    name = str(words["ranges"]["name"][kind])
    upper = name[0].upper() + name[1:]

    def put(text: str) -> str:
        return text.replace("{range_name}", name).replace("{Range_name}", upper)

    return MappingProxyType(_change_all(words, put))


def _change_all(value: Any, change: Callable[[str], str]) -> Any:
    if isinstance(value, Mapping):
        return {key: _change_all(inner, change) for key, inner in value.items()}
    if isinstance(value, list):
        return [_change_all(inner, change) for inner in value]
    return change(value) if isinstance(value, str) else value


def _is_complete(text: str, facts: Mapping[str, str]) -> bool:
    return all(facts.get(name) for name in _PLACEHOLDER.findall(text))


def _is_one(number: str, language: str) -> bool:
    """Return whether a number takes the singular: 1, in French all below 2 (Unicode CLDR)."""
    try:
        value = abs(float(re.sub(r"\s", "", number).replace(",", ".").replace("−", "-")))
    except ValueError:
        return False
    return value < 2 if language == "fr" else value == 1


def apply_typography(text: str, language: Language) -> str:
    """Set apostrophes, no-break spaces and the words of Québec.

    French has a no-break space before ``:`` and ``%`` and inside guillemets. Before ``; ! ?`` France has a
    narrow one (Imprimerie nationale, *Lexique des règles typographiques*), Québec none (Office québécois de
    la langue française).
    """
    text = _PLURAL.sub(rf"{{\1:{language[:2]}|\2|\3}}", text)
    text = re.sub(r"(?<=\w)'(?=\w)|(?<=[sS])'(?=\s)", "’", text)
    text = re.sub(r"(?<=[\d}]) (?=(?:h|min|s|g|Hz|kB|ko|bytes|octets)\b|\{\w+:)", _NO_BREAK_SPACE, text)
    if not is_french(language):
        return re.sub(r" (?=%)", _NARROW_SPACE, text)
    text = re.sub(r"(?<=\d) (?=\d{3}\b)", _NARROW_SPACE, text)
    text = re.sub(r" (?=[:»%])|(?<=«) ", _NO_BREAK_SPACE, text)
    if language == "fr":
        return re.sub(r" (?=[;!?])", _NARROW_SPACE, text)
    for france, quebec in _QUEBEC_WORDS:
        text = france.sub(quebec, text)
    return re.sub(r" (?=[;!?])", "", text)


# Untrusted texts.

MAX_TEXT = 200
LONGEST_CODE = 24
"""Longest subject code at the top of a page; the provenance has it in full."""
_UNSEEN = frozenset({"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"})


def cut_text(text: str, most: int) -> str:
    """Cut a text that is too long for its place, and mark the cut."""
    return text if len(text) <= most else text[: most - 1].rstrip() + "…"


def clean_text(text: str, most: int = MAX_TEXT) -> str:
    """Remove invisible characters (controls, direction marks, surrogates); cut what is too long."""
    return _keep_visible(text)[:most]


def check_conclusion(text: str) -> str:
    """Return a cleaned conclusion, each paragraph on a separate line.

    Raises ValueError if it has no visible text.
    """
    paragraphs = clean_paragraphs(text)
    if not paragraphs:
        raise ValueError(f"1 … {LONGEST_CONCLUSION}")
    return "\n".join(paragraphs)


def clean_paragraphs(text: str) -> tuple[str, ...]:
    """Return the paragraphs of a longer text without invisible characters, at most 1,000 characters."""
    lines = (_keep_visible(line).strip() for line in text[:LONGEST_CONCLUSION].splitlines())
    return tuple(line for line in lines if line)


def _keep_visible(text: str) -> str:
    return "".join(c for c in text if unicodedata.category(c) not in _UNSEEN)
