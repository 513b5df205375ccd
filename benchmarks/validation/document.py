"""The document: sections that can be made one at a time, each with its figures and its goals."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Goal:
    """A goal of the validation: the figure asked for and the figure reached."""

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
    """Compare a figure with its upper limit, as printed."""
    reached = f"{value:.{decimals}f} {unit}"
    return Goal(what, f"<= {limit:.{decimals}f} {unit}", reached, round(value, decimals) <= limit)


def draw_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Lay out a Markdown table: the first column to the left, figures to the right."""
    rule = ["---", *["---:"] * (len(header) - 1)]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in (header, rule, *rows))


def render_section(name: str, section: Section, made_with: str) -> str:
    """Return the section's text between the marks by which it is found again."""
    goals = [draw_goals(section.goals)] if section.goals else []
    parts = [f"### {section.title}", *section.shown, *goals, f"Made with {made_with}."]
    return "\n\n".join([_begin(name), *parts, _end(name)])


def render_details(section: Section) -> str:
    """Everything that the document leaves out."""
    return "\n\n".join([f"## {section.title}", *section.shown, *section.details])


def find_sections(text: str, names: Sequence[str]) -> dict[str, str]:
    """Take an earlier document apart, so that a section made alone replaces only itself."""
    found = {}
    for name in names:
        match = re.search(re.escape(_begin(name)) + r".*?" + re.escape(_end(name)), text, re.DOTALL)
        if match:
            found[name] = match.group(0)
    return found


def assemble(preface: str, sections: Mapping[str, str]) -> str:
    """Return the document, with the number of goals that are met at its top."""
    counts = [re.findall(r"(\d+)/(\d+) \|$", text, re.MULTILINE) for text in sections.values()]
    met, every = (sum(int(pair[k]) for pairs in counts for pair in pairs) for k in (0, 1))
    summary = f"Of the goals for the angle, {met} of {every} are met."
    return "\n\n".join([preface, "## Results", summary, *sections.values()]) + "\n"


def draw_goals(goals: Iterable[Goal]) -> str:
    """One row for the goals that differ in what was measured alone; what is missed is bold."""
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
