"""The document: sections that can be made one at a time, each with its goals, and what is missed on top."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

MISSED = "**missed**"


@dataclass(frozen=True, slots=True)
class Goal:
    """A goal of FUSION.md §7: the figure asked for and the figure reached."""

    what: str
    asked: str
    reached: str
    met: bool


@dataclass(frozen=True, slots=True)
class Section:
    """One part of the document; ``paragraphs`` are prose and tables, in order."""

    title: str
    paragraphs: tuple[str, ...]
    goals: tuple[Goal, ...] = ()


def judge(what: str, value: float, limit: float, unit: str = "deg", decimals: int = 3) -> Goal:
    """Compare a figure with its upper limit, as printed."""
    reached = f"{value:.{decimals}f} {unit}"
    return Goal(what, f"<= {limit:.{decimals}f} {unit}", reached, round(value, decimals) <= limit)


def draw_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Lay out a Markdown table: the first column to the left, figures to the right."""
    rule = ["---", *["---:"] * (len(header) - 1)]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in (header, rule, *rows))


def render_section(name: str, section: Section, made_with: str) -> str:
    """Give the section's text between the marks by which it is found again."""
    goals = [_draw_goals(section.goals)] if section.goals else []
    parts = [f"## {section.title}", *section.paragraphs, *goals, f"Made with {made_with}."]
    return "\n\n".join([_begin(name), *parts, _end(name)])


def find_sections(text: str, names: Sequence[str]) -> dict[str, str]:
    """Take an earlier document apart, so that a section made alone replaces only itself."""
    found = {}
    for name in names:
        match = re.search(re.escape(_begin(name)) + r".*?" + re.escape(_end(name)), text, re.DOTALL)
        if match:
            found[name] = match.group(0)
    return found


def assemble(preface: Sequence[str], sections: Mapping[str, str]) -> str:
    """Put the document together; the goals of all sections are gathered on top."""
    rows = [line for text in sections.values() for line in text.splitlines() if _is_goal(line)]
    missed = sum(MISSED in row for row in rows)
    summary = f"{len(rows) - missed} of {len(rows)} goals are met, {missed} missed:"
    return "\n\n".join([*preface, summary, "\n".join([*_GOAL_HEAD, *rows]), *sections.values()]) + "\n"


_GOAL_HEAD = ("| goal | asked | reached | |", "|---|---:|---:|---|")


def _draw_goals(goals: Sequence[Goal]) -> str:
    rows = [f"| {g.what} | {g.asked} | {g.reached} | {'met' if g.met else MISSED} |" for g in goals]
    return "\n".join([*_GOAL_HEAD, *rows])


def _is_goal(line: str) -> bool:
    return line.endswith(("| met |", f"| {MISSED} |"))


def _begin(name: str) -> str:
    return f"<!-- section {name} -->"


def _end(name: str) -> str:
    return f"<!-- end of {name} -->"
