"""Run the damage matrix: ``python -m benchmarks.damage`` (about 280 cells; some minutes on an idle machine).

A real server builds a small store once. Each cell copies it, damages one part, does one thing by the real
command line or over HTTP, and checks the result. The table is printed as Markdown; ``--write`` puts it
between its marks in ``docs/reference/reliability.md``. Exit code 1 with a list if anything was broken.
``--part``, ``--damage`` and ``--action`` choose cells.
"""

import argparse
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

from tests.crash.damage import (
    ACTIONS,
    DAMAGES,
    LIMITS,
    MEANINGLESS,
    MEANINGLESS_ACTIONS,
    PARTS,
    Cell,
    Seen,
    Stock,
    list_cells,
    make_stock,
    observe,
)

PAGE = Path(__file__).resolve().parents[1] / "docs" / "reference" / "reliability.md"
BEGIN, END = "<!-- damage -->", "<!-- end of damage -->"

Table = dict[Cell, Seen]


def try_cell(stock: Stock, cell: Cell) -> Seen:
    with tempfile.TemporaryDirectory() as folder:
        try:
            seen = observe(stock, cell, Path(folder))
        except Exception as error:  # noqa: BLE001 - an unexpected error counts as a break
            seen = Seen("broken off", type(error).__name__, [str(error).strip()[-200:]])
    print(f"{cell.part} {cell.damage}, {cell.action}: {format_seen(seen)}", flush=True)
    for line in seen.broken:
        print("   ", line, flush=True)
    return seen


def format_seen(seen: Seen) -> str:
    text = f"{seen.word} ({seen.detail})" if seen.detail else seen.word
    return f"**{text}: {len(seen.broken)} broken**" if seen.broken else text


def format_table(table: Table) -> str:
    lines = [f"| part | damage | {' | '.join(ACTIONS)} |", "|---" * (2 + len(ACTIONS)) + "|"]
    for part in PARTS:
        for damage in DAMAGES:
            row = [_format_cell(table, Cell(part, damage, action)) for action in ACTIONS]
            if (part, damage) not in MEANINGLESS and any(row):
                lines.append(f"| {part} | {damage} | {' | '.join(row)} |")
    left_out = [f"{part} {damage}: {why}" for (part, damage), why in MEANINGLESS.items()]
    left_out += [f"{part}, {action}: {why}" for (part, action), why in MEANINGLESS_ACTIONS.items()]
    limits = [f"{part} {damage}: {why}" for (part, damage), why in LIMITS.items()]
    return "\n".join(
        [*lines, "", f"Omitted: {'; '.join(left_out)}.", "", f"Cannot be detected: {'; '.join(limits)}."]
    )


def _format_cell(table: Table, cell: Cell) -> str:
    if cell.why_meaningless:
        return "-"
    return format_seen(table[cell]) if cell in table else ""


def write_page(text: str) -> None:
    """Write the table between its marks in the page."""
    before, _, rest = PAGE.read_text("utf-8").partition(BEGIN)
    after = rest.partition(END)[2]
    PAGE.write_text(f"{before}{BEGIN}\n{text}\n{END}{after}", "utf-8")


def choose_cells(wished: argparse.Namespace) -> Sequence[Cell]:
    return [
        cell
        for cell in list_cells()
        if not cell.why_meaningless
        and wished.part in (None, cell.part)
        and wished.damage in (None, cell.damage)
        and wished.action in (None, cell.action)
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description="Damage a store in every way and check what follows.")
    parser.add_argument("--part", choices=PARTS)
    parser.add_argument("--damage", choices=DAMAGES)
    parser.add_argument("--action", choices=ACTIONS)
    parser.add_argument("-j", "--jobs", type=int, default=2, help="cells at once")
    parser.add_argument(
        "--write", action="store_true", help="put the table into docs/reference/reliability.md"
    )
    wished = parser.parse_args()
    cells = choose_cells(wished)
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(wished.jobs) as pool:
        stock = make_stock(Path(folder))
        table = dict(zip(cells, pool.map(partial(try_cell, stock), cells), strict=True))
    text = format_table(table)
    print(text)
    if wished.write:
        write_page(text)
    broken = [f"{cell.part} {cell.damage}, {cell.action}: {b}" for cell in cells for b in table[cell].broken]
    print(f"\n{len(cells)} cells, {len(broken)} breaks", *broken, sep="\n")
    sys.exit(bool(broken))


if __name__ == "__main__":
    main()
