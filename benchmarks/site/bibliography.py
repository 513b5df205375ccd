"""Format the citations of ``docs/paper.md`` for the site: ``[@key]`` in brackets, and the list at its end."""

import re
from collections.abc import Mapping
from pathlib import Path

_ENTRY = re.compile(r"^@\w+\{(?P<key>[^,]+),\n(?P<fields>.*?)\n\}", re.MULTILINE | re.DOTALL)
_FIELD = re.compile(r"^\s*(\w+) = \{(.*)\},?$", re.MULTILINE)
_CITED = re.compile(r"\[(?P<keys>@[\w; @]+)\]|(?P<alone>@[a-z]+\d{0,4})\b")


def cite(markdown: str, bibliography: Path) -> str:
    """Replace ``[@laidig2023]`` by "(Laidig and Seel 2023)", and append the list of works.

    Raises
    ------
    KeyError
        A cited work is not in the bibliography.
    """
    works = _read_works(bibliography.read_text("utf-8"))
    text = _CITED.sub(lambda found: _write_citation(found, works), markdown)
    return "\n".join([text.rstrip(), "", *(f"- {_write_work(work)}" for work in _sort(works)), ""])


def _read_works(text: str) -> dict[str, Mapping[str, str]]:
    return {
        entry["key"]: {name: re.sub(r"[{}]", "", value) for name, value in _FIELD.findall(entry["fields"])}
        for entry in _ENTRY.finditer(text)
    }


def _write_citation(found: re.Match[str], works: Mapping[str, Mapping[str, str]]) -> str:
    keys = re.findall(r"@(\w+)", found[0])
    text = "; ".join(f"{_name_authors(works[key])} {works[key].get('year', '')}".strip() for key in keys)
    return f"({text})" if found["keys"] else text


def _name_authors(work: Mapping[str, str]) -> str:
    names = [name.split(",")[0] for name in work["author"].split(" and ")]
    return names[0] if len(names) == 1 else " and ".join(names) if len(names) == 2 else f"{names[0]} et al."


def _write_work(work: Mapping[str, str]) -> str:
    authors = "; ".join(work["author"].split(" and "))
    parts = [work[name].replace("--", "\u2013") for name in ("journal", "volume", "pages") if name in work]
    place = f" {', '.join(parts)}." if parts else ""
    link = f" [doi:{work['doi']}](https://doi.org/{work['doi']})" if "doi" in work else ""
    year = f" ({work['year']})" if "year" in work else ""
    return f"{authors}{year}. {work['title']}.{place}{link}"


def _sort(works: Mapping[str, Mapping[str, str]]) -> list[Mapping[str, str]]:
    return sorted(works.values(), key=lambda work: (work["author"], work.get("year", "")))
