"""The document: sections that can be created separately, each with its figures and its goals."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Goal:
    """A goal of the validation: the target and the actual figure."""

    what: str
    asked: str
    reached: str
    met: bool


@dataclass(frozen=True, slots=True)
class Section:
    """One part of the document.

    ``shown``: its prose and tables; ``details``: tables that only ``--details`` writes.
    """

    title: str
    shown: tuple[str, ...]
    goals: tuple[Goal, ...] = ()
    details: tuple[str, ...] = ()


def judge(what: str, value: float, limit: float, unit: str = "deg", decimals: int = 3) -> Goal:
    """Compare a figure, rounded as it is printed, with its upper limit."""
    reached = f"{value:.{decimals}f} {unit}"
    return Goal(what, f"<= {limit:.{decimals}f} {unit}", reached, round(value, decimals) <= limit)


def draw_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table: the first column left-aligned, figures right-aligned."""
    rule = ["---", *["---:"] * (len(header) - 1)]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in (header, rule, *rows))


def render_section(name: str, section: Section, made_with: str) -> str:
    """Return the section's text between the markers that identify it."""
    goals = [draw_goals(section.goals)] if section.goals else []
    parts = [f"### {section.title}", *section.shown, *goals, f"Made with {made_with}."]
    return "\n\n".join([_begin(name), *parts, _end(name)])


def render_details(section: Section) -> str:
    """Return the whole section, including the tables that the document omits."""
    return "\n\n".join([f"## {section.title}", *section.shown, *section.details])


def find_sections(text: str, names: Sequence[str]) -> dict[str, str]:
    """Split an earlier document, so that a section that is made alone replaces only itself."""
    found = {}
    for name in names:
        match = re.search(re.escape(_begin(name)) + r".*?" + re.escape(_end(name)), text, re.DOTALL)
        if match:
            found[name] = match.group(0)
    return found


def assemble(preface: str, sections: Mapping[str, str]) -> str:
    """Return the document; a summary above the sections counts the goals that are met."""
    counts = [re.findall(r"(\d+)/(\d+) \|$", text, re.MULTILINE) for text in sections.values()]
    met, every = (sum(int(pair[k]) for pairs in counts for pair in pairs) for k in (0, 1))
    summary = f"Of the goals for the angle, {met} of {every} are met."
    return "\n\n".join([preface, "## Results", summary, *sections.values()]) + "\n"


def draw_goals(goals: Iterable[Goal]) -> str:
    """Return a table; goals that only differ in the measured object share a row; missed goals are bold."""
    grouped: dict[tuple[str, str], list[tuple[str, Goal]]] = {}
    for goal in goals:
        of, _, figure = goal.what.rpartition(": ")
        grouped.setdefault((re.sub(r" \(.*\)", "", figure), goal.asked), []).append((of, goal))
    rows = [
        [
            figure,
            "; ".join(of for of, _ in found if of) or "-",
            asked,
            "; ".join(goal.reached if goal.met else f"**{goal.reached}**" for _, goal in found),
            f"{sum(goal.met for _, goal in found)}/{len(found)}",
        ]
        for (figure, asked), found in grouped.items()
    ]
    return draw_table(("figure", "of", "goal", "reached", "met"), rows)


def _begin(name: str) -> str:
    return f"<!-- section {name} -->"


def _end(name: str) -> str:
    return f"<!-- end of {name} -->"
