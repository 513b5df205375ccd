"""Rows that name every value, as a sketch prints them to its serial port: `ax: 0.1 ay: -0.2 az: 9.8 ...`.

They are rewritten to a table before anything else looks at them. The serial monitor's own time of day
(`12:30:01.123 -> ax: ...`) becomes a column.
"""

import re
from collections.abc import Sequence

from fusion.readers.tables.header import MIN_COLUMNS

PAIR = re.compile(
    r"([A-Za-z_][\w .]*?(?: ?\([^)\n]*\))?) ?[:=] *([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)(?![\w:.])"
)
ARRIVED = re.compile(r"^(\d{1,2}:\d{2}:\d{2}[.,]\d+) -> ")
LOOKED_AT_LINES, FEWEST_LINES = 40, 3
LATER_AXES = ("y", "z")


class LabelWriter:
    """Writes the values of labelled rows with tabs between them; other lines are left as they are.

    Attributes
    ----------
    labels
        The names, in their order; "time" first where the serial monitor put its own before each row.
    """

    def __init__(self, labels: Sequence[str]) -> None:
        self.labels = tuple(labels)

    def rewrite(self, text: str) -> str:
        """Rewrite whole lines."""
        return "\n".join(self._rewrite_line(line) for line in text.split("\n"))

    def _rewrite_line(self, line: str) -> str:
        labels, values = read_labels(line)
        return "\t".join(values) if labels == self.labels else line


def read_labels(line: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Read the names and the values of a line; `Accel X: 1 Y: 2 Z: 3` names three axes of one sensor."""
    arrived = ARRIVED.match(line)
    pairs = PAIR.findall(line)
    labels = ["time"] if arrived else []
    for label, _ in pairs:
        is_later = label.lower() in LATER_AXES and labels and labels[-1][-1:].lower() in "xy"
        labels.append(labels[-1][:-1] + label if is_later else label)
    values = [arrived.group(1)] if arrived else []
    return tuple(labels), (*values, *(value for _, value in pairs))


def find_labels(head: str) -> LabelWriter | None:
    """Find the names with which most rows of a text begin their values; None for any other text."""
    lines = [line for line in head.split("\n")[:LOOKED_AT_LINES] if line.strip()]
    named = [labels for labels, _ in map(read_labels, lines) if len(labels) >= MIN_COLUMNS]
    if len(named) < FEWEST_LINES or 2 * named.count(named[-1]) <= len(lines):
        return None
    return LabelWriter(named[-1])


def tabulate_head(head: str, writer: LabelWriter) -> str:
    """Rewrite the head as a table, with the names on a line of their own before the first row."""
    lines = writer.rewrite(head).split("\n")
    first = next(k for k, line in enumerate(head.split("\n")) if read_labels(line)[0] == writer.labels)
    return "\n".join([*lines[:first], "\t".join(writer.labels), *lines[first:]])
