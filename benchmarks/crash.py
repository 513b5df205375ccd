"""The long round of the crash matrix: ``python -m benchmarks.crash --kills 200 --power-cuts 50``.

Writes ``docs/reliability.md`` with what was really run. Power cuts need root (a loop-mounted ext4).
"""

import argparse
import os
import platform
import tempfile
import time
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from tests.crash.rounds import can_cut_power, kill_rounds, power_cut

PAGE = Path(__file__).resolve().parents[1] / "docs" / "reliability.md"
CONTROLS = 5
KILLS_AT_ONCE = 20  # then the store is checked, and a new one is begun


@dataclass
class Tally:
    """What one kind of round came to."""

    what: str
    rounds: int = 0
    acknowledged: int = 0
    broken: int = 0
    rounds_broken: int = 0
    seconds: float = 0.0

    def add(self, rounds: int, result: tuple[int, list[str]], started_s: float) -> None:
        """Count some more rounds, and tell."""
        acknowledged, broken = result
        self.rounds += rounds
        self.acknowledged += acknowledged
        self.broken += len(broken)
        self.rounds_broken += bool(broken)
        self.seconds += time.monotonic() - started_s
        print(f"{self.what}: {self.rounds} rounds, {self.acknowledged} acknowledged, {self.broken} broken")
        for line in broken[:5]:
            print("   ", line)

    def row(self) -> str:
        """Give a row of the table."""
        return (
            f"| {self.what} | {self.rounds} | {self.acknowledged} | {self.broken} | {self.rounds_broken} "
            f"| {self.seconds:.0f} |"
        )


def run_kills(number: int, seed: int) -> Tally:
    tally = Tally("kill -9 of web, worker, child or all")
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


def write_page(tallies: list[Tally], seed: int) -> None:
    """Put the table into the page, between its marks."""
    stamp = datetime.now(UTC).strftime("%Y-%m-%d")
    head = "| fault | rounds | uploads acknowledged | invariants broken | rounds with a break | s |"
    lines = [
        f"Run on {stamp}: {platform.system()} {platform.release()}, {os.cpu_count()} cores, seed {seed}.",
        "",
        head,
        "|---|---:|---:|---:|---:|---:|",
        *(tally.row() for tally in tallies),
    ]
    before, _, rest = PAGE.read_text().partition("<!-- rounds -->")
    after = rest.partition("<!-- end -->")[2]
    PAGE.write_text(before + "<!-- rounds -->\n" + "\n".join(lines) + "\n<!-- end -->" + after)


def main() -> None:
    parser = argparse.ArgumentParser(description="Kill, cut the power, check the invariants.")
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--power-cuts", type=int, default=50)
    parser.add_argument("--seed", type=int, default=1)
    wished = parser.parse_args()
    cuts = run_power_cuts(wished.power_cuts, wished.seed, "synced", "power cut")
    control = run_power_cuts(
        min(CONTROLS, wished.power_cuts), wished.seed, "unsynced", "power cut, fsync off (must break)"
    )
    tallies = [run_kills(wished.kills, wished.seed), cuts, control]
    write_page(tallies, wished.seed)


if __name__ == "__main__":
    main()
