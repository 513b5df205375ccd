"""Run the crash tests for long: ``python -m benchmarks.crash --kills 200 --power-cuts 50 --restores 30``.

Every second kill ends everything at once (server, workers, helpers, children) while analyses run. The
table in ``docs/reference/reliability.md`` shows the rounds that were run. Power cuts need root (a
loop-mounted ext4).
"""

import argparse
import os
import platform
import sys
import tempfile
import time
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from tests.crash.rounds import Result, can_cut_power, kill_rounds, power_cut, restore_kills

PAGE = Path(__file__).resolve().parents[1] / "docs" / "reference" / "reliability.md"
CONTROLS = 5
KILLS_AT_ONCE = 10  # then the store is checked and a new one created


@dataclass
class Tally:
    """Results of one kind of round."""

    what: str
    rounds: int = 0
    acknowledged: int = 0
    cut: int = 0
    set_aside: int = 0
    blamed: int = 0
    broken: int = 0
    rounds_broken: int = 0
    seconds: float = 0.0

    def add(self, rounds: int, result: Result, started_s: float) -> None:
        """Add the results of some rounds and print them."""
        self.rounds += rounds
        self.acknowledged += result.acknowledged
        self.cut += result.cut
        self.set_aside += result.set_aside
        self.blamed += result.blamed
        self.broken += len(result.broken)
        self.rounds_broken += bool(result.broken)
        self.seconds += time.monotonic() - started_s
        counts = f"{self.acknowledged} acknowledged, {self.cut} cut, {self.blamed} E-CRASHED"
        print(f"{self.what}: {self.rounds} rounds, {counts}, {self.broken} broken", flush=True)
        for line in result.broken[:5]:
            print("   ", line)

    def row(self) -> str:
        """Return a row of the table."""
        return (
            f"| {self.what} | {self.rounds} | {self.acknowledged} | {self.cut} | {self.set_aside} "
            f"| {self.blamed} | {self.broken} | {self.rounds_broken} | {self.seconds:.0f} |"
        )


def run_kills(number: int, seed: int) -> Tally:
    tally = Tally("kill -9, alternately of everything during analyses and of web, worker or child")
    while tally.rounds < number:
        rounds, started_s = min(KILLS_AT_ONCE, number - tally.rounds), time.monotonic()
        with tempfile.TemporaryDirectory() as folder:
            tally.add(rounds, kill_rounds(Path(folder), rounds, seed + tally.rounds), started_s)
    return tally


def run_power_cuts(number: int, seed: int, sync: str, what: str) -> Tally:
    tally = Tally(what)
    for k in range(number if can_cut_power() else 0):
        started_s = time.monotonic()
        with tempfile.TemporaryDirectory() as folder:
            tally.add(1, power_cut(Path(folder), seed + k, sync), started_s)
    return tally


def run_restore_kills(number: int, seed: int) -> Tally:
    tally = Tally("kill -9 of a restore, which is then repeated (cut: restores killed before their end)")
    if number:
        started_s = time.monotonic()
        with tempfile.TemporaryDirectory() as folder:
            tally.add(number, restore_kills(Path(folder), number, seed), started_s)
    return tally


def write_page(tallies: list[Tally], seed: int) -> None:
    """Write the table between its marks in the page."""
    stamp = datetime.now(UTC).strftime("%Y-%m-%d")
    head = (
        "| fault | rounds | uploads acknowledged | analyses cut | of them E-INTERRUPTED, then retried "
        "| E-CRASHED | invariants broken | rounds with a break | s |"
    )
    lines = [
        f"Run on {stamp}: {platform.system()} {platform.release()}, {os.cpu_count()} cores, seed {seed}.",
        "",
        head,
        "|---|" + "---:|" * 8,
        *(tally.row() for tally in tallies),
    ]
    before, _, rest = PAGE.read_text().partition("<!-- rounds -->")
    after = rest.partition("<!-- end -->")[2]
    PAGE.write_text(before + "<!-- rounds -->\n" + "\n".join(lines) + "\n<!-- end -->" + after)


def main() -> None:
    parser = argparse.ArgumentParser(description="Kill processes, cut the power, check the invariants.")
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--power-cuts", type=int, default=50)
    parser.add_argument("--restores", type=int, default=30)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--print-only", action="store_true", help="leave docs/reference/reliability.md as it is"
    )
    wished = parser.parse_args()
    cuts = run_power_cuts(wished.power_cuts, wished.seed, "synced", "power cut")
    control = run_power_cuts(
        min(CONTROLS, wished.power_cuts), wished.seed, "unsynced", "power cut, fsync off (must break)"
    )
    restores = run_restore_kills(wished.restores, wished.seed)
    tallies = [run_kills(wished.kills, wished.seed), restores, cuts, control]
    if not wished.print_only:
        write_page(tallies, wished.seed)
    sys.exit(any(tally.broken for tally in (tallies[0], restores, cuts)))


if __name__ == "__main__":
    main()
